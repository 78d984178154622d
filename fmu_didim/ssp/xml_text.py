"""The XML of SSD and SSV files.

Source: "System Structure and Parameterization", version 1.0, and its schemas, which fix the order of elements.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from xml.etree import ElementTree as ET

from fmu_didim.components.fmu.description import MODEL_EXCHANGE
from fmu_didim.master import System
from fmu_didim.ssp.compose import Part, Route
from fmu_didim.ssp.document import FMU_TYPE, LOOP, LOOP_TYPE, SSC, SSD, SSV
from fmu_didim.ssp.transform import Unit
from fmu_didim.units import BASE_UNITS
from fmu_didim.version import __version__


def parameter_set(name: str, part: Part) -> str:
    """The SSV file of the values that were set in a component."""
    root = _root("ssv:ParameterSet", {"ssv": SSV, "ssc": SSC}, name)
    group = ET.SubElement(root, "ssv:Parameters")
    used = []
    for key, value in part.values.items():
        parameter = ET.SubElement(group, "ssv:Parameter", name=key)
        if key in part.options:
            ET.SubElement(parameter, "ssv:Integer", value=str(int(value)))
            continue
        real = ET.SubElement(parameter, "ssv:Real", value=_number(value))
        unit = part.unit(key)
        if unit is not None:
            real.set("unit", unit.name)
            used.append(unit)
    _units(root, "ssv:Units", used)
    return _text(root)


def structure_text(
    name: str,
    system: System,
    parts: Mapping[str, Part],
    routes: Sequence[Route],
    sources: Mapping[str, str],
    bindings: Mapping[str, str],
) -> str:
    """The SSD file.

    Args:
        sources, bindings: component -> URI of its FMU and, if values were set, of its parameter set.
    """
    known = _common_units(parts)
    root = _root("ssd:SystemStructureDescription", {"ssd": SSD, "ssc": SSC}, name)
    top = ET.SubElement(root, "ssd:System", name=name)
    columns: dict[str, Unit | None] = {}
    for route in routes:
        if route.start[0] is None:
            columns.setdefault(route.start[1], _stated(parts[route.end[0]], route.end[1], known))
    _connectors(top, [(column, "input", "Real", unit) for column, unit in columns.items()])
    elements = ET.SubElement(top, "ssd:Elements")
    for component, part in parts.items():
        _component(elements, component, part, sources[component], bindings.get(component), known)
    if routes:
        group = ET.SubElement(top, "ssd:Connections")
        for route in routes:
            _connection(group, route, parts, known, columns)
    _loop(top, system, parts)
    _units(root, "ssd:Units", known.values())
    ET.SubElement(root, "ssd:DefaultExperiment", startTime="0")
    return _text(root)


def _common_units(parts: Mapping[str, Part]) -> dict[str, Unit]:
    """Units that all FMUs define alike; of others the connectors keep silent, so that the FMU's own hold."""
    known: dict[str, Unit] = {}
    unlike: set[str] = set()
    for part in parts.values():
        for name, unit in part.units.items():
            if known.setdefault(name, unit) != unit:
                unlike.add(name)
    return {name: unit for name, unit in known.items() if name not in unlike}


def _stated(part: Part, variable: str, known: Mapping[str, Unit]) -> Unit | None:
    unit = part.unit(variable)
    return unit if unit is not None and unit.name in known else None


def _component(
    elements: ET.Element, name: str, part: Part, source: str, binding: str | None, known: Mapping[str, Unit]
) -> None:
    kind = "ModelExchange" if part.fmu.interface.kind == MODEL_EXCHANGE else "CoSimulation"
    element = ET.SubElement(elements, "ssd:Component", name=name, type=FMU_TYPE, source=source, implementation=kind)
    rows = [(v.name, "input", "Real", _stated(part, v.name, known)) for v in part.fmu.inputs]
    rows += [(v.name, "output", "Real", _stated(part, v.name, known)) for v in part.fmu.outputs]
    inputs = {v.name for v in part.fmu.inputs}
    for key in part.values:
        if key not in inputs:
            kind = "Integer" if key in part.options else "Real"
            rows.append((key, "parameter", kind, _stated(part, key, known)))
    _connectors(element, rows)
    if binding is not None:
        ET.SubElement(ET.SubElement(element, "ssd:ParameterBindings"), "ssd:ParameterBinding", source=binding)


