"""Check of a minimum without derivatives: chi-square some way off it along each principal direction.

With the columns d_k of a root of the covariance by the sensitivity, one standard deviation each, chi-square rises by

    c(+-h) = c(0) + h^2 (1 -+ 2 t / h),      t = h (c(-h) - c(+h)) / (2 (c(+h) + c(-h) - 2 c(0)))

where t is how far the minimum lies off along d_k, in standard deviations. Where a model is rough, as one with a solver
of its own, slopes over tiny steps are those of the roughness and a fit may end anywhere; over steps of the size of a
standard deviation they are those that decide.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmu_didim.base.errors import SimulationError
from fmu_didim.data.signals import Array
from fmu_didim.fit.fit import Fit, prior_squares, sum_of_squares
from fmu_didim.fit.noise.weighting import whitened

STEPS = (0.3, 1.0, 3.0)
"""[standard deviations] Tried one after the other: a short one while the model is smooth, a long one where it is
rough."""
OFF = 0.1
"""[standard deviations] By which the minimum may lie off: that changes no conclusion."""
CURVATURE = (0.3, 3.0)
"""[1] Range of the rise of chi-square over the one that the sensitivity says: outside, either of both is wrong."""
FARTHER = (3.0, 10.0)
"""[standard deviations] At which the error must not be lower than at the answer either: a ripple of a rough model has
minima, and deviations, of its own."""
LOWER = 0.1
"""[chi-square] By which it must be lower to count: it changes no conclusion."""
NEGLIGIBLE = 1e-9
"""[1] Rise of chi-square, relative to it, that rounding hides: of data without noise, whose deviations are rounding."""
MOST_NAMED = 0.3
"""[1] Of the largest part in a direction from which a parameter is named."""


@dataclass(frozen=True)
class Unproven:
    """A direction in which a fit is not known to be at a minimum: its parameters, how far off that seems to lie, in
    standard deviations, and the rise of chi-square over the one that the sensitivity says; NaN where the model cannot
    be simulated there."""

    names: tuple[str, ...]
    off: float
    curvature: float

    @property
    def text(self) -> str:
        """In words."""
        along = ", ".join(self.names)
        if not np.isfinite(self.off):
            return f"the model cannot be simulated beside the answer, along {along}"
        if not CURVATURE[0] <= self.curvature <= CURVATURE[1]:
            return (
                f"along {along} the error rises by {self.curvature:.2g} of what the sensitivities say, so that they "
                "are not those of the model"
            )
        return f"along {along} the error is still falling: its minimum lies {abs(self.off):.2g} standard deviations off"


def unproven(fit: Fit) -> Unproven | None:
    """The first direction in which a fit is not known to be at a minimum; None where it is one in all."""
    model = fit.model
    table = model.beside_prior(whitened(fit.jacobian, fit.deviation))
    length = np.linalg.norm(table, axis=0)
    free = np.flatnonzero((length > 0) & np.logical_not(_at_limits(fit)))
    if not free.size:
        return None
    _, singular, right = np.linalg.svd(np.linalg.qr(table[:, free] / length[free])[1])
    for size, direction in zip(singular, right, strict=True):
        if size <= 0:
            continue
        step = np.zeros(fit.values.size)
        step[free] = direction / size / length[free]
        found = _minimum_along(fit, step)
        if found is not None:
            part = np.abs(direction)
            return Unproven(
                tuple(model.names[free[i]] for i in np.flatnonzero(part >= MOST_NAMED * part.max())), *found
            )
    return None


def _at_limits(fit: Fit) -> NDArray[np.bool_]:
    low, high = fit.model.free_parameters.limits
    return np.asarray((fit.values <= low) | (fit.values >= high))


def _minimum_along(fit: Fit, step: Array) -> tuple[float, float] | None:
    """How far off the minimum lies along a step of one standard deviation, and the curvature; None where it is near."""
    best = np.nan, np.nan
    low, high = fit.model.free_parameters.limits
    here = _cost(fit, fit.values)
    for size in STEPS:
        ends = [fit.values + sign * size * step for sign in (1, -1)]
        if any((end < low).any() or (end > high).any() for end in ends):
            continue
        costs = [_cost(fit, end) for end in ends]
        if here is None or any(cost is None for cost in costs):
            continue
        above, below = (float(cost) - here for cost in costs if cost is not None)
        if max(abs(above), abs(below)) <= NEGLIGIBLE * here:
            return None
        rise = (above + below) / 2
        off, curvature = size * (below - above) / (4 * rise) if rise > 0 else np.inf, rise / size**2
        if abs(off) <= OFF and CURVATURE[0] <= curvature <= CURVATURE[1]:
            lower = _lower_farther(fit, step, here)
            return None if lower is None else (lower, curvature)
        if not np.isfinite(best[0]) or abs(off) < abs(best[0]):
            best = off, curvature
    if np.isnan(best[0]) and here is not None and _touches(fit, step):
        return None  # between limits closer than that: they decide
    return best


def _lower_farther(fit: Fit, step: Array, here: float) -> float | None:
    """How far off along a step, in standard deviations, the error is lower than at the answer; None where it is not."""
    low, high = fit.model.free_parameters.limits
    for size in (sign * far for far in FARTHER for sign in (1, -1)):
        end = fit.values + size * step
        if (end < low).any() or (end > high).any():
            continue
        cost = _cost(fit, end)
        if cost is not None and cost < here - LOWER:
            return size
    return None


def _touches(fit: Fit, step: Array) -> bool:
    """Whether limits lie within the shortest step."""
    low, high = fit.model.free_parameters.limits
    ends = [fit.values + sign * STEPS[0] * step for sign in (1, -1)]
    return any((end < low).any() or (end > high).any() for end in ends)


def _cost(fit: Fit, values: Array) -> float | None:
    """Chi-square with values (p,) and the weights of the fit; None where they cannot be simulated."""
    try:
        outputs = fit.model.outputs(values)
    except SimulationError:
        return None
    return sum_of_squares(fit.model.measured_outputs - outputs, fit.deviation) + prior_squares(fit.model.prior, values)
