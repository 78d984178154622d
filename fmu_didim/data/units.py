"""Units by their names: what they are in SI base units.

Source: "Functional Mock-up Interface", version 2.0, section 2.2.2; version 3.0, section 2.4.3:
value in base units = factor * value + offset, with the exponents of kg, m, s, A, K, mol, cd and rad.
"""

from __future__ import annotations

import logging
import math
import re
from dataclasses import dataclass
from functools import cache
from typing import Any

from fmu_didim.base.errors import loading

BASE_UNITS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
Exponents = tuple[int, ...]
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class UnitDefinition:
    """A unit in SI base units.

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


@dataclass(frozen=True)
class DisplayUnit:
    """A unit in which a tool shows the values of another one: value there = factor * value + offset.

    Attributes:
        name: such as ``degC``.
    """

    name: str
    factor: float = 1.0
    offset: float = 0.0


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
    """The unit of a string; None if it is not known or ambiguous.

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
    if name not in _SYMBOLS and name[:1] in _PREFIXES and name[1:] in _PREFIXED:
        base = _SYMBOLS[name[1:]]
        return UnitDefinition(base.exponents, _PREFIXES[name[0]] * base.factor)
    return _SYMBOLS.get(name)


# Words of drives and loggers that a library of units does not know, or takes for something else: Nm is no nanometre,
# U/min no enzyme unit a minute.
_WORDS = {
    "Nm": "N*m", "mNm": "mN*m", "kNm": "kN*m", "Ncm": "N*cm", "Nmm": "N*mm", "U/min": "rpm", "Umdr/min": "rpm",
    "Umdr": "turn", "U": "turn", "rev": "turn", "revs": "turn", "Ohm": "ohm", "sec": "s", "msec": "ms", "usec": "us",
    "Sek": "s", "Sekunden": "s", "kp": "kgf", "oz-in": "ozf*inch", "ozin": "ozf*inch", "lb-in": "lbf*inch",
    "lb-ft": "lbf*ft", "lbft": "lbf*ft", "ft-lb": "lbf*ft", "in-lb": "lbf*inch",
}  # fmt: skip
_TWO_MEANINGS = frozenset({"grad", "Grad", "GRAD", "g", "in-oz"})
"""Grad is a degree in German and a 400th of a turn elsewhere; g is a gram and a gravity."""
_SHORT = re.compile(r"(?!.*\d\d\d)[A-Za-z0-9µμΩ°%‰^*/.()\- ]{1,30}")
"""What may be a unit at all: a parser is not asked of long texts, nor of powers with three digits."""


@cache
def known_unit(text: str) -> UnitDefinition | None:
    """The unit of a text, as people write it: ``°``, ``Nm``, ``µm``, ``in``, ``U/min``, ``deg/s^2``.

    As :func:`parse_unit`, and beyond it all units of ``pint``. None if it is not known or ambiguous.
    """
    text = text.strip().replace("²", "2").replace("³", "3").replace("·", ".").replace("⋅", ".")
    if text in _TWO_MEANINGS or not _SHORT.fullmatch(text):
        return None
    return parse_unit(text) or _by_pint(_WORDS.get(text) or _pint_syntax(text))


def _pint_syntax(text: str) -> str:
    """FMI's exponents and products as pint writes them: ``W/(m2.K)`` -> ``W/(m**2*K)``."""
    for word, meaning in _WORDS.items():
        text = re.sub(rf"(?<![A-Za-z]){re.escape(word)}(?![A-Za-z])", f"({meaning})", text)
    text = re.sub(r"(?<=[A-Za-zµ°])\^?(-?\d+)", r"**\1", text)
    return re.sub(r"(?<=\D)\.(?=\D)", "*", text).replace("°C", "degC").replace("°", "deg")


@cache
def _registry() -> Any:
    with loading("pint"):
        import pint

        return pint.UnitRegistry()


def _by_pint(text: str) -> UnitDefinition | None:
    registry = _registry()
    try:
        unit = registry.parse_units(text)
        factor, base = registry.get_base_units(unit)
    except Exception as error:  # noqa: BLE001  pint raises errors of many kinds, tokenize's and the parser's among them
        _log.debug("%s is not a unit: %s", text, error)
        return None
    powers = {str(name): power for name, power in base._units.items()}
    exponents = [powers.pop(_PINT_BASE[name], 0) for name in BASE_UNITS]
    if powers or any(power != int(power) for power in exponents):
        return None
    zero = registry.Quantity(0, unit)
    offset = 0.0 if zero._is_multiplicative else float(zero.to_base_units().m)
    return UnitDefinition(tuple(int(power) for power in exponents), float(factor), offset)


_PINT_BASE = dict(
    zip(BASE_UNITS, ("kilogram", "meter", "second", "ampere", "kelvin", "mole", "candela", "radian"), strict=True)
)
