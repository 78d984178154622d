"""Conversion of the units of FMU variables to the SI units used inside."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from fmu_didim.data.units import Exponents, UnitDefinition, parse_unit

_NAMES = (
    "rad", "rad/s", "rad/s2", "m", "m/s", "m/s2", "m2", "s", "Hz", "kg", "kg.m", "kg.m2", "N", "N.m", "N/m", "N.s/m",
    "N.m/rad", "N.m.s/rad", "N.m/A", "N/A", "W", "Pa", "A", "V", "Ohm", "H", "K",
)  # fmt: skip
_SHOWN = {known.exponents: name for name in _NAMES if (known := parse_unit(name)) is not None}
"""The name under which a value is shown that had to be converted."""


@dataclass(frozen=True)
class Conversion:
    """From an FMU's own unit to the unit shown: shown = factor * own + offset."""

    unit: str
    factor: float = 1.0
    offset: float = 0.0

    @property
    def is_identity(self) -> bool:
        """Whether values stay as they are."""
        return self.factor == 1.0 and self.offset == 0.0

    def to_shown(self, own: float) -> float:
        """A value of the FMU in the unit shown."""
        return own if self.is_identity else self.factor * own + self.offset

    def to_own(self, shown: float) -> float:
        """A value in the unit shown in the unit of the FMU."""
        return shown if self.is_identity else (shown - self.offset) / self.factor


def conversion(unit: str, definitions: Mapping[str, UnitDefinition]) -> Conversion:
    """How values of a unit are shown: in SI if the unit is a multiple of an SI unit, else as they are.

    The FMU's own definition of the unit counts; only where it has none, the meaning of the string.
    """
    own, named = definitions.get(unit), parse_unit(unit) if unit else None
    if own is None:
        found = named
    elif named is not None and _without_angle(named) == _without_angle(own) and own.offset == named.offset:
        found = named  # tools leave rad out of the exponents; only the name distinguishes an angle from a number
    else:
        found = own
    if found is None or (math.isclose(found.factor, 1.0, rel_tol=1e-15) and not found.offset):
        return Conversion(unit)
    shown = _SHOWN.get(found.exponents)
    if shown is None or not found.factor or not math.isfinite(found.factor) or not math.isfinite(found.offset):
        return Conversion(unit)
    factor = own.factor if own is not None else found.factor
    return Conversion(shown, factor, found.offset)


def _without_angle(definition: UnitDefinition) -> tuple[Exponents, float]:
    return definition.exponents[:-1], float(f"{definition.factor:.6e}")
