"""The units in which the tool that made an FMU shows its variables.

Source: "Functional Mock-up Interface", version 2.0, 2.2.2, and version 3.0, 2.4.3: value in the display unit =
factor * value + offset, without the offset where the variable is a difference (``relativeQuantity``).
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from fmu_didim.components.fmu.versions.base import TRUE
from fmu_didim.data.units import DisplayUnit


@dataclass(frozen=True)
class DisplayUnits:
    """Those that an FMU defines.

    Attributes:
        known: names of a unit and of a display unit of it -> that; no inverse ones (FMI 3.0: factor / value).
        differences: names of the variables that are differences, which FMPy does not read.
    """

    known: Mapping[tuple[str | None, str | None], DisplayUnit]
    differences: frozenset[str]

    @classmethod
    def of(cls, own: Any, root: ET.Element) -> DisplayUnits:
        """As FMPy and the file describe them."""
        inverse = {
            (unit.get("name"), d.get("name"))
            for unit in root.iter("Unit")
            for d in unit.iter("DisplayUnit")
            if d.get("inverse") in TRUE
        }
        made = {
            (u.name, d.name): DisplayUnit(d.name, float(d.factor), float(d.offset))
            for u in own.unitDefinitions
            for d in u.displayUnits
        }
        variables = root.find("ModelVariables")
        differences = {
            variable.get("name", "")
            for variable in (variables if variables is not None else ())
            if any(one.get("relativeQuantity") in TRUE for one in (variable, *variable))
        }
        usable = {
            key: unit
            for key, unit in made.items()
            if key not in inverse and unit.factor and math.isfinite(unit.factor) and math.isfinite(unit.offset)
        }
        return cls(usable, frozenset(differences))

    def display(self, own: Any, unit: str) -> DisplayUnit | None:
        """In which a variable of this unit is shown, if that is another one."""
        declared = own.declaredType
        found = self.known.get((unit, own.displayUnit or (declared.displayUnit if declared else None)))
        if found is None:
            return None
        if own.name in self.differences or (declared is not None and declared.relativeQuantity):
            found = DisplayUnit(found.name, found.factor)
        return found if found != DisplayUnit(found.name) else None
