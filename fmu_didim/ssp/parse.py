"""From the XML of SSD, SSV and SSM files to the data of :mod:`fmu_didim.ssp.document`."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

from fmu_didim.base.errors import InputError
from fmu_didim.components.fmu import read_description
from fmu_didim.components.fmu.description import element_names
from fmu_didim.components.fmu.reading import MAXIMUM_ELEMENTS
from fmu_didim.data.units import BASE_UNITS, UnitDefinition
from fmu_didim.ssp.archive import Archive, check_root
from fmu_didim.ssp.document import (
    FMU_TYPE,
    INTERFACES,
    LOOP,
    LOOP_TYPE,
    NUMBERS,
    SSD,
    SSM,
    SSV,
    STEPS,
    STRUCTURE,
    Binding,
    Connector,
    Element,
    Loop,
    MappingEntry,
    Place,
    Structure,
    Value,
    Wire,
)
from fmu_didim.ssp.transform import Affine, Unit

MAXIMUM_DEPTH = 20
LONGEST_SIZE = 10
"""[digits] A longer size of a dimension is not read as a number."""
End = tuple[str, str]
"""Element of a system, empty for the system itself, and its connector."""
PARAMETER_SET = "application/x-ssp-parameter-set"
PARAMETER_MAPPING = "application/x-ssp-parameter-mapping"
_TRUTH = {"true": True, "1": True, "false": False, "0": False}


def parse_structure(archive: Archive) -> Structure:
    """The content of SystemStructure.ssd, with the files of values and mappings that it names; raises InputError."""
    root = archive.xml(STRUCTURE, f"{{{SSD}}}SystemStructureDescription", where=STRUCTURE)
    units = read_units(root, where=f"{archive.path}: {STRUCTURE}")
    system = root.find("{*}System")
    if system is None:
        raise InputError(
            "The description holds no System.", where=f"{archive.path}: {STRUCTURE}",
            next_step="Export the system again; SystemStructure.ssd needs a System element.",
        )  # fmt: skip
    reader = _Reader(archive, units)
    return Structure(dict(reader.elements(system, ())), units, reader.loop(system), _noted_step(root, archive))


def _noted_step(root: ET.Element, archive: Archive) -> float | None:
    """The communication step in the annotation of another tool."""
    for element in root.iterfind(".//{*}Annotation//*"):
        key = STEPS.get(_local(element))
        if key is not None and element.get(key):
            return _number(element, key, math.nan, where=f"{archive.path}: {STRUCTURE}, {_local(element)}")
    return None


def read_units(root: ET.Element, *, where: str) -> dict[str, Unit]:
    """The units that a file defines with a BaseUnit."""
    units: dict[str, Unit] = {}
    for own in root.iterfind("{*}Units/{*}Unit[{*}BaseUnit]"):
        name, base = own.get("name", ""), own.find("{*}BaseUnit")
        assert base is not None
        place = f"{where}, Unit '{name}'"
        try:
            exponents = tuple(int(base.get(symbol, "0")) for symbol in BASE_UNITS)
        except ValueError as error:
            raise InputError(
                "An exponent of a unit is not an integer.", where=place, got=str(error),
                next_step="Write a whole number.",
            ) from error  # fmt: skip
        factor, offset = _number(base, "factor", 1.0, where=place), _number(base, "offset", 0.0, where=place)
        units[name] = _unit(name, UnitDefinition(exponents, factor, offset), place)
    return units


def fmu_facts(path: Path) -> tuple[dict[str, Unit], float | None]:
    """Units of an FMU and the step size of its default experiment in s, None if it states none."""
    fmu = read_description(path)
    step = fmu.experiment.step
    units = {name: _unit(name, definition, f"{path}, Unit '{name}'") for name, definition in fmu.units.items()}
    return units, step if step and step > 0 else None


def _unit(name: str, definition: UnitDefinition, where: str) -> Unit:
    if definition.factor == 0:
        raise InputError(
            "The factor of a unit must not be 0.", where=where, next_step="Give the unit its factor to SI."
        )
    return Unit(name, definition.exponents, definition.factor, definition.offset)


def _named_unit(element: ET.Element, units: Mapping[str, Unit]) -> Unit | None:
    name = element.get("unit")
    return units.get(name, Unit(name)) if name else None


@dataclass(frozen=True)
class _Reader:
    archive: Archive
    units: Mapping[str, Unit]

    def _where(self, what: str) -> str:
        return f"{self.archive.path}: {STRUCTURE}, {what}"

    def elements(self, system: ET.Element, path: Place) -> Iterator[tuple[Place, Element]]:
        """A system, its components, and its inner systems with all that is in them, each with its place."""
        where = self._where(f"System {'.'.join(path) or system.get('name', '')}")
        if len(path) > MAXIMUM_DEPTH:
            raise InputError(
                "The systems are nested too deeply.", where=where, valid=f"{MAXIMUM_DEPTH} levels",
                next_step="Flatten the system where it was made.",
            )  # fmt: skip
        found: dict[str, dict[str, ET.Element]] = {"Component": {}, "System": {}}
        for child in system.iterfind("{*}Elements/*"):
            kind = _local(child)
            if kind not in found:
                raise InputError(
                    f"A {kind} is not supported.", where=where, got=child.get("name"),
                    next_step="Leave it out, or replace it with a Component.",
                )  # fmt: skip
            name = _required(child, "name", where=where)
            if "." in name or any(name in names for names in found.values()):
                raise InputError(
                    "The name of an element must be unique and without a dot.", where=where, got=name,
                    next_step="Rename it.",
                )  # fmt: skip
            found[kind][name] = child
        connectors, bindings = self._connectors(system, where), self._bindings(system, where)
        yield path, Element(connectors, bindings, tuple(self._wires(system, path)))
        for name, child in found["Component"].items():
            yield (*path, name), self._component(child, (*path, name))
        for name, child in found["System"].items():
            yield from self.elements(child, (*path, name))

    def _component(self, element: ET.Element, path: Place) -> Element:
        where = self._where(f"Component {'.'.join(path)}")
        _check_type(element, FMU_TYPE, "Only FMUs are supported as components.", where)
        implementation = element.get("implementation", "any")
        if implementation not in INTERFACES:
            raise InputError(
                "This implementation is not known.", where=where, got=implementation, valid=INTERFACES,
                next_step="Take one of these.",
            )  # fmt: skip
        return Element(
            self._connectors(element, where), self._bindings(element, where),
            source=_required(element, "source", where=where), interface=INTERFACES[implementation],
        )  # fmt: skip

    def _connectors(self, element: ET.Element, where: str) -> dict[str, Connector]:
        found: dict[str, Connector] = {}
        for own in element.iterfind("{*}Connectors/{*}Connector"):
            name = _required(own, "name", where=f"{where}, Connector")
            if name in found:
                raise InputError(
                    "Two connectors have the same name.", where=where, got=name, next_step="Rename one of them."
                )
            kind = _required(own, "kind", where=f"{where}, Connector '{name}'")
            types = [c for c in own if _local(c) in (*NUMBERS, "Boolean", "String", "Enumeration", "Binary", "Clock")]
            unit = _named_unit(types[0], self.units) if types else None
            stated = _local(types[0]) if types else "Real"
            connector = Connector(kind, NUMBERS.get(stated, stated), unit)
            found |= dict.fromkeys(element_names(name, _shape(own, f"{where}, Connector '{name}'")), connector)
        return found

    def _shapes(self, system: ET.Element) -> dict[End, tuple[int, ...]]:
        """Shapes of the connectors of a system itself and of its elements."""
        inner = system.iterfind("{*}Elements/*")
        return {
            (owner, own.get("name", "")): _shape(own, self._where(f"Connector '{own.get('name')}'"))
            for owner, element in [("", system), *((child.get("name", ""), child) for child in inner)]
            for own in element.iterfind("{*}Connectors/{*}Connector")
        }

    def _wires(self, system: ET.Element, path: Place) -> Iterator[Wire]:
        """The connections of a system, those of arrays element by element."""
        shapes = self._shapes(system)
        for element in system.iterfind("{*}Connections/{*}Connection"):
            ends = [(element.get(f"{e}Element") or "", element.get(f"{e}Connector", "")) for e in ("start", "end")]
            both = " -> ".join(".".join(filter(None, end)) for end in ends)
            inside = f"System {'.'.join(path)}, " if path else ""
            where = self._where(f"{inside}Connection {both}")
            told = {shapes[end] for end in ends if end in shapes}
            if len(told) > 1:
                raise InputError(
                    "A connection joins connectors of different shapes.", where=where,
                    got=" and ".join(" x ".join(map(str, shape)) or "a scalar" for shape in sorted(told)),
                    next_step="Give both the same dimensions, or connect single elements by their names, such as x[1].",
                )  # fmt: skip
            transformation, suppressed = _transformation(element, where), _suppressed(element, where)
            starts, stops = (
                [((*path, inner) if inner else path, one) for one in element_names(connector, max(told, default=()))]
                for inner, connector in ends
            )
            for start, end in zip(starts, stops, strict=True):
                yield Wire(start, end, transformation, suppressed, where)

    def _bindings(self, element: ET.Element, where: str) -> tuple[Binding, ...]:
        own = element.iterfind("{*}ParameterBindings/{*}ParameterBinding")
        return tuple(self._binding(one, f"{where}, ParameterBinding {i}") for i, one in enumerate(own, 1))

    def _content(self, holder: ET.Element | None, element: ET.Element, tag: str, where: str) -> ET.Element:
        """The root of what an element gives inline (in ``holder``) or names as its source."""
        if element.get("sourceBase", "SSD") != "SSD":
            raise InputError(
                "A source inside a component is not supported.", where=where, valid="sourceBase SSD",
                next_step="Name the source relative to the system structure, without sourceBase.",
            )  # fmt: skip
        source = element.get("source")
        inline = list(holder) if holder is not None else []
        if (source is not None) == bool(inline) or len(inline) > 1:
            raise InputError(
                "Give either a source or the content itself.", where=where, got=source,
                next_step="Leave one of the two out.",
            )  # fmt: skip
        if source is not None:
            return self.archive.xml(source, tag, where=where)
        check_root(inline[0], tag, where=where)
        return inline[0]

    def _binding(self, element: ET.Element, where: str) -> Binding:
        _check_type(element, PARAMETER_SET, "This kind of parameters is not supported.", where)
        root = self._content(element.find("{*}ParameterValues"), element, f"{{{SSV}}}ParameterSet", where)
        if element.get("source"):
            where += f" ({element.get('source')})"
        units = {**self.units, **read_units(root, where=where)}
        values = []
        for own in root.iterfind("{*}Parameters/{*}Parameter"):
            name = _required(own, "name", where=where)
            content = [child for child in own if _local(child) != "Annotations"]
            if len(content) != 1:
                raise InputError(
                    "A parameter needs exactly one value.", where=where, got=name,
                    next_step="Give it one element with its value, such as <ssv:Real value=\"1\"/>.",
                )  # fmt: skip
            text = _required(content[0], "value", where=f"{where}, Parameter '{name}'")
            stated = _local(content[0])
            values.append(Value(name, NUMBERS.get(stated, stated), text, _named_unit(content[0], units)))
        doubled = sorted(name for name, count in Counter(v.name for v in values).items() if count > 1)
        if doubled:
            raise InputError(
                "A parameter set gives values twice.", where=where, got=", ".join(doubled),
                next_step="Leave one of the two out.",
            )  # fmt: skip
        return Binding(where, element.get("prefix", ""), tuple(values), self._mapping(element, where))

    def _mapping(self, element: ET.Element, where: str) -> tuple[MappingEntry, ...] | None:
        mapping = element.find("{*}ParameterMapping")
        if mapping is None:
            return None
        _check_type(mapping, PARAMETER_MAPPING, "This kind of mapping is not supported.", where)
        root = self._content(mapping, mapping, f"{{{SSM}}}ParameterMapping", f"{where}, ParameterMapping")
        entries: list[MappingEntry] = []
        for own in root.iterfind("{*}MappingEntry"):
            place = f"{where}, MappingEntry {own.get('source')} -> {own.get('target')}"
            source, target = (_required(own, key, where=place) for key in ("source", "target"))
            if any(target == entry.target for entry in entries):
                raise InputError(
                    "Two entries of the mapping have the same target.", where=place, got=target,
                    next_step="Leave one of the two out.",
                )  # fmt: skip
            entries.append(MappingEntry(source, target, _transformation(own, place), _suppressed(own, place)))
        return tuple(entries)

    def loop(self, system: ET.Element) -> Loop | None:
        """The annotation of the root system for which SSP has no words, as :func:`write_ssp` writes it."""
        own = system.find(f"{{*}}Annotations/{{*}}Annotation[@type='{LOOP_TYPE}']/{{{LOOP}}}loop")
        if own is None:
            return None
        where = self._where(f"Annotation {LOOP_TYPE}")
        parts = {_required(c, "name", where=where): c for c in own.iterfind("{*}component")}
        return Loop(
            _number(own, "step_size", math.nan, where=where),
            tuple(parts),
            {name: _number(c, "delay", 0.0, where=where) for name, c in parts.items() if c.get("delay")},
            {
                (name, _required(role, "variable", where=where)): _required(role, "name", where=where)
                for name, c in parts.items()
                for role in c.iterfind("{*}role")
            },
            own.get("algorithm") == "jacobi",
            _counts(parts, "every", where),
            _counts(parts, "substeps", where),
            frozenset(name for name, c in parts.items() if c.get("after_step") == "true"),
            own.get("algebraic_loops", "refuse"),
            {
                name: (c.get("solver", "rk4"), _counts({name: c}, "solver_substeps", where).get(name))
                for name, c in parts.items()
                if c.get("solver")
            },
        )


def _shape(connector: ET.Element, where: str) -> tuple[int, ...]:
    """Sizes of the dimensions that a connector states, () for a scalar."""
    stated = [own.get("size", "") for own in connector.iterfind("{*}Dimension")]
    shape = tuple(int(size) if size.isdecimal() and len(size) < LONGEST_SIZE else 0 for size in stated)
    if not 1 <= math.prod(shape) <= MAXIMUM_ELEMENTS:
        raise InputError(
            "An array needs the size of each dimension as a number.", where=where, got=" x ".join(stated) or "none",
            valid=f"at least 1, and {MAXIMUM_ELEMENTS} elements at most",
            next_step="Write the size itself, as in <Dimension size='2'/>; a size in another connector is not read.",
        )  # fmt: skip
    return shape


def _local(element: ET.Element) -> str:
    return element.tag.rpartition("}")[2]


def _check_type(element: ET.Element, valid: str, what: str, where: str) -> None:
    kind = element.get("type", valid)
    if kind != valid:
        raise InputError(
            what, where=where, got=kind, valid=valid,
            next_step="Correct the element in the archive, or export the system again with it.",
        )  # fmt: skip


def _required(element: ET.Element, key: str, *, where: str) -> str:
    value = element.get(key)
    if not value:
        raise InputError(
            f"A {_local(element)} lacks the attribute '{key}'.", where=where,
            next_step="Add it to the element in the archive, or export the system again.",
        )  # fmt: skip
    return value


def _counts(parts: Mapping[str, ET.Element], key: str, where: str) -> dict[str, int]:
    found = {name: _number(c, key, 1.0, where=where) for name, c in parts.items() if c.get(key)}
    for name, value in found.items():
        if value != int(value):
            raise InputError(
                "This must be a whole number.", where=f"{where}, {name}, {key}", got=value,
                next_step="Write it without a fraction.",
            )  # fmt: skip
    return {name: int(value) for name, value in found.items()}


def _number(element: ET.Element, key: str, default: float, *, where: str) -> float:
    text = element.get(key)
    return default if text is None else number(text, where=f"{where}, {key}")


def number(text: str, *, where: str) -> float:
    """A finite number; raises InputError."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(
            "This is not a finite number.", where=where, got=text, next_step="Write a number with a decimal point."
        )
    return value


def _suppressed(element: ET.Element, where: str) -> bool:
    text = element.get("suppressUnitConversion", "false")
    if text not in _TRUTH:
        raise InputError(
            "This is neither true nor false.", where=f"{where}, suppressUnitConversion", got=text,
            next_step="Write true or false.",
        )  # fmt: skip
    return _TRUTH[text]


def _transformation(element: ET.Element, where: str) -> Affine:
    """The linear transformation of a connection or mapping entry; any other kind is refused."""
    for child in element:
        kind = _local(child)
        if kind == "LinearTransformation":
            return Affine(_number(child, "factor", 1.0, where=where), _number(child, "offset", 0.0, where=where))
        if kind.endswith("Transformation"):
            raise InputError(
                "This transformation is not supported.", where=where, got=kind, valid="LinearTransformation",
                next_step="Replace it with a factor and an offset.",
            )  # fmt: skip
    return Affine()
