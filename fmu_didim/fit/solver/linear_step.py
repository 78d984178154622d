"""State of the steps of a fit, and the linear problem of the next one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmu_didim.base.distributions import chi2_isf
from fmu_didim.data.signals import Array
from fmu_didim.dynamics.prior import Prior
from fmu_didim.fit.fit import prior_rows, prior_squares, sum_of_squares
from fmu_didim.fit.linear_problem import LinearProblem
from fmu_didim.fit.region import Region
from fmu_didim.fit.uncertainty import EXCESS

FAR_BELOW = 0.01
"""[standard deviations] A step that small changes no conclusion: when it cannot be made in full, the fit has settled
all the same."""
LEFT_BY_JITTER = 0.25
"""[chi-square] A step that promises no more, half a standard deviation, need not be made where a jitter of the torque
hides what it gains."""


@dataclass
class State:
    """State of the steps.

    Attributes:
        values: (p,); outputs: (M, m); jacobian: (M, m, p), of the last sensitivity.
        differentiated: (p,) where the sensitivity was taken; fresh: whether that is here.
        updates: how often it may still be taken; last: size of the step before, in standard deviations.
        simulations: made so far.
    """

    values: Array
    outputs: Array
    jacobian: Array
    differentiated: Array
    fresh: bool
    updates: float
    simulations: int
    last: float = 0.0


@dataclass(frozen=True)
class LinearStep:
    """The linear problem of a step.

    Attributes:
        change: (p,) the full step; deviation: (m,) weights; cost: weighted square of the residual, with that of the
            prior; promised: how much
            the full step would lower it.
        scale: (p,) standard deviations; size: (p,) at which each parameter makes up all that was measured.
    """

    equations: LinearProblem
    change: Array
    deviation: Array
    cost: float
    promised: float
    scale: Array
    size: Array
    condition_number: float

    @property
    def is_far_below_sigma(self) -> bool:
        """Whether it changes no conclusion."""
        return self.is_below(FAR_BELOW)

    def is_below(self, part: float) -> bool:
        """Whether it moves no parameter by more than this fraction of its standard deviation."""
        return bool((np.abs(self.change) <= part * self.scale).all())

    def promise_of(self, jitter: float) -> float:
        """Gain that a step may promise at the minimum, where the torque jitters by J deviations.

        Chi-square of the jitter in as many directions as there are parameters; or, as long as it is a small part of a
        deviation, what two costs differ by because of it.
        """
        if not jitter:
            return 0.0
        blurred = min(self.blur(jitter), LEFT_BY_JITTER)
        return max(jitter**2 * float(chi2_isf(EXCESS, self.change.size)), blurred)

    def blur(self, jitter: float) -> float:
        """2 J |r| sqrt(2 p), standard deviation of the difference of two costs |r|^2 by jitter J of p parameters."""
        return 2 * jitter * float(np.sqrt(2 * self.change.size * self.cost))

    @staticmethod
    def of(at: State, deviation: Array, measured: Array, region: Region, *, prior: Prior | None = None) -> LinearStep:
        """From a state.

        Args:
            deviation: (m,) weights; measured: (M, m); region: where the values may be; prior: of the values.
        """
        residual = measured - at.outputs
        equations = LinearProblem.of(
            at.jacobian, residual, prior=prior_rows(prior, at.values), deviation=deviation
        )  # fmt: skip
        change, promised = equations.step(at.values, region, 0.0)
        length = np.where(equations.scale > 0, equations.scale, np.inf)
        size = float(np.linalg.norm(measured / deviation)) / length
        return LinearStep(
            equations,
            change,
            deviation,
            sum_of_squares(residual, deviation) + prior_squares(prior, at.values),
            promised,
            equations.deviations(),
            size,
            equations.condition,
        )
