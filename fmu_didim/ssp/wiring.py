"""The connectors of all systems as one net: where a signal comes from, where a bound value goes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from fmu_didim.base.errors import InputError, UnknownNameError
from fmu_didim.ssp.document import Connector, Element, Node, Place, Structure, Wire
from fmu_didim.ssp.transform import Affine, Unit, conversion

INWARD, OUTWARD = ("input", "parameter"), ("output", "calculatedParameter")


@dataclass(frozen=True)
class Net:
    """All elements, connectors and connections of a structure.

    Attributes:
        where: the file, for messages.
        inbound: the one connection that ends in a connector; outbound: those that start there.
    """

    where: str
    elements: Mapping[Place, Element]
    ports: Mapping[Node, Connector]
    inbound: Mapping[Node, Wire]
    outbound: Mapping[Node, tuple[Wire, ...]]

    def is_system(self, path: Place) -> bool:
        """Whether there is a system at this place."""
        return path in self.elements and self.elements[path].source is None

    def upstream(self, node: Node) -> list[Wire]:
        """The wires from the origin of a signal to this connector, in that order; empty if it is not connected."""
        wires: list[Wire] = []
        while node in self.inbound:
            wire = self.inbound[node]
            _check_circle(wire, wires)
            wires.insert(0, wire)
            node = wire.start
        return wires

    def downstream(self, node: Node, before: tuple[Wire, ...] = ()) -> Iterator[tuple[Wire, ...]]:
        """All chains of wires from a connector of a system to connectors of components."""
        for wire in self.outbound.get(node, ()):
            _check_circle(wire, before)
            if self.is_system(wire.end[0]):
                yield from self.downstream(wire.end, (*before, wire))
            else:
                yield (*before, wire)

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
        unit_here = start.unit or start.own or unit
        total = Affine() if first.suppress else conversion(start.own, unit_here, where=first.where)
        for wire in wires:
            end = self.ports[wire.end]
            target = end.unit or end.own or unit_here
            if not wire.suppress:
                total = total.then(conversion(unit_here, target, where=wire.where))
            total = total.then(wire.transformation)
            unit_here = target
        if not last.suppress:
            total = total.then(conversion(unit_here, self.ports[last.end].own, where=last.where))
        return total


def _check_circle(wire: Wire, others: list[Wire] | tuple[Wire, ...]) -> None:
    if wire in others:
        raise InputError(
            "Connections run in a circle without a component.", where=wire.where,
            next_step="Take one of the connections of this circle out.",
        )  # fmt: skip


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
    elements = structure.elements
    ports = {
        (path, name): replace(connector, own=own_units.get((path, name)))
        for path, element in elements.items()
        for name, connector in element.connectors.items()
    }
    inbound: dict[Node, Wire] = {}
    outbound: dict[Node, tuple[Wire, ...]] = {}
    for path, element in elements.items():
        for wire in element.wires:
            for node in (wire.start, wire.end):
                _check_node(path, node, elements, ports, wire.where)
            _check_direction(path, wire, ports)
            if wire.end in inbound:
                both, other = (w.where.rpartition("Connection ")[2] for w in (wire, inbound[wire.end]))
                raise InputError(
                    "Two connections end in the same connector.", where=wire.where, got=f"{both}; also {other}",
                    valid="one connection to each input",
                    next_step="Take one of them out, or add their signals in a component.",
                )  # fmt: skip
            inbound[wire.end] = wire
            outbound[wire.start] = (*outbound.get(wire.start, ()), wire)
    return Net(where, elements, ports, inbound, outbound)


def _check_node(
    path: Place, node: Node, elements: Mapping[Place, Element], ports: Mapping[Node, Connector], where: str
) -> None:
    place, connector = node
    if place not in elements:
        names = [other[-1] for other in elements if other and other[:-1] == path]
        raise UnknownNameError("element", place[-1], names, where=where)
    if node not in ports:
        owner = "connector of the system" if place == path else f"connector of '{place[-1]}'"
        raise UnknownNameError(owner, connector, elements[place].connectors, where=where)


def _check_direction(path: Place, wire: Wire, ports: Mapping[Node, Connector]) -> None:
    for side, node, inside, outside in (("start", wire.start, INWARD, OUTWARD), ("end", wire.end, OUTWARD, INWARD)):
        port = ports[node]
        valid = inside if node[0] == path else outside
        if port.kind not in valid:
            raise InputError(
                f"A connection cannot {side} in this connector.", where=wire.where,
                got=f"'{node[1]}' of kind {port.kind}", valid=valid,
                next_step="A connection runs from an output, or an input of the system, to an input.",
            )  # fmt: skip
        if port.type != "Real":
            got = f"'{node[1]}' of type {port.type}"
            raise InputError(
                "Only Real signals are connected.", where=wire.where, got=got,
                next_step="Make the connector Real, or take the connection out.",
            )  # fmt: skip
