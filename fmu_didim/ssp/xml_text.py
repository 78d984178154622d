"""The XML of SSD and SSV files.

Source: "System Structure and Parameterization", version 1.0, and its schemas, which fix the order of elements.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from xml.etree import ElementTree as ET

from fmu_didim.base.version import __version__
from fmu_didim.components.fmu.description import MODEL_EXCHANGE
from fmu_didim.cosim import System
from fmu_didim.data.units import BASE_UNITS
from fmu_didim.export.xml_file import document
from fmu_didim.ssp.compose import Part, Route
from fmu_didim.ssp.document import FMU_TYPE, LOOP, LOOP_TYPE, SSC, SSD, SSV
from fmu_didim.ssp.transform import Unit


def parameter_set(name: str, part: Part) -> str:
    """The SSV file of the values that were set in a component."""
    root = _root("ssv:ParameterSet", {"ssv": SSV, "ssc": SSC}, name)
    group = _add(root, "ssv:Parameters")
    used = []
    for key, value in part.values.items():
        parameter = _add(group, "ssv:Parameter", name=key)
        if key in part.options:
            _add(parameter, "ssv:Integer", value=str(int(value)))
            continue
        unit = part.unit(key)
        _add(parameter, "ssv:Real", value=_number(value), unit=None if unit is None else unit.name)
        used += [] if unit is None else [unit]
    _units(root, "ssv:Units", used)
    return document(root)


def values_set(name: str, values: Mapping[str, tuple[float, Unit | None]]) -> str:
    """The SSV file of real parameters: name -> value and unit, if that is known."""
    root = _root("ssv:ParameterSet", {"ssv": SSV, "ssc": SSC}, name)
    group = _add(root, "ssv:Parameters")
    for key, (value, unit) in values.items():
        parameter = _add(group, "ssv:Parameter", name=key)
        _add(parameter, "ssv:Real", value=_number(value), unit=None if unit is None else unit.name)
    _units(root, "ssv:Units", [unit for _, unit in values.values() if unit is not None])
    return document(root)


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
    top = _add(root, "ssd:System", name=name)
    columns: dict[str, Unit | None] = {}
    for route in routes:
        if route.start[0] is None:
            columns.setdefault(route.start[1], _stated(parts[route.end[0]], route.end[1], known))
    _connectors(top, [(column, "input", "Real", unit) for column, unit in columns.items()])
    elements = _add(top, "ssd:Elements")
    for component, part in parts.items():
        _component(elements, component, part, sources[component], bindings.get(component), known)
    if routes:
        group = _add(top, "ssd:Connections")
        for route in routes:
            _connection(group, route, parts, known, columns)
    _loop(top, system, parts)
    _units(root, "ssd:Units", known.values())
    _add(root, "ssd:DefaultExperiment", startTime="0")
    return document(root)


def _common_units(parts: Mapping[str, Part]) -> dict[str, Unit]:
    """Units that all FMUs define alike; connectors state no other unit, so that those of the FMUs hold."""
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
    element = _add(elements, "ssd:Component", name=name, type=FMU_TYPE, source=source, implementation=kind)
    inputs = [v.name for v in part.fmu.inputs]
    ports = [(name, "input", "Real") for name in inputs] + [(v.name, "output", "Real") for v in part.fmu.outputs]
    for key in part.values:
        if key not in inputs:
            ports.append((key, "parameter", "Integer" if key in part.options else "Real"))
    _connectors(element, [(*port, _stated(part, port[0], known)) for port in ports])
    if binding is not None:
        _add(_add(element, "ssd:ParameterBindings"), "ssd:ParameterBinding", source=binding)


def _connectors(element: ET.Element, rows: list[tuple[str, str, str, Unit | None]]) -> None:
    if rows:
        group = _add(element, "ssd:Connectors")
        for name, kind, type_, unit in rows:
            connector = _add(group, "ssd:Connector", name=name, kind=kind)
            _add(connector, f"ssc:{type_}", unit=None if unit is None else unit.name)


def _connection(
    group: ET.Element,
    route: Route,
    parts: Mapping[str, Part],
    known: Mapping[str, Unit],
    columns: Mapping[str, Unit | None],
) -> None:
    (owner, variable), (target, end_variable) = route.start, route.end
    start = columns[variable] if owner is None else _effective(parts[owner], variable, known)
    end = _effective(parts[target], end_variable, known)
    unlike = start is not None and end is not None and start != end
    element = _add(
        group, "ssd:Connection", startElement=owner, startConnector=variable, endElement=target,
        endConnector=end_variable, suppressUnitConversion="true" if unlike else None,
    )  # fmt: skip
    factor, offset = route.transformation.factor, route.transformation.offset
    if factor != 1 or offset != 0:
        _add(element, "ssc:LinearTransformation", factor=_number(factor), offset=_number(offset))


def _effective(part: Part, variable: str, known: Mapping[str, Unit]) -> Unit | None:
    """The unit that a reader gives to a variable, defined or not."""
    name = part.unit_name(variable)
    return {**known, **part.units}.get(name, Unit(name)) if name else None


def _loop(top: ET.Element, system: System, parts: Mapping[str, Part]) -> None:
    """The annotation with what SSP has no words for."""
    annotation = _add(_add(top, "ssd:Annotations"), "ssc:Annotation", type=LOOP_TYPE)
    treatment = system.algebraic_loops
    loop = _add(
        annotation, "loop", xmlns=LOOP, step_size=_number(system.step_size),
        algorithm="jacobi" if system.jacobi else None, algebraic_loops=None if treatment == "refuse" else treatment,
    )  # fmt: skip
    for name, part in parts.items():
        delay, own_substeps = system.delays.get(name), part.fmu.substeps
        every, substeps = (counts.get(name, 1) for counts in (system.every, system.substeps))
        exchange = part.fmu.interface.kind == MODEL_EXCHANGE
        element = _add(
            loop, "component", name=name,
            delay=_number(delay) if delay else None,
            every=str(every) if every != 1 else None,
            substeps=str(substeps) if substeps != 1 else None,
            solver=part.fmu.solver if exchange else None,
            solver_substeps=str(own_substeps) if exchange and own_substeps is not None else None,
            after_step="true" if name in system.after_step else None,
        )  # fmt: skip
        for variable, role in part.roles.items():
            _add(element, "role", variable=variable, name=role)


def _units(root: ET.Element, tag: str, units: Iterable[Unit]) -> None:
    rows = {unit.name: unit for unit in units}
    group = _add(root, tag) if rows else root
    for unit in rows.values():
        powers = zip(BASE_UNITS, unit.exponents or (), strict=False)
        base: dict[str, str | None] = {symbol: str(power) for symbol, power in powers if power}
        base["factor"] = _number(unit.factor) if unit.factor != 1 else None
        base["offset"] = _number(unit.offset) if unit.offset != 0 else None
        _add(_add(group, "ssc:Unit", name=unit.name), "ssc:BaseUnit", **base)


def _root(tag: str, namespaces: Mapping[str, str], name: str) -> ET.Element:
    attributes = {f"xmlns:{prefix}": uri for prefix, uri in namespaces.items()}
    tool = f"fmu_didim {__version__}"
    return ET.Element(tag, {**attributes, "version": "1.0", "name": name, "generationTool": tool})


def _add(parent: ET.Element, tag: str, /, **attributes: str | None) -> ET.Element:
    """A new element inside another one, with those of the attributes that are not None."""
    return ET.SubElement(parent, tag, {key: text for key, text in attributes.items() if text is not None})


def _number(value: float) -> str:
    """With all digits, so that reading it gives the same number."""
    return repr(float(value))
