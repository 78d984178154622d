"""What effects outside the torque balance have in common: all their parameters enter nonlinearly."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

from fmu_didim.effects.base import Effect


class NonlinearEffect(Effect):
    """An effect whose parameters are no amplitudes of columns; :meth:`search` gives a grid for each of them.

    Class attributes:
        neutral: value of each parameter with which all is as without the effect; infinite where only a limit is.
        limits: parameter -> lowest and highest sensible value.
    """

    neutral: ClassVar[Mapping[str, float]]
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {}

    def clipped(self, name: str, value: float) -> float:
        """A value of a parameter moved into its limits."""
        low, high = self.limits.get(name, (-math.inf, math.inf))
        return min(max(value, low), high)

    def outside_limits(self, values: Mapping[str, float]) -> str:
        """Which of these values lie outside their limits, in words, or an empty string."""
        bad = [name for name, value in values.items() if self.clipped(name, value) != value]
        return "; ".join(f"{n} = {values[n]:g} must lie in {self.limits[n][0]:g} to {self.limits[n][1]:g}" for n in bad)
