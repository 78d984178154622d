"""From a ``.ssp`` archive to a system that runs."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import cast, get_args

from fmu_didim.base.errors import FmuError, InputError, UnknownNameError
from fmu_didim.components import Component, FmuComponent, load_fmu
from fmu_didim.cosim import Connection, System
from fmu_didim.cosim.system import REFERENCE, LoopTreatment
from fmu_didim.data.signals import Variable
from fmu_didim.ssp.archive import Archive, open_archive
from fmu_didim.ssp.document import STRUCTURE, Loop, Node, Place, Structure, free_name
from fmu_didim.ssp.parameters import Bindings
from fmu_didim.ssp.parse import fmu_facts, parse_structure
from fmu_didim.ssp.transform import Unit, transforming_component
from fmu_didim.ssp.wiring import Net, build_net, flat_name


def read_ssp(path: Path | str, *, step_size: float | None = None, strict: bool = True) -> System:
    """The system of the archive's SystemStructure.ssd, with the values of its parameter bindings applied.

    * An input connector of the root system becomes the column ``reference.<name>``, in the connector's unit.
    * Systems inside systems are flattened: component ``c`` of system ``s`` is named ``s_c``.
    * Units are converted where both sides state one, unless suppressUnitConversion says no; then linear
      transformations act. A factor becomes the gain of the connection; an offset becomes a small component
      of its own directly before the one it feeds.
    * Later bindings win over earlier ones, those of systems over those of their elements. Values bound to
      inputs are their start values; one of a connector to which nothing is connected goes nowhere, which is logged.
    * Prefixes of the standard that a file uses without declaring them are taken for the standard's, which is logged.
    * Order, delays and step are those of the annotation ``org.fmu-didim.loop``. Without it the order is
      that of appearance, but components fed by an input of the root system come first: the controller sees
      the reference and acts before the plant moves. There is no delay, and the step is that of an annotation of
      OMSimulator or the Open Simulation Platform, else the step size that the first component in that order states in
      its default experiment, if it states one.
    * Connections to outputs of the root system are checked and then dropped: all outputs are recorded anyway.

    Args:
        path: the archive.
        step_size: communication step in s, instead of what the archive says.
        strict: refuse values bound to names that do not exist, which the standard says to ignore.

    Raises:
        InputError: the archive is unsafe, incomplete, or says something that a System cannot express.
        FmuError: one of its FMUs cannot be loaded.

    Source: "System Structure and Parameterization", versions 1.0 and 2.0, which share their namespaces.
    """
    archive = open_archive(Path(path))
    structure = parse_structure(archive)
    where = f"{archive.path}: {STRUCTURE}"
    solvers = structure.loop.solvers if structure.loop is not None else {}
    fmus: dict[Place, FmuComponent] = {}
    units: dict[Node, Unit | None] = {}
    steps: dict[str, float] = {}
    for own, element in structure.elements.items():
        if element.source is None:
            continue
        name = flat_name(own)
        if name == REFERENCE or name in map(flat_name, fmus):
            raise InputError(
                "This name of a component is taken.", where=where, got=f"{'.'.join(own)} as {name}",
                next_step="Rename one of them: dots and underscores are alike here.",
            )  # fmt: skip
        fmus[own] = _load(archive, own, element.source, element.interface, *solvers.get(name, ("rk4", None)))
        known, step = fmu_facts(fmus[own].path)
        scope = {**structure.units, **known}
        for v in (*fmus[own].inputs, *fmus[own].outputs, *fmus[own].parameters):
            units[own, v.name] = scope.get(v.unit, Unit(v.unit)) if v.unit else None
        if step is not None:
            steps[name] = step
    if not fmus:
        raise InputError(
            "The system has no components.", where=where, next_step="Add a component to it, or name another archive."
        )
    net = build_net(structure, units, where=where)
    _check_connectors(net, fmus)
    values = Bindings(net, fmus, units, strict).values()
    components: dict[str, Component] = {flat_name(own): _with_values(fmus[own], values[own], net) for own in fmus}
    return _system(structure, net, components, steps, step_size, where)


def _load(
    archive: Archive, path: Place, source: str, interface: str | None, solver: str, substeps: int | None
) -> FmuComponent:
    where = f"Component {'.'.join(path)}"
    file = archive.file(source, where=where)
    try:  # values and units of an SSP are those of the FMU
        return load_fmu(file, si_units=False, interface=interface, solver=solver, substeps=substeps)
    except FmuError as error:
        where = f"{archive.path}: {where}, {source}"
        raise FmuError(error.what, where=where, got=error.got, valid=error.valid, next_step=error.next_step) from error


def _check_connectors(net: Net, fmus: Mapping[Place, FmuComponent]) -> None:
    """Each Real connector of a component must be a variable of its FMU."""
    for (path, name), port in net.ports.items():
        if path in fmus and port.type == "Real":
            fmu, where = fmus[path], f"{net.where}, Component {'.'.join(path)}"
            groups = {
                "input": [v.name for v in fmu.inputs],
                "output": [v.name for v in fmu.outputs],
                "parameter": [*(v.name for v in fmu.parameters), *fmu.start_values],
            }
            if port.kind in groups and name not in groups[port.kind]:
                valid = groups[port.kind]
                raise UnknownNameError(f"{port.kind} of the FMU", name, valid, where=f"{where}, Connector '{name}'")
            if port.kind == "inout":
                raise InputError(
                    "A component has no connectors of kind inout.", where=where, got=name,
                    next_step="Make it an input or an output.",
                )  # fmt: skip


def _with_values(fmu: FmuComponent, values: Mapping[str, float], net: Net) -> FmuComponent:
    parameters = {*(v.name for v in fmu.parameters), *fmu.start_values}
    inputs = {v.name for v in fmu.inputs}
    fmu = fmu.with_parameters({name: value for name, value in values.items() if name in parameters})
    started = tuple(v.starting_at(values.get(v.name, v.start)) for v in fmu.inputs)
    fmu = fmu.with_names(started, fmu.outputs)
    options = {name: value for name, value in values.items() if name not in parameters | inputs}
    for name, value in options.items():
        if value != int(value):
            raise InputError(
                f"The parameter '{name}' takes integers.", where=f"{net.where}, {fmu.path.name}", got=value,
                next_step="Give it a whole number.",
            )  # fmt: skip
    if options:
        fmu = replace(fmu, options={**fmu.options, **{name: int(value) for name, value in options.items()}})
    return fmu


def _system(
    structure: Structure,
    net: Net,
    components: dict[str, Component],
    steps: Mapping[str, float],
    step_size: float | None,
    where: str,
) -> System:
    names = {path: flat_name(path) for path, element in net.elements.items() if element.source is not None}
    connections: list[Connection] = []
    before: dict[str, list[str]] = {name: [] for name in components}
    inserted: dict[str, Component] = {}
    fed = set()
    for end in net.inbound:  # in the order of the file
        if end[0] not in names:
            continue
        owner, target = names[end[0]], f"{names[end[0]]}.{end[1]}"
        chain = net.upstream(end)
        origin, variable = chain[0].start
        if origin in names and net.ports[end].kind != "input":
            raise InputError(
                "A parameter cannot follow an output.", where=chain[-1].where,
                next_step="Connect the output to an input, or bind a value to the parameter.",
            )  # fmt: skip
        if origin not in names and (origin or net.ports[origin, variable].kind != "input"):
            continue  # what was bound there is a value or a start value of the component already
        if origin not in names:
            fed.add(owner)
        source = f"{names[origin]}.{variable}" if origin in names else f"{REFERENCE}.{variable}"
        total = net.transformation(chain)
        if total.offset == 0:
            connections.append(Connection(source, target, total.factor))
            continue
        name = free_name(re.sub(r"\W", "_", target) + "_transformation", "", {*components, *inserted, REFERENCE})
        inserted[name] = transforming_component(total)
        before[owner].append(name)
        connections += [Connection(source, f"{name}.u"), Connection(f"{name}.y", target)]
    loop = structure.loop or _guess(components, fed, steps, structure.step_size)
    _check_loop(loop, components, where)
    size = loop.step_size if step_size is None else step_size
    if not size > 0:
        raise InputError("The archive states no communication step.", where=where, next_step="Give step_size.")
    order = tuple(part for name in loop.order for part in (*before[name], name))
    system = System(
        {**components, **inserted}, tuple(connections), order, size, loop.delays, loop.jacobi,
        loop.every, loop.substeps, loop.after_step, cast(LoopTreatment, loop.algebraic_loops),
    )  # fmt: skip
    return _with_roles(system, loop, where)


def _guess(components: Mapping[str, Component], fed: set[str], steps: Mapping[str, float], noted: float | None) -> Loop:
    order = tuple(sorted(components, key=lambda name: name not in fed))
    return Loop(noted or next((steps[name] for name in order if name in steps), 0.0), order)


def _check_loop(loop: Loop, components: Mapping[str, Component], where: str) -> None:
    if sorted(loop.order) != sorted(components):
        raise InputError(
            "The annotation of the loop does not fit the components.", where=where, got=loop.order, valid=components,
            next_step="Name each component once in the annotation, or remove it.",
        )  # fmt: skip
    if loop.algebraic_loops not in get_args(LoopTreatment):
        raise InputError(
            "The annotation of the loop treats algebraic loops in an unknown way.", where=where,
            got=loop.algebraic_loops, valid=get_args(LoopTreatment),
            next_step="Take one of these, or leave the annotation out.",
        )  # fmt: skip


def _with_roles(system: System, loop: Loop, where: str) -> System:
    """Variables that the loop names otherwise than their FMU does."""
    roles = {f"{name}.{variable}": f"{name}.{role}" for (name, variable), role in loop.roles.items()}
    if not roles:
        return system

    def renamed(name: str, variables: tuple[Variable, ...]) -> tuple[Variable, ...]:
        return tuple(replace(v, name=loop.roles.get((name, v.name), v.name)) for v in variables)

    for name, component in system.components.items():
        known = [v.name for v in (*component.inputs, *component.outputs)]
        for owner, variable in loop.roles:
            if owner == name and variable not in known:
                raise UnknownNameError("variable", variable, known, where=f"{where}, annotation of the loop")
    return replace(
        system,
        components={n: c.with_names(renamed(n, c.inputs), renamed(n, c.outputs)) for n, c in system.components.items()},
        connections=tuple(
            replace(c, source=roles.get(c.source, c.source), target=roles.get(c.target, c.target))
            for c in system.connections
        ),
    )
