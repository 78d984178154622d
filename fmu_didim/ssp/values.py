"""Values of parameters as an SSV file, which tools of FMUs set in one go."""

from __future__ import annotations

from collections.abc import Mapping

from fmu_didim.data.units import parse_unit
from fmu_didim.ssp.transform import Unit
from fmu_didim.ssp.xml_text import values_set


def ssv_text(name: str, values: Mapping[str, tuple[float, str]]) -> str:
    """The SSV file of real parameters: name in the model -> value and unit, empty where it has none.

    Source: "System Structure and Parameterization", version 1.0, 5.
    """
    return values_set(name, {key: (value, _unit(unit)) for key, (value, unit) in values.items()})


def _unit(name: str) -> Unit | None:
    known = parse_unit(name) if name not in ("", "1") else None
    return None if known is None else Unit(name, known.exponents, known.factor, known.offset)
