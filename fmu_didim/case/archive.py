"""The loop of a case from an SSP archive."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from fmu_didim.case.document import CaseDocument
from fmu_didim.case.timing import delay_in_samples
from fmu_didim.components import rename
from fmu_didim.components.parameter_names import name_parameters
from fmu_didim.errors import UnknownNameError
from fmu_didim.master import System
from fmu_didim.master.system import REFERENCE
from fmu_didim.ssp import read_ssp


def loop_of_archive(document: CaseDocument, folder: Path) -> System:
    """The system of the archive, its plant and its inputs under the names of the case.

    Step, order and delay are those of the archive, where the case does not give its own in ``loop``.

    Raises:
        InputError, UnknownNameError, FmuError: the archive cannot be read, or lacks something that the case names.
    """
    assert document.system is not None
    loop, plant = document.loop, document.plant
    path = folder / document.system.source
    system = read_ssp(path, step_size=None if loop.rate_hz is None else 1.0 / loop.rate_hz)
    if plant.component not in system.components:
        raise UnknownNameError("component", plant.component, system.components, where=f"plant.component: {path}")
    component = system.components[plant.component]
    if plant.parameters:
        component = component.with_parameters(plant.parameters)
    component = name_parameters(component, plant.parameter_names)
    component = rename(component, inputs=plant.inputs, outputs=plant.outputs)
    new = {f"{plant.component}.{own}": f"{plant.component}.{role}" for role, own in plant.outputs.items()}
    fed = {f"{plant.component}.{own}": f"{plant.component}.{role}" for role, own in plant.inputs.items()}
    columns = _columns(system, document.system.inputs, path)
    system = replace(
        system,
        components={**system.components, plant.component: component},
        connections=tuple(
            replace(c, source=columns.get(c.source, new.get(c.source, c.source)), target=fed.get(c.target, c.target))
            for c in system.connections
        ),
    )
    if loop.model_fields_set & {"delay_samples", "delay_s"}:
        system = system.with_delay(plant.component, delay_in_samples(document, system.step_size))
    if "algorithm" in loop.model_fields_set:
        system = replace(system, jacobi=loop.algorithm == "jacobi")
    if "algebraic_loops" in loop.model_fields_set:
        system = replace(system, algebraic_loops=loop.algebraic_loops)
    return system


def _columns(system: System, inputs: Mapping[str, str], path: Path) -> dict[str, str]:
    """Input of the system -> column of the reference, both as sources of connections."""
    given = [c.source.removeprefix(f"{REFERENCE}.") for c in system.connections if c.source.startswith(f"{REFERENCE}.")]
    for name in inputs.values():
        if name not in given:
            raise UnknownNameError("input of the system", name, dict.fromkeys(given), where=f"system.inputs: {path}")
    return {f"{REFERENCE}.{own}": f"{REFERENCE}.{column}" for column, own in inputs.items()}