def _connectors(element: ET.Element, rows: list[tuple[str, str, str, Unit | None]]) -> None:
    if not rows:
        return
    group = ET.SubElement(element, "ssd:Connectors")
    for name, kind, type_, unit in rows:
        content = ET.SubElement(ET.SubElement(group, "ssd:Connector", name=name, kind=kind), f"ssc:{type_}")
        if unit is not None:
            content.set("unit", unit.name)


def _connection(
    group: ET.Element,
    route: Route,
    parts: Mapping[str, Part],
    known: Mapping[str, Unit],
    columns: Mapping[str, Unit | None],
) -> None:
    owner, variable = route.start
    element = ET.SubElement(group, "ssd:Connection")
    if owner is not None:
        element.set("startElement", owner)
    element.set("startConnector", variable)
    element.set("endElement", route.end[0])
    element.set("endConnector", route.end[1])
    start = columns[variable] if owner is None else _effective(parts[owner], variable, known)
    end = _effective(parts[route.end[0]], route.end[1], known)
    if start is not None and end is not None and start != end:
        element.set("suppressUnitConversion", "true")
    if route.transformation.factor != 1 or route.transformation.offset != 0:
        transformation = ET.SubElement(element, "ssc:LinearTransformation")
        transformation.set("factor", _number(route.transformation.factor))
        transformation.set("offset", _number(route.transformation.offset))


def _effective(part: Part, variable: str, known: Mapping[str, Unit]) -> Unit | None:
    """The unit that a reader gives to a variable, defined or not."""
    name = next((v.unit for v in (*part.fmu.inputs, *part.fmu.outputs) if v.name == variable), "")
    return {**known, **part.units}.get(name, Unit(name)) if name else None


def _loop(top: ET.Element, system: System, parts: Mapping[str, Part]) -> None:
    """The annotation with what SSP has no words for."""
    annotation = ET.SubElement(ET.SubElement(top, "ssd:Annotations"), "ssc:Annotation", type=LOOP_TYPE)
    loop = ET.SubElement(annotation, "loop", {"xmlns": LOOP, "step_size": _number(system.step_size)})
    if system.jacobi:
        loop.set("algorithm", "jacobi")
    if system.algebraic_loops != "refuse":
        loop.set("algebraic_loops", system.algebraic_loops)
    for name, part in parts.items():
        element = ET.SubElement(loop, "component", name=name)
        if system.delays.get(name):
            element.set("delay", _number(system.delays[name]))
        for key, counts in (("every", system.every), ("substeps", system.substeps)):
            if counts.get(name, 1) != 1:
                element.set(key, str(counts[name]))
        if part.fmu.interface.kind == MODEL_EXCHANGE:
            element.set("solver", part.fmu.solver)
            if part.fmu.substeps is not None:
                element.set("solver_substeps", str(part.fmu.substeps))
        if name in system.after_step:
            element.set("after_step", "true")
        for variable, role in part.roles.items():
            ET.SubElement(element, "role", variable=variable, name=role)


def _units(root: ET.Element, tag: str, units: Iterable[Unit]) -> None:
    rows = {unit.name: unit for unit in units}
    if not rows:
        return
    group = ET.SubElement(root, tag)
    for unit in rows.values():
        base = ET.SubElement(ET.SubElement(group, "ssc:Unit", name=unit.name), "ssc:BaseUnit")
        for symbol, exponent in zip(BASE_UNITS, unit.exponents or (), strict=False):
            if exponent:
                base.set(symbol, str(exponent))
        if unit.factor != 1:
            base.set("factor", _number(unit.factor))
        if unit.offset != 0:
            base.set("offset", _number(unit.offset))


def _root(tag: str, namespaces: Mapping[str, str], name: str) -> ET.Element:
    attributes = {f"xmlns:{prefix}": uri for prefix, uri in namespaces.items()}
    tool = f"fmu_didim {__version__}"
    return ET.Element(tag, {**attributes, "version": "1.0", "name": name, "generationTool": tool})


def _number(value: float) -> str:
    """All digits, so that reading gives the same number."""
    return repr(float(value))


def _text(root: ET.Element) -> str:
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"
