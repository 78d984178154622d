"""Units of FMU variables and their conversion to the SI units used inside.

Source: "Functional Mock-up Interface", version 2.0, section 2.2.2; version 3.0, section 2.4.3:
value in base units = factor * value + offset, with the exponents of kg, m, s, A, K, mol, cd and rad.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

BASE_UNITS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
Exponents = tuple[int, ...]


@dataclass(frozen=True)
class UnitDefinition:
    """What a unit is in SI base units.

    Attributes:
        exponents: of :data:`BASE_UNITS`.
        factor, offset: value in base units = factor * value + offset.
    """

    exponents: Exponents
    factor: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class Conversion:
    """From an FMU's own unit to the unit shown: shown = factor * own + offset."""

    unit: str
    factor: float = 1.0
    offset: float = 0.0

    @property
    def is_identity(self) -> bool:
        """Whether nothing has to be computed."""
        return self.factor == 1.0 and self.offset == 0.0

    def to_shown(self, own: float) -> float:
        """A value of the FMU in the unit shown."""
        return own if self.is_identity else self.factor * own + self.offset

    def to_own(self, shown: float) -> float:
        """A value in the unit shown in the unit of the FMU."""
        return shown if self.is_identity else (shown - self.offset) / self.factor


def _definition(factor: float = 1.0, offset: float = 0.0, **exponents: int) -> UnitDefinition:
    return UnitDefinition(tuple(exponents.get(name, 0) for name in BASE_UNITS), factor, offset)


_TURN = 2 * math.pi
_SYMBOLS: dict[str, UnitDefinition] = {
    **{name: _definition(**{name: 1}) for name in BASE_UNITS},
    "1": _definition(),
    "g": _definition(1e-3, kg=1),
    "N": _definition(kg=1, m=1, s=-2),
    "J": _definition(kg=1, m=2, s=-2),
    "W": _definition(kg=1, m=2, s=-3),
    "Pa": _definition(kg=1, m=-1, s=-2),
    "Hz": _definition(s=-1),
    "C": _definition(s=1, A=1),
    "V": _definition(kg=1, m=2, s=-3, A=-1),
    "Ohm": _definition(kg=1, m=2, s=-3, A=-2),
    "F": _definition(kg=-1, m=-2, s=4, A=2),
    "H": _definition(kg=1, m=2, s=-2, A=-2),
    "Wb": _definition(kg=1, m=2, s=-2, A=-1),
    "T": _definition(kg=1, s=-2, A=-1),
    "min": _definition(60.0, s=1),
    "h": _definition(3600.0, s=1),
    "deg": _definition(math.pi / 180, rad=1),
    "rev": _definition(_TURN, rad=1),
    "rpm": _definition(_TURN / 60, rad=1, s=-1),
    "degC": _definition(1.0, 273.15, K=1),
}
_PREFIXED = ("g", "m", "s", "A", "N", "J", "W", "Pa", "Hz", "V", "Ohm", "F", "H", "rad")
_PREFIXES = {"u": 1e-6, "m": 1e-3, "c": 1e-2, "k": 1e3, "M": 1e6}
_FACTOR = re.compile(r"([A-Za-z]+|1)\^?([+-]?\d+)?")

# The name under which a value is shown that had to be converted.
_SHOWN: dict[Exponents, str] = {
    _d.exponents: _name
    for _name, _d in {
        "rad": _definition(rad=1),
        "rad/s": _definition(rad=1, s=-1),
        "rad/s2": _definition(rad=1, s=-2),
        "m": _definition(m=1),
        "m/s": _definition(m=1, s=-1),
        "m/s2": _definition(m=1, s=-2),
        "m2": _definition(m=2),
        "s": _definition(s=1),
        "Hz": _definition(s=-1),
        "kg": _definition(kg=1),
        "kg.m": _definition(kg=1, m=1),
        "kg.m2": _definition(kg=1, m=2),
        "N": _definition(kg=1, m=1, s=-2),
        "N.m": _definition(kg=1, m=2, s=-2),
        "N/m": _definition(kg=1, s=-2),
        "N.s/m": _definition(kg=1, s=-1),
        "N.m/rad": _definition(kg=1, m=2, s=-2, rad=-1),
        "N.m.s/rad": _definition(kg=1, m=2, s=-1, rad=-1),
        "N.m/A": _definition(kg=1, m=2, s=-2, A=-1),
        "N/A": _definition(kg=1, m=1, s=-2, A=-1),
        "W": _definition(kg=1, m=2, s=-3),
        "Pa": _definition(kg=1, m=-1, s=-2),
        "A": _definition(A=1),
        "V": _definition(kg=1, m=2, s=-3, A=-1),
        "Ohm": _definition(kg=1, m=2, s=-3, A=-2),
        "H": _definition(kg=1, m=2, s=-2, A=-2),
        "K": _definition(K=1),
    }.items()
}


def parse_unit(unit: str) -> UnitDefinition | None:
    """What a unit string means; None if it is not known or may mean two things.

    Syntax as in FMI and Modelica: factors ``symbol[exponent]`` joined by ``.``, at most one ``/`` followed by one
    factor or by several in parentheses: ``kg.m2``, ``mN.m``, ``deg/s``, ``W/(m2.K)``.
    """
    numerator, slash, denominator = unit.replace("*", ".").replace("°", "deg").partition("/")
    if denominator.startswith("(") and denominator.endswith(")"):
        denominator = denominator[1:-1]
    elif "." in denominator:
        return None
    total, scale = [0] * len(BASE_UNITS), 1.0
    parts = [(numerator, 1), (denominator, -1)] if slash else [(numerator, 1)]
    for part, sign in parts:
        for text in part.split("."):
            match = _FACTOR.fullmatch(text)
            symbol = _symbol(match[1]) if match else None
            if match is None or symbol is None:
                return None
            if symbol.offset:
                return symbol if unit == text and not match[2] else None
            power = sign * int(match[2] or 1)
            total = [old + power * e for old, e in zip(total, symbol.exponents, strict=True)]
            scale *= symbol.factor**power
    return UnitDefinition(tuple(total), scale)


def _symbol(name: str) -> UnitDefinition | None:
    known = _SYMBOLS.get(name)
    if known is not None:
        return known
    if name[:1] in _PREFIXES and name[1:] in _PREFIXED:
        base = _SYMBOLS[name[1:]]
        return UnitDefinition(base.exponents, _PREFIXES[name[0]] * base.factor)
    return None


def conversion(unit: str, definitions: Mapping[str, UnitDefinition]) -> Conversion:
    """How values of a unit are shown: in SI if the unit is a multiple of an SI unit, else as they are.

    The FMU's own definition of the unit counts; only where it has none, the meaning of the string.
    """
    own, named = definitions.get(unit), parse_unit(unit) if unit else None
    if own is None:
        found = named
    elif named is not None and _without_angle(named) == _without_angle(own) and own.offset == named.offset:
        found = named  # tools leave rad out of the exponents; the name tells an angle from a number
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
