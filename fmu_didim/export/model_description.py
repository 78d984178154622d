"""modelDescription.xml of an exported block, for FMI 2.0.

Source: "Functional Mock-up Interface for Model Exchange and Co-Simulation", version 2.0, section 2.2.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from xml.etree import ElementTree as ET

import casadi as ca

from fmu_didim.block import Block
from fmu_didim.export.c_code import SUBSTEPS_NAME, check_exportable, layout
from fmu_didim.signals import Variable

Exponents = dict[str, int]

BASE_UNITS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
# Exponents in the order of BASE_UNITS, then the factor to the base units.
_SYMBOLS: dict[str, tuple[tuple[int, ...], float]] = {
    **{unit: (tuple(int(unit == other) for other in BASE_UNITS), 1.0) for unit in BASE_UNITS},
    "1": ((0,) * 8, 1.0),
    "N": ((1, 1, -2, 0, 0, 0, 0, 0), 1.0),
    "J": ((1, 2, -2, 0, 0, 0, 0, 0), 1.0),
    "W": ((1, 2, -3, 0, 0, 0, 0, 0), 1.0),
    "Pa": ((1, -1, -2, 0, 0, 0, 0, 0), 1.0),
    "Hz": ((0, 0, -1, 0, 0, 0, 0, 0), 1.0),
    "C": ((0, 0, 1, 1, 0, 0, 0, 0), 1.0),
    "V": ((1, 2, -3, -1, 0, 0, 0, 0), 1.0),
    "Ohm": ((1, 2, -3, -2, 0, 0, 0, 0), 1.0),
    "F": ((-1, -2, 4, 2, 0, 0, 0, 0), 1.0),
    "H": ((1, 2, -2, -2, 0, 0, 0, 0), 1.0),
    "Wb": ((1, 2, -2, -1, 0, 0, 0, 0), 1.0),
    "T": ((1, 0, -2, -1, 0, 0, 0, 0), 1.0),
    "deg": ((0, 0, 0, 0, 0, 0, 0, 1), math.pi / 180.0),
}
_FACTOR = re.compile(r"([A-Za-z]+|1)([+-]?\d+)?")


def base_unit(unit: str) -> tuple[Exponents, float] | None:
    """Exponents of the SI base units (and rad) of a unit, and the factor to them.

    Syntax as in FMI and Modelica: factors ``symbol[exponent]`` joined by ``.``, at most one ``/``
    followed by one factor or by several in parentheses: ``kg.m2``, ``N.m.s/rad``, ``W/(m2.K)``.

    Returns:
        The exponents that are not zero and the factor, or None if the unit is not known.
    """
    numerator, slash, denominator = unit.partition("/")
    if denominator.startswith("(") and denominator.endswith(")"):
        denominator = denominator[1:-1]
    elif "." in denominator:
        return None  # N/m.s may mean two things
    total, scale = [0] * len(BASE_UNITS), 1.0
    for part, sign in ((numerator, 1), (denominator, -1)):
        for text in part.split(".") if part or sign == 1 or slash else ():
            match = _FACTOR.fullmatch(text)
            if match is None or match[1] not in _SYMBOLS:
                return None
            exponents, factor = _SYMBOLS[match[1]]
            power = sign * int(match[2] or 1)
            total = [sum_ + power * e for sum_, e in zip(total, exponents, strict=True)]
            scale *= factor**power
    return {name: e for name, e in zip(BASE_UNITS, total, strict=True) if e}, scale


def model_description(block: Block, *, guid: str, generation_tool: str, source_files: Sequence[str]) -> str:
    """The text of modelDescription.xml of a block, for co-simulation and model exchange.

    Value references are those of :func:`fmu_didim.export.c_code.layout`, and the variables stand in
    that order. The model structure follows from the sparsity of the equations.

    Args:
        block: the block.
        guid: the identifier compiled into the binary.
        generation_tool: name and version of the exporter.
        source_files: the files of ``sources/`` that are compiled (not those they include).

    Raises:
        InputError: a name or a start value cannot be exported.
    """
    check_exportable(block)
    sampled = block.sample_time is not None
    root = ET.Element(
        "fmiModelDescription",
        fmiVersion="2.0",
        modelName=block.name,
        guid=guid,
        description=block.description,
        generationTool=generation_tool,
        variableNamingConvention="flat",
        numberOfEventIndicators="0",
    )
    if not block.description:
        del root.attrib["description"]
    common = {
        "modelIdentifier": block.name,
        "canNotUseMemoryManagementFunctions": "true",
        "canGetAndSetFMUstate": "true",
        "canSerializeFMUstate": "true",
        "providesDirectionalDerivative": "true",
        "canBeInstantiatedOnlyOncePerProcess": "false",
    }
    exchange = ET.SubElement(root, "ModelExchange", {**common, "completedIntegratorStepNotNeeded": "true"})
    simulation = ET.SubElement(root, "CoSimulation", {**common, "canHandleVariableCommunicationStepSize": "true"})
    for interface in (exchange, simulation):
        files = ET.SubElement(interface, "SourceFiles")
        for name in source_files:
            ET.SubElement(files, "File", name=name)
    _add_units(root, block)
    categories = ET.SubElement(root, "LogCategories")
    ET.SubElement(categories, "Category", name="logStatusError", description="Errors; they are always logged.")
    if sampled:
        ET.SubElement(root, "DefaultExperiment", startTime="0", stepSize=repr(block.sample_time))
    _add_variables(ET.SubElement(root, "ModelVariables"), block)
    _add_structure(ET.SubElement(root, "ModelStructure"), block)
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _derivative_unit(unit: str) -> str:
    """The unit of the derivative of a variable: ``rad/s`` of ``rad``; empty if it has no plain name."""
    if not unit:
        return ""
    match = re.fullmatch(r"([^/()]+)/s(\d*)", unit)
    if match:
        return f"{match[1]}/s{int(match[2] or 1) + 1}"
    return f"{unit}/s" if "/" not in unit else ""


def _add_units(root: ET.Element, block: Block) -> None:
    units = {v.unit for v in (*block.inputs, *block.outputs, *block.states, *block.parameters)}
    if block.sample_time is None:
        units |= {_derivative_unit(v.unit) for v in block.states}
    units.discard("")
    if not units:
        return
    definitions = ET.SubElement(root, "UnitDefinitions")
    for unit in sorted(units):
        element = ET.SubElement(definitions, "Unit", name=unit)
        known = base_unit(unit)
        if known is not None:
            exponents, factor = known
            attributes = {name: str(exponent) for name, exponent in exponents.items()}
            ET.SubElement(element, "BaseUnit", attributes | ({"factor": repr(factor)} if factor != 1.0 else {}))


def _add_variables(parent: ET.Element, block: Block) -> None:
    refs = layout(block)
    sampled = block.sample_time is not None

    def add(reference: int, variable: Variable, real: dict[str, str], **attributes: str) -> None:
        named = {"name": variable.name, "valueReference": str(reference)}
        if variable.description:
            named["description"] = variable.description
        element = ET.SubElement(parent, "ScalarVariable", named | attributes)
        ET.SubElement(element, "Real", ({"unit": variable.unit} if variable.unit else {}) | real)

    calculated = "discrete" if sampled else "continuous"
    for reference, v in zip(refs.inputs, block.inputs, strict=True):
        # Inputs of a sampled block are continuous too: they may change at any time, and are seen at the samples.
        add(reference, v, {"start": repr(float(v.start))}, causality="input", variability="continuous")
    for reference, v in zip(refs.outputs, block.outputs, strict=True):
        add(reference, v, {}, causality="output", variability=calculated, initial="calculated")
    for reference, v in zip(refs.states, block.states, strict=True):
        add(reference, v, {}, causality="local", variability=calculated, initial="calculated")
    for reference, v in zip(refs.parameters, block.parameters, strict=True):
        variability = "fixed" if v.name in block.fixed else "tunable"
        start = {"start": repr(float(v.start))}
        add(reference, v, start, causality="parameter", variability=variability, initial="exact")
    for index, reference in enumerate(refs.derivatives):
        state = block.states[index]
        derivative = Variable(f"der({state.name})", _derivative_unit(state.unit), "local")
        link = {"derivative": str(refs.states[index] + 1)}  # indices of variables count from 1
        add(reference, derivative, link, causality="local", variability="continuous", initial="calculated")
    if refs.substeps is not None:
        element = ET.SubElement(
            parent,
            "ScalarVariable",
            name=SUBSTEPS_NAME,
            valueReference=str(refs.substeps),
            description="Integration substeps in a communication step; 0: chosen from the fastest rate",
            causality="parameter",
            variability="fixed",
            initial="exact",
        )
        ET.SubElement(element, "Integer", start="0", min="0")


def _add_structure(parent: ET.Element, block: Block) -> None:
    refs = layout(block)
    nx, nu, p = len(refs.states), len(refs.inputs), len(refs.parameters)
    x, u, q = ca.MX.sym("x", nx), ca.MX.sym("u", nu), ca.MX.sym("p", p)
    running = ca.Function("running", [x, u, q], [block.output(x, u, q), block.update(x, u, q)])
    first = block.start(u, q)
    initial = ca.Function("initial", [u, q], [block.output(first, u, q), block.update(first, u, q), first])
    # A sampled block has no continuous states, and FMI 2.0 does not list discrete ones as knowns.
    knowns = [(1, refs.inputs)] if block.sample_time is not None else [(1, refs.inputs), (0, refs.states)]
    initial_knowns = [(0, refs.inputs), (1, refs.parameters)]

    def add(name: str, function: ca.Function, unknowns: dict[int, range], given: list[tuple[int, range]]) -> None:
        if not any(unknowns.values()):
            return
        group = ET.SubElement(parent, name)
        found = {
            reference: dependency
            for result, references in unknowns.items()
            if references
            for reference, dependency in zip(references, _dependencies(function, result, given), strict=True)
        }
        for reference in sorted(found):
            dependencies = " ".join(str(known + 1) for known in sorted(found[reference]))
            ET.SubElement(group, "Unknown", index=str(reference + 1), dependencies=dependencies)

    add("Outputs", running, {0: refs.outputs}, knowns)
    add("Derivatives", running, {1: refs.derivatives}, knowns)
    initial_unknowns = {0: refs.outputs}
    if block.sample_time is None:
        initial_unknowns |= {1: refs.derivatives, 2: refs.states}
    add("InitialUnknowns", initial, initial_unknowns, initial_knowns)


def _dependencies(function: ca.Function, result: int, given: Iterable[tuple[int, range]]) -> list[set[int]]:
    """For each row of a result of a function, the value references of the arguments it depends on."""
    rows: list[set[int]] = [set() for _ in range(function.numel_out(result))]
    for argument, references in given:
        if not references or not rows:
            continue
        row_indices, columns = function.jac_sparsity(result, argument).get_triplet()
        for row, column in zip(row_indices, columns, strict=True):
            rows[row].add(references[column])
    return rows
