"""The component of a ``model:``: what was measured among its outputs, and where its states start among its parameters.

    measured: {columns: {T: ...}}   -> output T, whatever its causality in the FMU
    identify: {T.start: {}}         -> parameter T.start: a start value that acts, else the state in model exchange

Both are found in the FMU's own description.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path

from fmu_didim.base.diagnostics import CATALOGUE, REMARK, Diagnostic
from fmu_didim.base.errors import InputError
from fmu_didim.case.document import MODEL, CaseDocument
from fmu_didim.case.files import NONE_GIVEN, table_and_time
from fmu_didim.case.in_memory import Memory
from fmu_didim.case.parts import component_of, controller_block
from fmu_didim.case.sources import ComponentSource, MeasuredFile
from fmu_didim.components import Component, FmuComponent
from fmu_didim.components.fmu.chosen import (
    all_variables,
    states_of,
    visible,
    with_outputs_too,
    with_start_value,
    with_state_start,
)
from fmu_didim.components.fmu.description import CO_SIMULATION, FLOAT_TYPES, MODEL_EXCHANGE, FmuDescription
from fmu_didim.components.fmu.reading import read_description
from fmu_didim.components.fmu.reuse.starting import find_start
from fmu_didim.components.parameter_names import name_parameters
from fmu_didim.components.variable_names import NEAREST, START, unknown
from fmu_didim.data.signals import Trajectory
from fmu_didim.data.tables import clock_column

EXCHANGE_CHOSEN = CATALOGUE(
    "exchange-chosen", REMARK, rank=92,
    meaning="The FMU of another tool has both interfaces and the case names none: its equations are integrated here, "
    "and not by its own solver, so that inputs go straight from row to row and answers are smooth in the parameters.",
    next_step="Nothing; for its own solver: model: {source: ..., interface: co-simulation}.",
)  # fmt: skip

SOLVERS = {"cvode": "CVode", "rk4": "RK4"}
"""What the integrators are called in a sentence."""


def model_component(document: CaseDocument, folder: Path, memory: Memory) -> Component:
    """The component of the model of a case, with all variables that were measured among its outputs.

    Raises:
        InputError, FmuError, BuildError: it cannot be read, has no such variable, or its start cannot be chosen.
    """
    assert document.model is not None
    source = _with_interface(document, folder)
    known = {name: value for name, value in source.parameters.items() if name.endswith(START)}
    source = source.model_copy(update={"parameters": {k: v for k, v in source.parameters.items() if k not in known}})
    component = component_of(source, folder, controller_block, objects=memory.objects, si_units=False)
    component = with_outputs(component, measured_variables(document, folder, component, memory.signals))
    identified = {entry.parameter or name: f"identify.{name}" for name, entry in (document.identify or {}).items()}
    component = with_starts(component, {**dict.fromkeys(known, "model.parameters"), **identified})
    return component.with_parameters(known) if known else component


def _with_interface(document: CaseDocument, folder: Path) -> ComponentSource:
    """The source with the interface and the integrator that the case leaves open: how stiff it is, nobody has said."""
    assert document.model is not None
    source = document.model
    if source.interface is not None:
        return source
    named = source.source or ""
    update = {} if "solver" in source.model_fields_set else {"solver": "cvode"}
    if named.endswith(".fmu") and _is_integrated_here(read_description(folder / named), document):
        update["interface"] = MODEL_EXCHANGE
    return source.model_copy(update=update)


def _is_integrated_here(fmu: FmuDescription, document: CaseDocument) -> bool:
    """Whether an FMU with both interfaces is integrated here. Not one that this package has exported, whose solver
    takes the steps that its equations ask for, unless the case states an integrator or asks where a state starts."""
    if fmu.interface(MODEL_EXCHANGE) is None or fmu.interface(CO_SIMULATION) is None or document.model is None:
        return False
    sought = [entry.parameter or name for name, entry in (document.identify or {}).items()]
    asks = any(name.endswith(START) for name in (*document.model.parameters, *sought))
    return asks or "solver" in document.model.model_fields_set or not fmu.is_own


def interface_told(document: CaseDocument, component: Component) -> tuple[Diagnostic, ...]:
    """What is said where an interface was chosen that the case leaves open."""
    assert document.model is not None
    if document.model.interface is not None or not isinstance(component, FmuComponent):
        return ()
    if not _is_integrated_here(component.fmu, document):
        return ()
    solver = SOLVERS[component.solver]
    text = f"{component.path.name} is run in model exchange, by {solver}; it could be run in co-simulation, too."
    return (Diagnostic(EXCHANGE_CHOSEN, text, MODEL),)


def measured_variables(
    document: CaseDocument, folder: Path, component: Component, signals: Mapping[str, Trajectory] = NONE_GIVEN
) -> Mapping[str, str]:
    """Name of each variable that the case says was measured -> where it says so; of files without ``columns`` those
    columns that have the name of a variable."""
    found: dict[str, str] = {}
    for label, run in document.runs.items():
        for file in run.measured_files:
            names = file.signals or tuple(file.columns) or _columns_of(file, folder, component, signals)
            found |= dict.fromkeys(names, f"{label}: measured: {file.file}")
    return found


def _columns_of(
    file: MeasuredFile, folder: Path, component: Component, signals: Mapping[str, Trajectory]
) -> tuple[str, ...]:
    if not isinstance(component, FmuComponent):
        return ()
    table, time = table_and_time(file, folder, signals)
    clock = clock_column(table, time, ())
    names = {name: table.find(name) for name in visible(component)}
    return tuple(name for name, column in names.items() if column is not None and column != clock)


def with_outputs(component: Component, wanted: Mapping[str, str]) -> Component:
    """The component with these variables among its outputs; ``wanted``: name -> where it is named.

    Raises:
        InputError: it has no such variable, or one that does not follow from its equations.
    """
    is_fmu = isinstance(component, FmuComponent)
    outputs = [v.name for v in component.outputs]
    known = list(visible(component)) if isinstance(component, FmuComponent) else outputs
    for name, where in wanted.items():
        if name in known or name in outputs:
            continue
        if isinstance(component, FmuComponent):
            _refuse_other_kinds(component, name, where)
        raise unknown(f"{'variable' if is_fmu else 'output'} of the model", name, known, where=where)
    return with_outputs_too(component, wanted, si_units=False) if isinstance(component, FmuComponent) else component


def _refuse_other_kinds(component: FmuComponent, name: str, where: str) -> None:
    """Raise InputError where the name is that of a variable that cannot have been measured."""
    own = next((v for v in all_variables(component) if name == v.name or name in v.element_names()), None)
    if own is None:
        return
    if own.shape and name == own.name:
        raise InputError(
            "This variable is an array; its elements are measured one by one.", where=where, got=name,
            valid=own.element_names(), next_step=f"Name its elements: columns: {{'{own.element_names()[0]}': ...}}.",
        )  # fmt: skip
    raise InputError(
        f"This variable of the model is {'an input' if own.causality == 'input' else f'a {own.causality}'} of the type "
        f"{own.type}, which does not follow from its equations.", where=where, got=name,
        valid="variables that the model computes", next_step="Give what drove the model under inputs:, and what its "
        "parameters are under identify: or model: {parameters: ...}.",
    )  # fmt: skip


def with_starts(component: Component, wanted: Mapping[str, str]) -> Component:
    """The component with a parameter for each of these names that ends in ``.start`` and is not one yet: where that
    variable starts. ``wanted``: name -> where it is named.

    Raises:
        InputError: it has no such variable, or its start cannot be chosen, and why.
    """
    for key, where in wanted.items():
        if not (isinstance(component, FmuComponent) and key.endswith(START)):
            continue
        if all(key != v.name for v in component.parameters):
            component = _with_start(component, key, key.removesuffix(START), where)
    return component


def _with_start(component: FmuComponent, key: str, name: str, where: str) -> FmuComponent:
    if name not in visible(component):
        raise unknown("variable of the model", name, visible(component), where=where)
    extended = with_start_value(component, name, si_units=False)
    trial = with_outputs_too(extended or component, [name], si_units=False)
    found = find_start(trial, name, can_be_set=extended is not None)
    if extended is not None and found.acts:
        promoted = name_parameters(extended, {key: name})
        assert isinstance(promoted, FmuComponent)
        return promoted.with_parameters({key: found.value}) if found.value != extended.start_values[name] else promoted
    states = states_of(component)
    if component.interface.kind == MODEL_EXCHANGE and name in states:
        return with_state_start(component, key, name, found.value, si_units=False)
    raise InputError(
        f"The start of '{name}' cannot be chosen: {_why(component, name, found.reason, states)}.", where=where, got=key,
        valid=", ".join(f"{state}{START}" for state in states) if name not in states else "",
        next_step=_instead(component, name in states),
    )  # fmt: skip


def _why(component: FmuComponent, name: str, reason: str, states: Collection[str]) -> str:
    if component.interface.kind == MODEL_EXCHANGE and states:
        return f"it is no continuous state, and {reason}"
    return reason


def _instead(component: FmuComponent, is_state: bool) -> str:
    others = ", ".join(v.name for v in component.parameters[:NEAREST])
    step = "Identify the parameter that sets it in the initial equations of the model"
    step += f", if one does (parameters: {others}, ...)" if len(component.parameters) > NEAREST else f" ({others})"
    if is_state and component.fmu.interface(MODEL_EXCHANGE) is not None:
        step = f"Run the FMU in model exchange: model: {{source: ..., interface: {MODEL_EXCHANGE}}}. Or i{step[1:]}"
    return f"{step}."


def whole_numbers(model: Component) -> frozenset[str]:
    """The inputs of a model that are no real numbers, so that nothing lies between their rows."""
    if not isinstance(model, FmuComponent):
        return frozenset()
    pairs = zip(model.inputs, model.input_types, strict=True)
    return frozenset(v.name for v, kind in pairs if kind not in FLOAT_TYPES)
