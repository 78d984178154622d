"""The loop of a case as results hold it: its components with the sources that the case names."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fmu_didim.base.documents import load_yaml
from fmu_didim.case import Case
from fmu_didim.cosim.system import REFERENCE

INPUTS = "inputs"
"""What stands for the recorded inputs of a model in the description of its connections."""


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
    if case.data is not None:
        return _of_a_model(loop, components)
    return {**loop, "components": components}


def _of_a_model(loop: Mapping[str, Any], components: Mapping[str, Any]) -> dict[str, Any]:
    """What the simulation of a model alone is described by: its step, and where its inputs come from."""
    own = {name: dict(described) for name, described in components.items()}
    shown = {"order": list(own), "step_size_s": loop["step_size_s"]}
    if "ticks" in loop:
        shown["ticks"] = "at the instants of samples and inputs; step_size_s is nominal"
    connected = [text.replace(f" {REFERENCE}.", f" {INPUTS}.") for text in loop["connections"]]
    return {**shown, "outputs_after_step": loop["outputs_after_step"], "components": own, "connections": connected}


def described_estimator(case: Case) -> dict[str, Any]:
    """The estimator of a case and its options; a model alone starts from its own values, there being no reference."""
    described = dict(case.estimator.describe())
    if case.data is not None and described.get("start") == REFERENCE:
        described["start"] = "model"
    return described
