"""A system as an archive holds it: parts, values that were set, and connections in the terms of SSP."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from fmu_didim.base.errors import InputError
from fmu_didim.components import FmuComponent, load_fmu
from fmu_didim.components.fmu.description import MODEL_EXCHANGE
from fmu_didim.cosim import Connection, System
from fmu_didim.cosim.system import REFERENCE
from fmu_didim.ssp.parse import fmu_facts
from fmu_didim.ssp.transform import Affine, Unit, component_transformation


@dataclass(frozen=True)
class Part:
    """One FMU of the system.

    Attributes:
        fmu: as it was loaded from its file, with the FMU's own names and values.
        values: variable -> value that was set since; options: the same for Integer parameters.
        roles: own name -> name in the loop, where they differ.
        units: name -> unit of the FMU.
    """

    fmu: FmuComponent
    values: Mapping[str, float]
    options: Mapping[str, int]
    roles: Mapping[str, str]
    units: Mapping[str, Unit]

    def unit_name(self, name: str) -> str:
        """Name of the unit of a variable, by the variable's own name; empty if it has no unit."""
        variables = (*self.fmu.inputs, *self.fmu.outputs, *self.fmu.parameters)
        return next((v.unit for v in variables if v.name == name), "")

    def unit(self, name: str) -> Unit | None:
        """Unit of a variable; None if it has none or the FMU does not define it."""
        return self.units.get(self.unit_name(name))


@dataclass(frozen=True)
class Route:
    """A connection by the FMUs' own names; the element of the reference is None."""

    start: tuple[str | None, str]
    end: tuple[str, str]
    transformation: Affine


def parts(system: System) -> dict[str, Part]:
    """The FMUs of a system by name, in its order; components made by reading an SSP are left out.

    Raises:
        InputError: a component is no FMU, or its file has changed since it was loaded.
    """
    found: dict[str, Part] = {}
    for name in system.order:
        component = system.components[name]
        if component_transformation(component) is not None:
            continue
        if not isinstance(component, FmuComponent):
            raise InputError(
                f"The component '{name}' is not an FMU, and an SSP archive holds FMUs.", where="write_ssp",
                got=component.describe().get("kind"), valid="fmu",
                next_step=f"Give '{name}' as kind fmu in the case, or load_fmu(build_fmu(block)).",
            )  # fmt: skip
        own = load_fmu(
            component.path, si_units=False, interface=component.interface.kind, solver=component.solver,
            substeps=component.substeps if component.interface.kind == MODEL_EXCHANGE else None,
        )  # fmt: skip
        shown = [*component.parameter_conversions.values(), *component.input_conversions, *component.output_conversions]
        if not all(rule.is_identity for rule in shown):
            raise InputError(
                f"The FMU '{name}' has other units than the loop shows, and an SSP holds the FMU's own.",
                where=f"write_ssp: {component.path}", next_step="Load it with load_fmu(path, si_units=False).",
            )  # fmt: skip
        if own.digest != component.digest:
            raise InputError(
                "The file of the FMU has changed since it was loaded.", where=f"{name}: {component.path}",
                next_step="Load the FMU again.",
            )  # fmt: skip
        found[name] = _part(own, component)
    return found


def _part(own: FmuComponent, component: FmuComponent) -> Part:
    roles: dict[str, str] = {}
    # Parameters may have other names in the loop; start values of states that were named stand behind them.
    parameters = zip(own.parameters, component.parameters, strict=False)
    values = {before.name: after.start for before, after in parameters if after.start != before.start}
    starts = {v.name: v.start for v in component.parameters[len(own.parameters) :]} | dict(component.start_values)
    now = {_place(component, name): value for name, value in starts.items()}
    values |= {n: now[_place(own, n)] for n, v in own.start_values.items() if now[_place(own, n)] != v}
    inputs = list(zip(own.inputs, component.inputs, strict=True))
    for before, after in (*inputs, *zip(own.outputs, component.outputs, strict=True)):
        if after.name != before.name:
            roles[before.name] = after.name
    values |= {before.name: after.start for before, after in inputs if after.start != before.start}
    names = dict(zip(component.option_types, own.option_types, strict=True))
    set_now = {names[n]: v for n, v in component.options.items()}
    options = {n: v for n, v in set_now.items() if own.options.get(n) != v}
    return Part(own, {**values, **options}, options, roles, fmu_facts(own.path)[0])


def _place(fmu: FmuComponent, name: str) -> tuple[int, int]:
    """Value reference of a start value and its place in an array, which do not depend on its name."""
    return fmu.reference(name), fmu.arrays.get(name, (name,)).index(name)


def connections(system: System, own: Mapping[str, Part]) -> tuple[Route, ...]:
    """The connections between the FMUs, those through a component of an offset as one.

    Raises:
        InputError: several connections add up in one input, which SSP cannot express.
    """
    inbound: dict[str, Connection] = {}
    for connection in system.connections:
        other = inbound.get(connection.target)
        if other is not None:
            raise InputError(
                f"Two connections add up in '{connection.target}', which SSP cannot express.", where="write_ssp",
                got=f"{other.source} -> {other.target} and {connection.source} -> {connection.target}",
                valid="one connection to each input",
                next_step="Let the controller or the plant do the sum, as an input of its own for each term.",
            )  # fmt: skip
        inbound[connection.target] = connection
    own_names = {
        f"{name}.{part.roles.get(v.name, v.name)}": (name, v.name)
        for name, part in own.items()
        for v in (*part.fmu.inputs, *part.fmu.outputs)
    }
    routes = []
    for connection in system.connections:
        target = connection.target.partition(".")[0]
        if target not in own:
            continue
        source, total = connection.source, Affine(connection.gain)
        while (name := source.partition(".")[0]) != REFERENCE and name not in own:
            before = inbound.get(f"{name}.u")
            if before is None or not _stands_before(system, name, target) or system.delays.get(name):
                raise InputError(
                    f"The component '{name}' is not just a transformation of a connection.",
                    where=f"write_ssp: {source} -> {connection.target}",
                    next_step="Connect its input, and evaluate it without delay just before the component it feeds.",
                )
            own_transformation = component_transformation(system.components[name])
            assert own_transformation is not None  # parts() has refused all others
            total = Affine(before.gain).then(own_transformation).then(total)
            source = before.source
        start = (None, source.partition(".")[2]) if name == REFERENCE else own_names[source]
        routes.append(Route(start, own_names[connection.target], total))
    return tuple(routes)


def _stands_before(system: System, name: str, target: str) -> bool:
    """Whether nothing but other transformations is evaluated between this one and the component it feeds."""
    place = system.order.index(name)
    following = next((n for n in system.order[place:] if component_transformation(system.components[n]) is None), None)
    return following == target
