"""Units by their names: what they are in SI base units.

Source: "Functional Mock-up Interface", version 2.0, section 2.2.2; version 3.0, section 2.4.3:
value in base units = factor * value + offset, with the exponents of kg, m, s, A, K, mol, cd and rad.
"""

from __future__ import annotations

import math
import re
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

    @property
    def powers(self) -> dict[str, int]:
        """The exponents that are not zero, by base unit."""
        return {name: power for name, power in zip(BASE_UNITS, self.exponents, strict=True) if power}


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
