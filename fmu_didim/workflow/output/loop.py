"""The loop of a case as results hold it: its components with the sources that the case names."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fmu_didim.base.documents import load_yaml
from fmu_didim.case import Case


def described_loop(case: Case, loop: Mapping[str, Any]) -> dict[str, Any]:
    """The description of a system (``System.describe()``) with the sources that the case names."""
    components = {name: dict(described) for name, described in loop["components"].items()}
    if case.document.system is not None:
        for described in components.values():
            described["archive"] = case.document.system.source
    else:
        for name, part in case.document.parts.items():
            described = {"source": part.source or case.document.robot}
            if name != case.document.plant_name and part.source is not None and part.source.endswith((".yaml", ".yml")):
                described["law"] = load_yaml(case.folder / part.source).get("law")
            components[name] = {**described, **components[name]}
    return {**loop, "components": components}
