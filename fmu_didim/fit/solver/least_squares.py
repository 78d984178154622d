"""The one solver: least squares of the closed loop, by damped Gauss-Newton steps with true sensitivities and limits.

    values = argmin sum_j |y_j - y_sj(values)|^2 / s_j^2

over all measured outputs j, the torque first, with the deviations s_j of a
:class:`~fmu_didim.fit.noise.weighting.Weighting`; beside them stand the squares of a prior, where a model has one
(:mod:`fmu_didim.dynamics.prior`). A step is damped (Levenberg, Marquardt)
if after it the cost is not lower, an experiment, held out or not, cannot be simulated, or the inertia matrix is not
positive definite somewhere along its motion: what the data hardly show moves less then, as where the base parameters
make up for an effect that is missing. So the fit always returns the best point that it has tried. In a fit that is to
settle, a step that gains far less than it promised is shortened. Where the torque jitters, the lowest cost is one that
jitter has drawn, not that of the minimum: there such a fit makes each step with fresh slopes in full, whose cost is the
promised one as far as two costs can be compared.

Source: J. Nocedal, S. J. Wright, *Numerical Optimization*, 2nd ed., 2006, chapter 10.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable

import numpy as np

from fmu_didim.data.signals import Array
from fmu_didim.fit.derivatives.differences import Steps
from fmu_didim.fit.derivatives.sensitivity import sensitivity
from fmu_didim.fit.ending import Ending
from fmu_didim.fit.fit import Fit, sum_of_squares
from fmu_didim.fit.iteration import Iteration
from fmu_didim.fit.noise.noise import Noise
from fmu_didim.fit.noise.weighting import KnownNoise, Weighting
from fmu_didim.fit.region import Region
from fmu_didim.fit.solver.linear_step import LinearStep, State
from fmu_didim.fit.solver.search import Search, Trial
from fmu_didim.fit.solver.termination import Stopping, Termination
from fmu_didim.fit.statistics import error_percent
from fmu_didim.model.loop_model import LoopModel

HOPE = 2.0
"""[1] A fit is given up when this many times the gain that a step promises would not be enough."""


def minimise(
    model: LoopModel,
    noise: Noise | Weighting,
    *,
    stopping: Stopping | None = None,
    jacobian: Array | None = None,
    outputs: Array | None = None,
    sizes: Array | None = None,
    steps: Steps | None = None,
    stage: str = "finish",
    progress: Callable[[Iteration], None] | None = None,
) -> Fit:
    """Fit all free parameters of a model, from their values.

    Args:
        noise: of the data, or how they are weighted otherwise.
        jacobian: (M, m, p) at the start, if known; stale columns only slow the steps down.
        outputs: (M, m) at the start, if known.
        sizes: (b,) of the base parameters, for exact differences; see :func:`parameter_sizes`.
        steps: of central differences that are known.
        stage: name of the iterations in the history, which is recorded if ``progress`` is given.

    Raises:
        SimulationError: the start cannot be simulated.
    """
    weighting = KnownNoise(noise) if isinstance(noise, Noise) else noise
    solver = _Solver(model, weighting, stopping or Stopping(), sizes, stage, progress, steps)
    return solver.run(jacobian, outputs)


class _Solver:
    """The loop of one fit: begin, step, decide, end."""

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
        self._measured, self._region = model.measured_outputs, Region.of(model)
        self._search = Search(model, self._region, stopping.tolerance is not None, stopping.check_all, self._steps)
        self._termination = Termination(stopping, self._steps)
        self._history: list[Iteration] = []

    def run(self, jacobian: Array | None, outputs: Array | None) -> Fit:
        at = self._begin(jacobian, outputs)
        for _ in range(self._stopping.iterations):
            step = self._step(at)
            ending = self._before(step)
            if ending is None:
                found = self._search.trial(at, step)
                ending = self._move(at, step, found)
            if ending is not None:
                return self._end(at, ending)
        settled = self._stopping.tolerance is not None and self._is_at_minimum(at)
        return self._end(at, Ending.SETTLED if settled else Ending.MAXIMUM_ITERATIONS)

    def _begin(self, jacobian: Array | None, outputs: Array | None) -> State:
        values, count = np.clip(self._model.start, self._region.low, self._region.high), 0
        if outputs is None:
            outputs, count = self._model.outputs(values), 1
        updates = np.inf if self._stopping.updates is None else float(self._stopping.updates)
        nothing = np.zeros((*outputs.shape, 0))
        at = State(values, outputs, nothing if jacobian is None else jacobian, values, False, updates, count)
        if jacobian is None:
            self._differentiate(at)
            at.updates += 1
        return at

    def _step(self, at: State) -> LinearStep:
        return LinearStep.of(at, self._deviation(at), self._measured, self._region, prior=self._model.prior)

    def _before(self, step: LinearStep) -> Ending | None:
        """The ending if the fit ends without this step, else None."""
        rules = self._stopping
        if rules.tolerance is None and step.promised < rules.promise:
            return Ending.NOTHING_PROMISED
        if step.cost - HOPE * step.promised > rules.give_up_above:
            return Ending.HOPELESS
        return Ending.OUT_OF_TIME if clock.perf_counter() >= rules.until else None

    def _move(self, at: State, step: LinearStep, found: Trial) -> Ending | None:
        """Move to where a step led; the ending if the fit ends there, else None."""
        decision = self._termination.after(at, step, found)
        self._record(at, step, found)
        at.simulations += found.tried
        at.values, at.fresh = found.values, at.fresh and found.outputs is None
        at.outputs = at.outputs if found.outputs is None else found.outputs
        if decision.ending is None:
            if decision.differentiate:
                self._differentiate(at)
            at.last = decision.size
        return decision.ending

    def _differentiate(self, at: State) -> None:
        at.jacobian = sensitivity(
            self._model, at.values, at.outputs, sizes=self._sizes, exact=self._stopping.exact,
            whole=self._stopping.whole, steps=self._steps,
        )  # fmt: skip
        at.differentiated, at.fresh = at.values, True
        at.updates -= 1
        at.simulations += at.values.size

    def _deviation(self, at: State) -> Array:
        return self._weighting.deviation(self._measured - at.outputs, at.jacobian)

    def _is_at_minimum(self, at: State) -> bool:
        """Whether the next step, with the sensitivity of this very point, would be negligible."""
        if not at.fresh and at.updates > 0:
            self._differentiate(at)
        return at.fresh and self._termination.is_nothing(self._step(at))

    def _record(self, at: State, step: LinearStep, found: Trial) -> None:
        if self._progress is None:
            return
        values, outputs = found.values, at.outputs if found.outputs is None else found.outputs
        change = float(np.max(np.abs(values - at.values) / np.maximum(np.abs(values), step.scale)))
        torque = self._model.torque_of(outputs)
        loop, number = self._model.loop, len(self._history) + 1
        error = error_percent(loop, self._model.torque_of(self._measured), torque)[0]
        self._history.append(
            Iteration(
                self._stage, number, values, error, change, step.condition_number, found.note, quantity=loop.quantity
            )
        )  # fmt: skip
        self._progress(self._history[-1])

    def _end(self, at: State, ending: Ending) -> Fit:
        if self._stopping.exact and not at.fresh and self._stopping.tolerance is None:
            self._differentiate(at)
        deviation = self._deviation(at)
        cost = sum_of_squares(self._measured - at.outputs, deviation)
        model = self._model.with_values(at.values)
        noise, history = self._weighting.noise(deviation), tuple(self._history)
        return Fit(
            model, at.values, at.outputs, at.jacobian, noise, deviation, cost, ending, history, at.simulations,
            steps=self._steps,
        )  # fmt: skip
