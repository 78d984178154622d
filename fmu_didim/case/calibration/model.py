"""The component of a ``model:``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from fmu_didim.base.errors import UnknownNameError
from fmu_didim.case.document import CaseDocument
from fmu_didim.case.memory import Memory
from fmu_didim.case.parts import component_of, controller_block
from fmu_didim.components import Component


def model_component(document: CaseDocument, folder: Path, memory: Memory) -> Component:
    """The component of the model of a case, with all variables that were measured among its outputs.

    Raises:
        InputError, FmuError, BuildError: it cannot be read; UnknownNameError: it has no such variable.
    """
    assert document.model is not None
    source = document.model
    if source.interface is None and "solver" not in source.model_fields_set:
        source = source.model_copy(update={"solver": "cvode"})  # how stiff it is, nobody has said
    component = component_of(source, folder, controller_block, objects=memory.objects, si_units=False)
    return with_outputs(component, _measured(document))


def _measured(document: CaseDocument) -> Mapping[str, str]:
    """Name of each variable that the case says was measured -> where it says so."""
    found: dict[str, str] = {}
    for label, run in document.runs.items():
        for file in run.measured_files:
            found |= dict.fromkeys(file.signals or tuple(file.columns), f"{label}: measured: {file.file}")
    return found


def with_outputs(component: Component, wanted: Mapping[str, str]) -> Component:
    """The component with these variables among its outputs; ``wanted``: name -> where it is named."""
    outputs = {v.name for v in component.outputs}
    for name, where in wanted.items():
        if name not in outputs:
            raise UnknownNameError("output of the model", name, outputs, where=where)
    return component


def at_once(model: Component) -> frozenset[str]:
    """The inputs of a model that are handed over as they are at the tick: all where it follows ramps, else those that
    some output follows at once, as far as it says so, and all where it does not."""
    known = model.feedthrough()
    if known is None or model.follows_ramps:
        return frozenset(v.name for v in model.inputs)
    return frozenset(name for _, name in known)
