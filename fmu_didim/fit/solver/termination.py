"""Termination of the steps of a fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmu_didim.fit.derivatives.differences import Steps, jitter_in
from fmu_didim.fit.ending import Ending
from fmu_didim.fit.solver.linear_step import LinearStep, State
from fmu_didim.fit.solver.search import KEPT_PROMISE, Trial

ITERATIONS = 8
"""[steps] Largest number of a fit that does not ask for another."""
PROMISE = 0.02
"""[chi-square] A step of a search that promises to lower chi-square by less is not made: a BIC difference of 10
decides."""
UPDATES = 3
"""[sensitivities] Taken anew at most, in a fit that does not ask for another number: the costly part."""
CREEPING = 0.01
"""[1] Fraction of the cost that a step must gain along the edge of what can be simulated."""
STALE = 0.02
"""[standard deviations] Farther than this from where it was taken, a sensitivity is not the one that ends the steps:
what it leaves of the error is this fraction times its relative change, of a standard deviation."""
CONTRACTION = 0.1
"""[1] A step that is at most this fraction of the one before shows that the sensitivity still serves."""
ROUNDING = 1e-6
"""[1] A step that would lower the cost by a smaller fraction may fail by rounding alone."""
HIDDEN = 0.1
"""[standard deviations] Where a step does not gain what it promised although the sensitivity was taken there, the
torque is rough: a step that small is then hidden by it, and changes no conclusion."""
BROKEN_PROMISE = 0.1
"""[1] Fraction of what a step promised below which it gained nothing: damped until the cost grows no more, it moves
nothing, and the next one would not either (a co-simulated drivetrain gained 0.04 and less for 36 steps)."""
TORQUE_FLOOR = 1e-3
"""[1] Fraction of the tolerance, in units of the torque, below which a move counts as none: a parameter that is zero,
in data without noise, has neither size nor standard deviation."""


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


@dataclass(frozen=True)
class Decision:
    """Decision after a step.

    Attributes:
        ending: how the fit ends with it; None: it goes on.
        differentiate: whether it goes on with a sensitivity taken anew; size: of the step, in standard deviations.
    """

    ending: Ending | None = None
    differentiate: bool = False
    size: float = 0.0


@dataclass(frozen=True)
class Termination:
    """The decision after each step.

    Attributes:
        rules: when the steps end; differences: of the sensitivity, which know the jitter of the torque.
    """

    rules: Stopping
    differences: Steps

    def after(self, at: State, step: LinearStep, found: Trial) -> Decision:
        """Whether a fit ends with what a step has come to.

        Args:
            at: where the step began; found: where it led.
        """
        tolerance, stuck = self.rules.tolerance, found.outputs is None
        moved, gained = found.values - at.values, step.cost - found.cost
        hidden = at.fresh and step.is_below(HIDDEN) and gained < BROKEN_PROMISE * step.promised
        if hidden and tolerance is not None:
            return Decision(Ending.SETTLED)
        if stuck and (at.fresh or at.updates <= 0):
            nothing_left = step.promised <= ROUNDING * step.cost or self.is_nothing(step)
            return Decision(Ending.SETTLED if tolerance is not None and nothing_left else Ending.NO_STEP)
        if found.at_edge and not stuck and gained < CREEPING * step.cost and tolerance is None:
            return Decision(Ending.AT_EDGE)
        size = float(np.max(np.abs(moved) / step.scale))
        stale = bool((np.abs(found.values - at.differentiated) > STALE * step.scale).any())
        if tolerance is not None and not stuck and self._is_small(at, step, found, tolerance, size, stale=stale):
            return Decision(Ending.SETTLED)
        low, high = KEPT_PROMISE
        kept = low * found.promised <= gained <= high * found.promised
        contracts = STALE < size <= CONTRACTION * at.last
        far = stale and not contracts if tolerance is not None else not kept
        return Decision(differentiate=at.updates > 0 and (stuck or far), size=size)

    def _is_small(
        self, at: State, step: LinearStep, found: Trial, tolerance: float, size: float, *, stale: bool
    ) -> bool:
        """Whether a step that was made shows that the next one is negligible."""
        floor = np.maximum(np.maximum(np.abs(found.values), step.scale), TORQUE_FLOOR * step.size)
        # A step that was damped or shortened is small for that: what it should have been counts.
        whole, serves = not found.note or step.is_far_below_sigma, at.fresh or not stale
        small = bool((np.abs(found.values - at.values) <= tolerance * floor).all())
        if whole and serves and (small or self._next_is_nothing(size, at.last)):
            return True
        return at.fresh and step.promised <= self._promise_of_jitter(step)

    def is_nothing(self, step: LinearStep) -> bool:
        """Whether a step changes no conclusion, or is within jitter."""
        return step.is_far_below_sigma or step.promised <= self._promise_of_jitter(step)

    def _promise_of_jitter(self, step: LinearStep) -> float:
        return step.promise_of(jitter_in(self.differences, step.deviation))

    def _next_is_nothing(self, size: float, last: float) -> bool:
        """Whether the step after one of this size, in standard deviations, need not be made: steps shrink in
        proportion, so that it will be about size^2 / last."""
        return 0 < size <= CONTRACTION * last and size**2 <= self.rules.next_step * last
