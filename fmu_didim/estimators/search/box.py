"""The box of the parameters that have bounds, and points drawn in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmu_didim.data.signals import Array
from fmu_didim.model.free_parameter import (
    DELAY,
    LOG,
    FreeParameter,
    FreeParameters,
    delay_parameter,
    log_shift_parameter,
)

DECADE = 10.0
"""[1] Ratio of positive bounds from which a parameter is drawn by its logarithm: its size is what is not known."""


@dataclass(frozen=True)
class Box:
    """The parameters that are searched.

    Attributes:
        place: (d,) of them among all; low, high: (d,) bounds; logarithmic: (d,) whether the logarithm is drawn.
        begin: (p,) where one start has all parameters.
    """

    place: NDArray[np.int64]
    low: Array
    high: Array
    logarithmic: NDArray[np.bool_]
    begin: Array

    @staticmethod
    def of(free: FreeParameters, begin: Array) -> Box:
        """Of free parameters, the others held at ``begin`` (p,)."""
        place = np.array([i for i, one in enumerate(free) if is_bounded(one)], dtype=np.int64)
        low, high = (limit[place] for limit in free.limits)
        with np.errstate(divide="ignore", invalid="ignore"):
            return Box(place, low, high, (low > 0) & (high >= DECADE * low), begin)

    def point(self, unit: Array) -> Array:
        """(p,) values at a point (d,) of the unit cube."""
        low, high = np.where(self.logarithmic, 1.0, self.low), np.where(self.logarithmic, 1.0, self.high)
        inside = low + unit * (high - low)
        logs = self.logarithmic
        inside[logs] = self.low[logs] * (self.high[logs] / self.low[logs]) ** unit[logs]
        values = self.begin.copy()
        values[self.place] = np.clip(inside, self.low, self.high)
        return values

    def drawn(self, count: int, seed: int) -> list[Array]:
        """``count`` points (p,) by a Latin hypercube."""
        from scipy.stats import qmc  # slow to import

        cube = qmc.LatinHypercube(self.place.size, seed=np.random.default_rng(seed)).random(count)
        return [self.point(unit) for unit in cube]


def is_bounded(parameter: FreeParameter) -> bool:
    """Whether a case gives a parameter two bounds; those that every delay and clock have are nobody's statement."""
    if not (np.isfinite(parameter.lowest) and np.isfinite(parameter.highest)) or parameter.is_held:
        return False
    usual = {DELAY: delay_parameter(0.0), LOG: log_shift_parameter()}.get(parameter.owner)
    return usual is None or (parameter.lowest, parameter.highest) != (usual.lowest, usual.highest)
