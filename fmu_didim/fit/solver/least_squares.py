"""The one solver: least squares of the closed loop, by damped Gauss-Newton steps with true sensitivities and limits.

    values = argmin sum_j |y_j - tau_j(values)|^2 / s_j^2

with the deviations s_j of a :class:`~fmu_didim.fit.noise.weighting.Weighting`. A step is damped (Levenberg,
Marquardt) if after it the cost is not lower, an experiment, held out or not, cannot be simulated, or the inertia
matrix is not positive definite somewhere along its motion: what the data hardly show moves less then, as where the base
parameters make up for an effect that is missing. So the point reached is always the best one seen. In a fit that is to
settle, a step that gains far less than it promised is shortened. Where the torque jitters, the lowest cost is one that
jitter has drawn, not that of the minimum: there such a fit makes each step with fresh slopes in full, whose cost is the
promised one as far as two costs can be compared.

Source: J. Nocedal, S. J. Wright, *Numerical Optimization*, 2nd ed., 2006, chapter 10.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from fmu_didim.base.errors import SimulationError
from fmu_didim.data.signals import Array
from fmu_didim.fit.derivatives.differences import Steps, jitter_in
from fmu_didim.fit.derivatives.sensitivity import sensitivity
from fmu_didim.fit.equations import Equations
from fmu_didim.fit.fit import Fit, sum_of_squares
from fmu_didim.fit.iteration import Iteration
from fmu_didim.fit.noise.noise import Noise
from fmu_didim.fit.noise.weighting import KnownNoise, Weighting
from fmu_didim.fit.solver.admissible import mass_matrix_problem
from fmu_didim.fit.statistics import relative_error_percent
from fmu_didim.fit.uncertainty import EXCESS
from fmu_didim.model.loop_model import LoopModel

DAMPINGS = (0.0, 1e-4, 1e-3, 1e-2, 1e-1, 1.0, 10.0, 100.0)
"""[1] Tried one after the other, for columns of the Jacobian of length one."""
ITERATIONS = 8
"""[steps] Largest number of a fit that does not ask for another."""
PROMISE = 0.02
"""[chi-square] A step of a search that promises to lower chi-square by less is not made: a BIC difference of 10
decides."""
UPDATES = 3
"""[sensitivities] Taken anew at most, in a fit that does not ask for another number: the costly part."""
HOPE = 2.0
"""[1] A fit is given up when not even so many times what a step promises would be enough."""
CREEPING = 0.01
"""[1] Fraction of the cost that a step must gain along the edge of what can be simulated."""
STALE = 0.02
"""[standard deviations] Farther than this from where it was taken, a sensitivity is not the one that ends the steps:
what it leaves of the error is this fraction times its relative change, of a standard deviation."""
CONTRACTION = 0.1
"""[1] A step that is at most this fraction of the one before shows that the sensitivity still serves."""
KEPT_PROMISE = (0.5, 1.5)
"""[1] Gain of a step over what the linear model promised: outside, its slopes are stale."""
ROUNDING = 1e-6
"""[1] A step that would lower the cost by a smaller fraction may fail by rounding alone."""
FAR_BELOW = 0.01
"""[standard deviations] A step that small changes no conclusion: when it cannot be made in full, the fit has settled
all the same."""
HIDDEN = 0.1
"""[standard deviations] Where a step does not gain what it promised although the sensitivity was taken there, the
torque is rough: a step that small is then hidden by it, and changes no conclusion."""
BROKEN_PROMISE = 0.1
"""[1] Fraction of what a step promised below which it gained nothing: damped until the cost grows no more, it moves
nothing, and the next one would not either (a co-simulated drivetrain gained 0.04 and less for 36 steps)."""
LEFT_BY_JITTER = 0.25
"""[chi-square] A step that promises no more, half a standard deviation, need not be made where a jitter of the torque
hides what it gains."""
DRAWN_BY_JITTER = 5.0
"""[standard deviations] Of the difference of two costs, by which jitter may make a step miss its promise: a cost that
is too low by three of its own and one that is too high by as much are 4.2 apart."""
EQUAL = 1e-9
"""[1] Costs that differ by a smaller fraction are the same: at the minimum, rounding decides whether the cost
grows."""
TORQUE_FLOOR = 1e-3
"""[1] Fraction of the tolerance, in units of the torque, below which a move counts as none: a parameter that is zero,
in data without noise, has neither size nor standard deviation."""

NO_STEP = "no step lowers the error"
"""The note of an iteration after which the steps have ended."""


@dataclass(frozen=True)
class Stopping:
    """When the steps end, and how often the sensitivity is taken anew.

    Attributes:
        iterations: largest number of steps.
        tolerance: settled when no parameter moves by more than this fraction of the larger of its size and its standard
            deviation, with a sensitivity taken nearby, or when the iterations are over and the step that would follow
            is far below the standard deviations; or when a step is one that jitter of the torque alone would ask for;
            None: a minimum of a search, which ends by ``promise``.
        next_step: in a fit with a tolerance, settled also when the step that would follow is below this many standard
            deviations.
        promise: a step that promises to lower the cost by less is not made.
        updates: how often the sensitivity may be taken anew; None: as often as the steps need it.
        give_up_above: the fit ends early where not even twice what a step promises brings the cost below this.
        until: reading of ``time.perf_counter`` from which no further step is made: such a fit is given up.
        check_all: whether each step must leave all experiments simulable, not only those that are fitted.
        exact: whether sensitivities are the best ones that there are, and the last one is taken at the minimum.
        whole: whether they follow an experiment to its end even where its motion and torque repeat.
    """

    iterations: int = ITERATIONS
    tolerance: float | None = None
    next_step: float = 0.0
    promise: float = PROMISE
    updates: int | None = UPDATES
    give_up_above: float = np.inf
    until: float = np.inf
    check_all: bool = True
    exact: bool = False
    whole: bool = False


def minimise(
    model: LoopModel,
    noise: Noise | Weighting,
    *,
    stopping: Stopping | None = None,
    jacobian: Array | None = None,
    torque: Array | None = None,
    sizes: Array | None = None,
    steps: Steps | None = None,
    stage: str = "finish",
    progress: Callable[[Iteration], None] | None = None,
) -> Fit:
    """Fit all free parameters of a model, from their values.

    Args:
        noise: of the data, or how they are weighted otherwise.
        jacobian: (N, n, p) at the start, if known; stale columns only slow the steps down.
        torque: (N, n) at the start, if known.
        sizes: (b,) of the base parameters, for exact differences; see :func:`parameter_sizes`.
        steps: of central differences that are known.
        stage: name of the iterations in the history, which is kept where ``progress`` is given.

    Raises:
        SimulationError: the start cannot be simulated.
    """
    weighting = KnownNoise(noise) if isinstance(noise, Noise) else noise
    solver = _Solver(model, weighting, stopping or Stopping(), sizes, stage, progress, steps)
    return solver.run(jacobian, torque)


@dataclass
class _State:
    """Where the steps are.

    Attributes:
        differentiated: (p,) where the sensitivity was taken; fresh: whether that is here.
        updates: how often it may still be taken; last: size of the step before, in standard deviations.
    """

    values: Array
    torque: Array
    jacobian: Array
    differentiated: Array
    fresh: bool
    updates: float
    simulations: int
    last: float = 0.0


class _Solver:
    """The steps of one fit."""

    def __init__(
        self,
        model: LoopModel,
        weighting: Weighting,
        stopping: Stopping,
        sizes: Array | None,
        stage: str,
        progress: Callable[[Iteration], None] | None,
        steps: Steps | None = None,
    ) -> None:
        self._model, self._weighting, self._stopping = model, weighting, stopping
        self._sizes, self._stage, self._progress, self._steps = sizes, stage, progress, dict(steps or {})
        self._measured, (self._low, self._high) = model.measured, model.limits
        self._history: list[Iteration] = []

    def run(self, jacobian: Array | None, torque: Array | None) -> Fit:
        rules = self._stopping
        at = self._begin(jacobian, torque)
        settled = given_up = False
        deviation = self._deviation(at)
        for _ in range(rules.iterations):
            step = _Step.of(at, deviation, self._measured, self._low, self._high)
            if rules.tolerance is None and step.promised < rules.promise:
                break
            if step.cost - HOPE * step.promised > rules.give_up_above or clock.perf_counter() >= rules.until:
                given_up = True
                break
            found = self._search(at, step)
            at.simulations += found.tried
            outcome = self._after(at, step, found)
            if outcome == "settled":
                settled = True
            if outcome in ("settled", "stopped"):
                break
            deviation = self._deviation(at)
        else:
            settled = rules.tolerance is not None and self._is_at_minimum(at)
        return self._end(at, settled, given_up)

    def _begin(self, jacobian: Array | None, torque: Array | None) -> _State:
        values, count = np.clip(self._model.start, self._low, self._high), 0
        if torque is None:
            torque, count = self._model.torque(values), 1
        updates = np.inf if self._stopping.updates is None else float(self._stopping.updates)
        nothing = np.zeros((*torque.shape, 0))
        at = _State(values, torque, nothing if jacobian is None else jacobian, values, False, updates, count)
        if jacobian is None:
            self._differentiate(at)
            at.updates += 1
        return at

    def _differentiate(self, at: _State) -> None:
        at.jacobian = sensitivity(
            self._model, at.values, at.torque, sizes=self._sizes, exact=self._stopping.exact,
            whole=self._stopping.whole, steps=self._steps,
        )  # fmt: skip
        at.differentiated, at.fresh = at.values, True
        at.updates -= 1
        at.simulations += at.values.size

    def _deviation(self, at: _State) -> Array:
        return self._weighting.deviation(self._measured - at.torque, at.jacobian)

    def _is_at_minimum(self, at: _State) -> bool:
        """Whether the step that would follow, with the sensitivity of this very point, is nothing."""
        if not at.fresh and at.updates > 0:
            self._differentiate(at)
        return at.fresh and self._is_nothing(_Step.of(at, self._deviation(at), self._measured, self._low, self._high))

    def _is_nothing(self, step: _Step) -> bool:
        """Whether a step changes no conclusion, or is one that jitter alone would ask for."""
        return step.is_far_below_sigma or step.promised <= self._promise_of_jitter(step)

    def _after(self, at: _State, step: _Step, found: _Found) -> str:
        """What a step has come to: ``settled``, ``stopped`` or ``goes on``; the state moves to where it led."""
        rules = self._stopping
        here, torque = (at.values, at.torque) if found.torque is None else (found.values, found.torque)
        moved = here - at.values
        self._record(here, torque, moved, step, found.note)
        gained, was_fresh = step.cost - found.cost, at.fresh
        at.values, at.torque, at.fresh = here, torque, at.fresh and found.torque is None
        stuck = found.torque is None
        hidden = was_fresh and step.is_below(HIDDEN) and gained < BROKEN_PROMISE * step.promised
        if hidden and rules.tolerance is not None:
            return "settled"
        if stuck and (was_fresh or at.updates <= 0):
            nothing_left = step.promised <= ROUNDING * step.cost or self._is_nothing(step)
            return "settled" if rules.tolerance is not None and nothing_left else "stopped"
        if found.at_edge and not stuck and gained < CREEPING * step.cost and rules.tolerance is None:
            return "stopped"
        size = float(np.max(np.abs(moved) / step.scale))
        stale = bool((np.abs(here - at.differentiated) > STALE * step.scale).any())
        if rules.tolerance is not None and not stuck:
            floor = np.maximum(np.maximum(np.abs(here), step.scale), TORQUE_FLOOR * step.size)
            # A step that was damped or shortened is small for that: what it should have been counts.
            whole = not found.note or step.is_far_below_sigma
            small = bool((np.abs(moved) <= rules.tolerance * floor).all()) and (was_fresh or not stale)
            if whole and (small or (was_fresh and self._next_is_nothing(size, at.last))):
                return "settled"
            if was_fresh and step.promised <= self._promise_of_jitter(step):
                return "settled"
        low, high = KEPT_PROMISE
        kept = low * found.promised <= gained <= high * found.promised
        contracts = STALE < size <= CONTRACTION * at.last
        far = stale and not contracts if rules.tolerance is not None else not kept
        if at.updates > 0 and (stuck or far):
            self._differentiate(at)
        at.last = size
        return "goes on"

    def _next_is_nothing(self, size: float, last: float) -> bool:
        """Whether the step after one of this size, in standard deviations, need not be made: steps shrink in
        proportion, so that it will be about size^2 / last."""
        return 0 < size <= CONTRACTION * last and size**2 <= self._stopping.next_step * last

    def _promise_of_jitter(self, step: _Step) -> float:
        """How much a step may promise where the minimum is reached, but the torque jitters by J deviations.

        Chi-square of the jitter in as many directions as there are parameters; or, as long as it is a small part of a
        deviation, what two costs differ by because of it.
        """
        jitter = jitter_in(self._steps, step.deviation)
        if not jitter:
            return 0.0
        blurred = min(self._blur(step), LEFT_BY_JITTER)
        return max(jitter**2 * float(chi2.isf(EXCESS, step.change.size)), blurred)

    def _blur(self, step: _Step) -> float:
        """2 J |r| sqrt(2 p), standard deviation of the difference of two costs |r|^2 by jitter J of p parameters."""
        jitter = jitter_in(self._steps, step.deviation)
        return 2 * jitter * float(np.sqrt(2 * step.change.size * step.cost))

    def _record(self, values: Array, torque: Array, moved: Array, step: _Step, note: str) -> None:
        if self._progress is None:
            return
        change = float(np.max(np.abs(moved) / np.maximum(np.abs(values), step.scale)))
        error = relative_error_percent(self._measured, torque)[0]
        number = len(self._history) + 1
        self._history.append(Iteration(self._stage, number, values, error, change, step.condition_number, note))
        self._progress(self._history[-1])

    def _search(self, at: _State, step: _Step) -> _Found:
        """The least damped step that lowers the cost; the next more damped one where less damping is not feasible,
        because at the edge of what can be simulated a loop hardly damps itself any more."""
        model = self._model
        others = model.validation_labels if self._stopping.check_all else ()
        tried, edge, best, note = 0, False, None, ""
        for damping in DAMPINGS:
            change, promised = step.equations.step(at.values, self._low, self._high, damping)
            trial = np.clip(at.values + change, self._low, self._high)
            reason = mass_matrix_problem(model, trial)
            if reason:
                edge, note = True, f"step damped: {reason}"
                continue
            tried += 1
            try:
                torque = model.torque(trial)
                reached = sum_of_squares(self._measured - torque, step.deviation)
                kept = damping == 0 and self._keeps_promise(at, step, reached)
                if kept or reached < step.cost:
                    for label in others:  # what was measured there is not looked at
                        model.torque(trial, label)
            except SimulationError as error:
                edge, note = True, f"step damped: {error.what}"
                continue
            if kept:
                return _Found(trial, torque, reached, promised, tried, edge)
            if damping == 0 and self._stopping.tolerance is not None:
                found = self._shortened(at, step, _Found(trial, torque, reached, promised, tried, edge))
                tried = found.tried
                if found.note:
                    return found
                if reached > step.cost * (1 + EQUAL) and not at.fresh and at.updates > 0:
                    break  # damping would not make up for old slopes
            if reached <= step.cost * (1 + (EQUAL if self._stopping.tolerance is not None else 0.0)) and (
                reached < step.cost or self._stopping.tolerance is not None
            ):
                found = _Found(trial, torque, reached, promised, tried, edge, note)
                if best is not None or not edge:
                    return found
                best = found
            else:
                note = "step damped: the error grew"
        return best or _Found(at.values, None, step.cost, 0.0, tried, edge, NO_STEP)

    def _keeps_promise(self, at: _State, step: _Step, reached: float) -> bool:
        """Whether a full step with fresh slopes has reached the cost that it promised, as far as jitter lets one see.

        What it misses must be less than noise moves the minimum by, so that no jitter excuses a step that is wrong.
        """
        if self._stopping.tolerance is None or not at.fresh:
            return False
        hidden = min(DRAWN_BY_JITTER * self._blur(step), float(chi2.isf(EXCESS, step.change.size)))
        return reached <= step.cost - step.promised + hidden

    def _shortened(self, at: _State, step: _Step, found: _Found) -> _Found:
        """The least cost along a step that went too far, by the parabola through its slope, its beginning and its end.

        Where the residual is large, its second derivatives have a say: then all steps go too far by the same factor.
        """
        gained = step.cost - found.cost
        if gained >= KEPT_PROMISE[0] * found.promised or found.promised <= EQUAL * step.cost:
            return found
        part = found.promised / (2 * found.promised - gained)
        trial = at.values + part * (found.values - at.values)
        if mass_matrix_problem(self._model, trial):
            return found
        tried = found.tried + 1
        try:
            torque = self._model.torque(trial)
        except SimulationError:
            return replace(found, tried=tried)
        reached = sum_of_squares(self._measured - torque, step.deviation)
        if reached >= min(found.cost, step.cost):
            return replace(found, tried=tried)
        return replace(found, values=trial, torque=torque, cost=reached, tried=tried, note="step shortened")

    def _end(self, at: _State, settled: bool, given_up: bool) -> Fit:
        if self._stopping.exact and not at.fresh and self._stopping.tolerance is None:
            self._differentiate(at)
        deviation = self._deviation(at)
        cost = sum_of_squares(self._measured - at.torque, deviation)
        model = self._model.with_values(at.values)
        noise, history = self._weighting.noise(deviation), tuple(self._history)
        return Fit(
            model, at.values, at.torque, at.jacobian, noise, deviation, cost, settled, given_up, history,
            at.simulations, steps=self._steps,
        )  # fmt: skip


@dataclass(frozen=True)
class _Found:
    values: Array
    torque: Array | None
    cost: float
    promised: float
    tried: int
    at_edge: bool
    note: str = ""


@dataclass(frozen=True)
class _Step:
    """The linear problem of a step.

    Attributes:
        change: (p,) the full step; deviation: (n,) weights; cost: weighted square of the residual; promised: how much
            the full step would lower it.
        scale: (p,) standard deviations; size: (p,) at which each parameter makes up the whole torque.
    """

    equations: Equations
    change: Array
    deviation: Array
    cost: float
    promised: float
    scale: Array
    size: Array
    condition_number: float

    @property
    def is_far_below_sigma(self) -> bool:
        return self.is_below(FAR_BELOW)

    def is_below(self, part: float) -> bool:
        """Whether it moves no parameter by more than this fraction of its standard deviation."""
        return bool((np.abs(self.change) <= part * self.scale).all())

    @staticmethod
    def of(at: _State, deviation: Array, measured: Array, low: Array, high: Array) -> _Step:
        residual = measured - at.torque
        table = at.jacobian / deviation[:, None]
        equations = Equations.of(table, residual / deviation)
        change, promised = equations.step(at.values, low, high, 0.0)
        length = np.where(equations.scale > 0, equations.scale, np.inf)
        size = float(np.linalg.norm(measured / deviation)) / length
        return _Step(
            equations,
            change,
            deviation,
            sum_of_squares(residual, deviation),
            promised,
            equations.deviations(),
            size,
            equations.condition,
        )
