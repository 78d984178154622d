"""Check of a minimum without derivatives: chi-square some way off it along each principal direction.

With the columns d_k of a root of the covariance by the sensitivity, one standard deviation each, chi-square rises by

    c(+-h) = c(0) + h^2 (1 -+ 2 t / h),      t = h (c(-h) - c(+h)) / (2 (c(+h) + c(-h) - 2 c(0)))

where t is how far the minimum lies off along d_k, in standard deviations. Where a model is rough, as one with a solver
of its own, slopes over tiny steps are those of the roughness and a fit may end anywhere; over steps of the size of a
standard deviation they are those that decide.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from fmu_didim.base.errors import SimulationError
from fmu_didim.data.signals import Array
from fmu_didim.fit.fit import Fit, prior_squares, sum_of_squares
from fmu_didim.fit.noise.weighting import whitened
from fmu_didim.model.workers import side_by_side

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
    beside = _Beside(fit)
    for size, direction in zip(singular, right, strict=True):
        if size <= 0:
            continue
        step = np.zeros(fit.values.size)
        step[free] = direction / size / length[free]
        found = _minimum_along(beside, step)
        if found is not None:
            part = np.abs(direction)
            return Unproven(
                tuple(model.names[free[i]] for i in np.flatnonzero(part >= MOST_NAMED * part.max())), *found
            )
    return None


def _at_limits(fit: Fit) -> NDArray[np.bool_]:
    low, high = fit.model.free_parameters.limits
    return np.asarray((fit.values <= low) | (fit.values >= high))


def _minimum_along(beside: _Beside, step: Array) -> tuple[float, float] | None:
    """How far off the minimum lies along a step of one standard deviation, and the curvature; None where it is near."""
    best, here = (np.nan, np.nan), beside.here
    # A smooth model ends with these, which run side by side.
    known = beside.costs(step, [sign * size for size in (STEPS[0], *FARTHER) for sign in (1, -1)])
    for size in STEPS:
        known |= beside.costs(step, [end for end in (size, -size) if end not in known])
        ends = [known[size], known[-size]]
        if here is None or any(cost is None for cost in ends):
            continue
        above, below = (float(cost) - here for cost in ends if cost is not None)
        if max(abs(above), abs(below)) <= NEGLIGIBLE * here:
            return None
        rise = (above + below) / 2
        off, curvature = size * (below - above) / (4 * rise) if rise > 0 else np.inf, rise / size**2
        if abs(off) <= OFF and CURVATURE[0] <= curvature <= CURVATURE[1]:
            lower = _lower_farther(known, here)
            return None if lower is None else (lower, curvature)
        if not np.isfinite(best[0]) or abs(off) < abs(best[0]):
            best = off, curvature
    if np.isnan(best[0]) and here is not None and not beside.reaches(step, STEPS[0]):
        return None  # between limits closer than that: they decide
    return best


def _lower_farther(known: Mapping[float, float | None], here: float) -> float | None:
    """How far off along a step, in standard deviations, the error is lower than at the answer; None where it is not."""
    for size in (sign * far for far in FARTHER for sign in (1, -1)):
        cost = known[size]
        if cost is not None and cost < here - LOWER:
            return size
    return None


class _Beside:
    """Chi-square beside an answer, with the weights of its fit."""

    def __init__(self, fit: Fit) -> None:
        self._fit, self._low_high = fit, fit.model.free_parameters.limits
        self._workers = fit.model.allowed_workers(fit.values)
        self.here = self._cost(fit.values)

    def costs(self, step: Array, sizes: Sequence[float]) -> dict[float, float | None]:
        """Size -> chi-square so many steps off; None beyond a limit, and where the model cannot be simulated."""
        within = [size for size in sizes if self._is_within(self._fit.values + size * step)]
        tasks = [partial(self._cost, self._fit.values + size * step) for size in within]
        return dict.fromkeys(sizes) | dict(zip(within, side_by_side(tasks, self._workers), strict=True))

    def reaches(self, step: Array, size: float) -> bool:
        """Whether no limit lies within a step of a size."""
        return all(self._is_within(self._fit.values + sign * size * step) for sign in (1, -1))

    def _is_within(self, values: Array) -> bool:
        low, high = self._low_high
        return bool((values >= low).all() and (values <= high).all())

    def _cost(self, values: Array) -> float | None:
        """With values (p,); None where they cannot be simulated."""
        model = self._fit.model
        try:
            outputs = model.outputs(values)
        except SimulationError:
            return None
        residual = model.measured_outputs - outputs
        return sum_of_squares(residual, self._fit.deviation) + prior_squares(model.prior, values)
