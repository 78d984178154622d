"""What effects outside the torque balance have in common: all their parameters enter nonlinearly."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from fmu_didim.effects.base import Effect


class NonlinearEffect(Effect):
    """An effect whose parameters are no amplitudes of columns; :meth:`search` gives a grid for each of them.

    Each parameter has its value in ``neutral``.
    """

    is_linear: ClassVar[bool] = False
    neutral: ClassVar[Mapping[str, float]]
