"""Units of the variables of an exported block; FMI 2.0 and 3.0 write them alike.

Source: "Functional Mock-up Interface", version 2.0, section 2.2.2; version 3.0, section 2.4.3.
"""

from __future__ import annotations

import re
from xml.etree import ElementTree as ET

from fmu_didim.data.units import parse_unit
from fmu_didim.dynamics.block import Block


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
        known = parse_unit(unit)
        if known is not None:
            attributes = {name: str(power) for name, power in known.powers.items()}
            attributes |= {"factor": repr(known.factor)} if known.factor != 1.0 else {}
            attributes |= {"offset": repr(known.offset)} if known.offset else {}
            ET.SubElement(element, "BaseUnit", attributes)
