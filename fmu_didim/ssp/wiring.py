"""The connectors of all systems as one net: where a signal comes from, where a bound value goes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from fmu_didim.errors import InputError, UnknownNameError
from fmu_didim.ssp.document import ComponentElement, Connector, Structure, SystemElement
from fmu_didim.ssp.transform import Affine, Unit, conversion

Place = tuple[str, ...]
"""Names of the elements from the root system down; empty for the root system itself."""
Node = tuple[Place, str]
"""A connector of an element."""
INWARD, OUTWARD = ("input", "parameter"), ("output", "calculatedParameter")


@dataclass(frozen=True)
class Port:
    """A connector: ``own`` is the unit of the FMU's variable behind it, None for the connector of a system."""

    kind: str
    type: str
    unit: Unit | None
    own: Unit | None = None


@dataclass(frozen=True)
class Wire:
    """A connection between two connectors of a net."""

    start: Node
    end: Node
    transformation: Affine
    suppress: bool
    where: str


@dataclass(frozen=True)
class Net:
    """All elements, connectors and connections of a structure.

    Attributes:
        where: the file, for messages.
        inbound: the one connection that ends in a connector; outbound: those that start there.
    """

    where: str
    components: Mapping[Place, ComponentElement]
    systems: Mapping[Place, SystemElement]
    ports: Mapping[Node, Port]
    inbound: Mapping[Node, Wire]
    outbound: Mapping[Node, tuple[Wire, ...]]

    def upstream(self, node: Node) -> list[Wire]:
        """The wires from the origin of a signal to this connector, in that order; empty if it is not connected."""
        wires: list[Wire] = []
        while node in self.inbound:
            wire = self.inbound[node]
            if wire in wires:
                raise InputError("Connections run in a circle without a component.", where=wire.where)
            wires.insert(0, wire)
            node = wire.start
        return wires

    def downstream(self, node: Node, before: tuple[Wire, ...] = ()) -> Iterator[tuple[Wire, ...]]:
        """All chains of wires from a connector of a system to connectors of components."""
        for wire in self.outbound.get(node, ()):
            if wire in before:
                raise InputError("Connections run in a circle without a component.", where=wire.where)
            if wire.end[0] in self.components:
                yield (*before, wire)
            else:
                yield from self.downstream(wire.end, (*before, wire))

    def transformation(self, wires: list[Wire] | tuple[Wire, ...], unit: Unit | None = None) -> Affine:
        """From the value at the start of a chain of wires to the value of the FMU's variable at its end.

        At each wire the unit is converted first, then the linear transformation applied to the converted
        value; with suppressUnitConversion the latter stands alone. A connector of a system without a unit
        has that of what comes in.

        Args:
            wires: the chain.
            unit: of the value at its start, if the connector there states none.
        """
        first, last = wires[0], wires[-1]
        start = self.ports[first.start]
        here = start.unit or start.own or unit
        total = Affine() if first.suppress else conversion(start.own, here, where=first.where)
        for wire in wires:
            end = self.ports[wire.end]
            target = end.unit or end.own or here
            if not wire.suppress:
                total = total.then(conversion(here, target, where=wire.where))
            total = total.then(wire.transformation)
            here = target
        if not last.suppress:
            total = total.then(conversion(here, self.ports[last.end].own, where=last.where))
        return total


def flat_name(path: Place) -> str:
    """Name of a component of nested systems in the one flat system."""
    return "_".join(path)


def build_net(structure: Structure, own_units: Mapping[Node, Unit | None], *, where: str) -> Net:
    """The net of a structure.

    Args:
        own_units: unit of each variable of each FMU.

    Raises:
        UnknownNameError: a connection names no existing element or connector.
        InputError: a connection is written backwards, or two end in the same connector.
    """
    systems: dict[Place, SystemElement] = {}
    components: dict[Place, ComponentElement] = {}
    _collect(structure.system, (), systems, components)
    ports: dict[Node, Port] = {}
    owners: dict[Place, SystemElement | ComponentElement] = {**systems, **components}
    for path, element in owners.items():
        for connector in element.connectors:
            node = (path, connector.name)
            ports[node] = _port(connector, own_units.get(node))
    inbound: dict[Node, Wire] = {}
    outbound: dict[Node, tuple[Wire, ...]] = {}
    for path, system in systems.items():
        for link in system.links:
            both = f"{_text(*link.start)} -> {_text(*link.end)}"
            here = f"{where}, {'System ' + '.'.join(path) + ', ' if path else ''}Connection {both}"
            start, end = (_node(path, *side, system, ports, here) for side in (link.start, link.end))
            _check_direction(path, start, end, ports, here)
            if end in inbound:
                raise InputError(
                    "Two connections end in the same connector.",
                    where=here,
                    got=f"{both}; also {inbound[end].where.rpartition('Connection ')[2]}",
                    valid="one connection to each input",
                )
            wire = Wire(start, end, link.transformation, link.suppress, here)
            inbound[end] = wire
            outbound[start] = (*outbound.get(start, ()), wire)
    return Net(where, components, systems, ports, inbound, outbound)


def _collect(
    system: SystemElement, path: Place, systems: dict[Place, SystemElement], components: dict[Place, ComponentElement]
) -> None:
    systems[path] = system
    for component in system.components:
        components[(*path, component.name)] = component
    for inner in system.systems:
        _collect(inner, (*path, inner.name), systems, components)


def _port(connector: Connector, own: Unit | None) -> Port:
    return Port(connector.kind, connector.type, connector.unit, own)


def _text(element: str | None, connector: str) -> str:
    return connector if element is None else f"{element}.{connector}"


def _node(
    path: Place, element: str | None, connector: str, system: SystemElement, ports: Mapping[Node, Port], where: str
) -> Node:
    if element is not None:
        names = [c.name for c in system.components] + [s.name for s in system.systems]
        if element not in names:
            raise UnknownNameError("element", element, names, where=where)
        path = (*path, element)
    if (path, connector) not in ports:
        owner = f"connector of '{element}'" if element is not None else "connector of the system"
        raise UnknownNameError(owner, connector, [name for own, name in ports if own == path], where=where)
    return path, connector


def _check_direction(path: Place, start: Node, end: Node, ports: Mapping[Node, Port], where: str) -> None:
    for node, inside, outside in ((start, INWARD, OUTWARD), (end, OUTWARD, INWARD)):
        port = ports[node]
        valid = inside if node[0] == path else outside
        if port.kind not in valid:
            side = "start" if node is start else "end"
            raise InputError(
                f"A connection cannot {side} in this connector.",
                where=where,
                got=f"'{node[1]}' of kind {port.kind}",
                valid=valid,
                next_step="A connection runs from an output, or an input of the system, to an input.",
            )
        if port.type != "Real":
            raise InputError("Only Real signals are connected.", where=where, got=f"'{node[1]}' of type {port.type}")
