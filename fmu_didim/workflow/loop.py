"""The loop of a case as results hold it: its components with the sources that the case names."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fmu_didim.case import Case
from fmu_didim.documents import load_yaml


def described_loop(case: Case, loop: Mapping[str, Any]) -> dict[str, Any]:
    """The description of a system (``System.describe()``) with the sources that the case names."""
    components = {name: dict(known) for name, known in loop["components"].items()}
    if case.document.system is not None:
        for known in components.values():
            known["archive"] = case.document.system.source
    else:
        controller = case.document.controller.source if case.document.controller is not None else None
        for name, source in (("controller", controller), ("plant", case.document.plant.source)):
            known = {"source": source or case.document.robot}
            if name == "controller" and controller is not None and controller.endswith((".yaml", ".yml")):
                known["law"] = load_yaml(case.folder / controller).get("law")
            components[name] = {**known, **components[name]}
    return {**loop, "components": components}
