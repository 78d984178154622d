"""Units of the variables of an exported block; FMI 2.0 and 3.0 write them alike.

Source: "Functional Mock-up Interface", version 2.0, section 2.2.2; version 3.0, section 2.4.3.
"""

from __future__ import annotations

import math
import re
from xml.etree import ElementTree as ET

from fmu_didim.block import Block

Exponents = dict[str, int]

BASE_UNITS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
# Exponents in the order of BASE_UNITS, then the factor to the base units.
_SYMBOLS: dict[str, tuple[tuple[int, ...], float]] = {
    **{unit: (tuple(int(unit == other) for other in BASE_UNITS), 1.0) for unit in BASE_UNITS},
    "1": ((0,) * 8, 1.0),
    "N": ((1, 1, -2, 0, 0, 0, 0, 0), 1.0),
    "J": ((1, 2, -2, 0, 0, 0, 0, 0), 1.0),
    "W": ((1, 2, -3, 0, 0, 0, 0, 0), 1.0),
    "Pa": ((1, -1, -2, 0, 0, 0, 0, 0), 1.0),
    "Hz": ((0, 0, -1, 0, 0, 0, 0, 0), 1.0),
    "C": ((0, 0, 1, 1, 0, 0, 0, 0), 1.0),
    "V": ((1, 2, -3, -1, 0, 0, 0, 0), 1.0),
    "Ohm": ((1, 2, -3, -2, 0, 0, 0, 0), 1.0),
    "F": ((-1, -2, 4, 2, 0, 0, 0, 0), 1.0),
    "H": ((1, 2, -2, -2, 0, 0, 0, 0), 1.0),
    "Wb": ((1, 2, -2, -1, 0, 0, 0, 0), 1.0),
    "T": ((1, 0, -2, -1, 0, 0, 0, 0), 1.0),
    "deg": ((0, 0, 0, 0, 0, 0, 0, 1), math.pi / 180.0),
}
_FACTOR = re.compile(r"([A-Za-z]+|1)([+-]?\d+)?")


def base_unit(unit: str) -> tuple[Exponents, float] | None:
    """Exponents of the SI base units (and rad) of a unit, and the factor to them.

    Syntax as in FMI and Modelica: factors ``symbol[exponent]`` joined by ``.``, at most one ``/``
    followed by one factor or by several in parentheses: ``kg.m2``, ``N.m.s/rad``, ``W/(m2.K)``.

    Returns:
        The exponents that are not zero and the factor, or None if the unit is not known.
    """
    numerator, slash, denominator = unit.partition("/")
    if denominator.startswith("(") and denominator.endswith(")"):
        denominator = denominator[1:-1]
    elif "." in denominator:
        return None  # N/m.s may mean two things
    total, scale = [0] * len(BASE_UNITS), 1.0
    for part, sign in ((numerator, 1), (denominator, -1)):
        for text in part.split(".") if part or sign == 1 or slash else ():
            match = _FACTOR.fullmatch(text)
            if match is None or match[1] not in _SYMBOLS:
                return None
            exponents, factor = _SYMBOLS[match[1]]
            power = sign * int(match[2] or 1)
            total = [sum_ + power * e for sum_, e in zip(total, exponents, strict=True)]
            scale *= factor**power
    return {name: e for name, e in zip(BASE_UNITS, total, strict=True) if e}, scale


def derivative_unit(unit: str) -> str:
    """The unit of the derivative of a variable: ``rad/s`` of ``rad``; empty if it has no plain name."""
    if not unit:
        return ""
    match = re.fullmatch(r"([^/()]+)/s(\d*)", unit)
    if match:
        return f"{match[1]}/s{int(match[2] or 1) + 1}"
    return f"{unit}/s" if "/" not in unit else ""


def add_units(root: ET.Element, block: Block, *, time: bool = False) -> None:
    """Append the element ``UnitDefinitions`` with all units of the variables of a block, if there are any.

    Args:
        root: the element to append to.
        block: the block.
        time: the file has a variable for the time too.
    """
    units = {v.unit for v in (*block.inputs, *block.outputs, *block.states, *block.parameters)}
    if block.sample_time is None:
        units |= {derivative_unit(v.unit) for v in block.states}
    if time:
        units.add("s")
    units.discard("")
    if not units:
        return
    definitions = ET.SubElement(root, "UnitDefinitions")
    for unit in sorted(units):
        element = ET.SubElement(definitions, "Unit", name=unit)
        known = base_unit(unit)
        if known is not None:
            exponents, factor = known
            attributes = {name: str(exponent) for name, exponent in exponents.items()}
            ET.SubElement(element, "BaseUnit", attributes | ({"factor": repr(factor)} if factor != 1.0 else {}))
