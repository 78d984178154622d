"""The value of each variable of each component, from the parameter bindings of all levels."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from fmu_didim.base.errors import InputError, UnknownNameError
from fmu_didim.components import FmuComponent
from fmu_didim.ssp.document import Binding, MappingEntry, Node, Place, Value
from fmu_didim.ssp.parse import number
from fmu_didim.ssp.transform import Affine, Unit, conversion
from fmu_didim.ssp.wiring import Net

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Bindings:
    """The bindings of a net applied to its FMUs.

    Attributes:
        units: unit of each variable of each FMU.
        strict: refuse values whose names no FMU has; the standard lets a tool ignore them.
    """

    net: Net
    fmus: Mapping[Place, FmuComponent]
    units: Mapping[Node, Unit | None]
    strict: bool

    def values(self) -> dict[Place, dict[str, float]]:
        """Variable -> value for each component: later bindings win over earlier, higher levels over lower ones.

        Raises:
            UnknownNameError: strict, and a name leads to no parameter or input of an FMU.
            InputError: a value is not a number, or its unit cannot be converted.
        """
        found: dict[Place, dict[str, float]] = {path: {} for path in self.fmus}
        for path in sorted(self.net.elements, key=len, reverse=True):
            for binding in self.net.elements[path].bindings:
                for entry, value, where in _entries(binding, strict=self.strict):
                    self._apply(path, entry, value, where, found)
        return found

    def _apply(
        self, path: Place, entry: MappingEntry, bound: Value, where: str, found: dict[Place, dict[str, float]]
    ) -> None:
        path, name = self._descend(path, entry.target)
        if path in self.fmus:
            if name in _variables(self.fmus[path]):
                port = self.net.ports.get((path, name))
                own = self.units.get((path, name))
                stated = (port.unit if port else None) or own
                value = _number(entry, bound, stated, where)
                if not entry.suppress:
                    value = conversion(stated, own, where=where)(value)
                found[path][name] = value
                return
        elif (path, name) in self.net.ports:
            port = self.net.ports[path, name]
            value = _number(entry, bound, port.unit, where)
            chains = list(self.net.downstream((path, name)))
            for wires in chains:
                end, variable = wires[-1].end
                unit = bound.unit if port.unit is None else None
                found[end][variable] = self.net.transformation(wires, unit)(value)
            if not chains:
                _log.warning("%s: the value of '%s' goes nowhere: nothing is connected there", where, entry.target)
            return
        if self.strict:
            valid = sorted(_variables(self.fmus[path])) if path in self.fmus else self._names(path)
            raise UnknownNameError("parameter", name, valid, where=f"{where}, '{entry.target}'")

    def _descend(self, path: Place, name: str) -> tuple[Place, str]:
        """The element that a hierarchical name leads to, and the name there."""
        while self.net.is_system(path) and (path, name) not in self.net.ports:
            head, dot, rest = name.partition(".")
            inner = (*path, head)
            if not dot or inner not in self.net.elements:
                break
            path, name = inner, rest
        return path, name

    def _names(self, path: Place) -> list[str]:
        own = [name for owner, name in self.net.ports if owner == path]
        inner = [p for p in self.fmus if p[: len(path)] == path]
        return own + [".".join((*p[len(path) :], name)) for p in inner for name in sorted(_variables(self.fmus[p]))]


def _number(entry: MappingEntry, bound: Value, unit: Unit | None, where: str) -> float:
    """The value in this unit, then transformed."""
    where = f"{where}, parameter '{bound.name}'"
    if bound.type not in ("Real", "Integer"):
        valid = "Real, Integer"
        raise InputError(
            "Only numbers can be bound to a parameter.", where=where, got=bound.type, valid=valid,
            next_step="Bind a number, or give the value to the FMU itself.",
        )  # fmt: skip
    value = number(bound.text, where=where)
    if not entry.suppress:
        value = conversion(bound.unit, unit, where=where)(value)
    return entry.transformation(value)


def _entries(binding: Binding, *, strict: bool) -> Iterator[tuple[MappingEntry, Value, str]]:
    """Targets of the values of a binding, with a mapping only of those it names; the values; where they are written."""
    values = {binding.prefix + value.name: value for value in binding.values}
    if binding.mapping is None:
        for name, value in values.items():
            yield MappingEntry(name, name, Affine(), False), value, binding.where
        return
    for entry in binding.mapping:
        where = f"{binding.where}, MappingEntry {entry.source} -> {entry.target}"
        if entry.source in values:
            yield entry, values[entry.source], where
        elif strict:
            raise UnknownNameError("parameter in the set", entry.source, values, where=where)


def _variables(fmu: FmuComponent) -> set[str]:
    """Names of all that can be set before the start: parameters, Integer ones too, start values and inputs."""
    return {*(v.name for v in (*fmu.parameters, *fmu.inputs)), *fmu.references, *fmu.start_values}
