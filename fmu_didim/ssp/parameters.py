"""Which value each variable of each component gets from the parameter bindings of all levels."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from fmu_didim.components import FmuComponent
from fmu_didim.errors import InputError, UnknownNameError
from fmu_didim.ssp.document import Binding, ComponentElement, SystemElement, Value
from fmu_didim.ssp.parse import number
from fmu_didim.ssp.transform import Affine, Unit, conversion
from fmu_didim.ssp.wiring import Net, Place


@dataclass(frozen=True)
class _Bound:
    """A value of a set under the name by which it is applied."""

    name: str
    value: Value
    transformation: Affine
    suppress: bool
    where: str


@dataclass(frozen=True)
class Bindings:
    """The bindings of a net applied to its FMUs.

    Attributes:
        units: unit of each variable of each FMU.
        strict: refuse values whose names no FMU has; the standard lets a tool ignore them.
    """

    net: Net
    fmus: Mapping[Place, FmuComponent]
    units: Mapping[tuple[Place, str], Unit | None]
    strict: bool

    def values(self) -> dict[Place, dict[str, float]]:
        """Variable -> value for each component: later bindings win over earlier, higher levels over lower ones.

        Raises:
            UnknownNameError: strict, and a name leads to no parameter or input of an FMU.
            InputError: a value is no number, or its unit cannot be converted.
        """
        found: dict[Place, dict[str, float]] = {path: {} for path in self.fmus}
        owners: dict[Place, SystemElement | ComponentElement] = {**self.net.systems, **self.net.components}
        for path in sorted(owners, key=len, reverse=True):
            for binding in owners[path].bindings:
                for bound in _entries(binding, strict=self.strict):
                    self._apply(path, bound, found)
        return found

    def _apply(self, path: Place, bound: _Bound, found: dict[Place, dict[str, float]]) -> None:
        path, name = self._descend(path, bound.name)
        if path in self.fmus:
            if name in _variables(self.fmus[path]):
                port = self.net.ports.get((path, name))
                own = self.units.get((path, name))
                stated = (port.unit if port else None) or own
                value = self._number(bound, stated)
                if not bound.suppress:
                    value = conversion(stated, own, where=bound.where)(value)
                found[path][name] = value
                return
        elif (path, name) in self.net.ports:
            port = self.net.ports[path, name]
            value = self._number(bound, port.unit)
            chains = list(self.net.downstream((path, name)))
            for wires in chains:
                end, variable = wires[-1].end
                unit = bound.value.unit if port.unit is None else None
                found[end][variable] = self.net.transformation(wires, unit)(value)
            if chains:
                return
        if self.strict:
            valid = sorted(_variables(self.fmus[path])) if path in self.fmus else self._names(path)
            raise UnknownNameError("parameter", name, valid, where=f"{bound.where}, '{bound.name}'")

    def _descend(self, path: Place, name: str) -> tuple[Place, str]:
        """The element that a hierarchical name leads to, and the name there."""
        while path in self.net.systems and (path, name) not in self.net.ports:
            head, dot, rest = name.partition(".")
            inner = (*path, head)
            if not dot or not (inner in self.net.systems or inner in self.fmus):
                break
            path, name = inner, rest
        return path, name

    def _names(self, path: Place) -> list[str]:
        own = [name for owner, name in self.net.ports if owner == path]
        inner = [p for p in self.fmus if p[: len(path)] == path]
        return own + [".".join((*p[len(path) :], name)) for p in inner for name in sorted(_variables(self.fmus[p]))]

    @staticmethod
    def _number(bound: _Bound, unit: Unit | None) -> float:
        """The value in this unit, then transformed."""
        where = f"{bound.where}, parameter '{bound.value.name}'"
        if bound.value.type not in ("Real", "Integer"):
            raise InputError(
                "Only numbers can be bound to a parameter.", where=where, got=bound.value.type, valid="Real, Integer"
            )
        value = number(bound.value.text, where=where)
        if not bound.suppress:
            value = conversion(bound.value.unit, unit, where=where)(value)
        return bound.transformation(value)


def _entries(binding: Binding, *, strict: bool) -> Iterator[_Bound]:
    """The values of a binding under their final names; with a mapping only those it names."""
    values = {binding.prefix + value.name: value for value in binding.values}
    if binding.mapping is None:
        for name, value in values.items():
            yield _Bound(name, value, Affine(), False, binding.where)
        return
    for entry in binding.mapping:
        where = f"{binding.where}, MappingEntry {entry.source} -> {entry.target}"
        if entry.source in values:
            yield _Bound(entry.target, values[entry.source], entry.transformation, entry.suppress, where)
        elif strict:
            raise UnknownNameError("parameter in the set", entry.source, values, where=where)


def _variables(fmu: FmuComponent) -> set[str]:
    """Names of what can be given a value before the start: parameters, Integer ones too, start values and inputs."""
    return {*(v.name for v in (*fmu.parameters, *fmu.inputs)), *fmu.references, *fmu.start_values}
