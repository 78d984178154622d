"""modelDescription.xml of an exported block, for FMI 2.0.

Source: "Functional Mock-up Interface for Model Exchange and Co-Simulation", version 2.0, section 2.2.
"""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree import ElementTree as ET

from fmu_didim.block import Block
from fmu_didim.export.c_code import SUBSTEPS_DESCRIPTION, SUBSTEPS_NAME, check_exportable, layout
from fmu_didim.export.structure import model_structure
from fmu_didim.export.units import add_units
from fmu_didim.export.variables import exported_variables
from fmu_didim.export.xml_file import document, stated


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
    add_units(root, block)
    categories = ET.SubElement(root, "LogCategories")
    ET.SubElement(categories, "Category", name="logStatusError", description="Errors; they are always logged.")
    if sampled:
        ET.SubElement(root, "DefaultExperiment", startTime="0", stepSize=repr(block.sample_time))
    _add_variables(ET.SubElement(root, "ModelVariables"), block)
    structure = model_structure(block)
    element = ET.SubElement(root, "ModelStructure")
    for kind, unknowns in (
        ("Outputs", structure.outputs),
        ("Derivatives", structure.derivatives),
        ("InitialUnknowns", structure.initial),
    ):
        group = ET.SubElement(element, kind) if unknowns else element
        for reference, known in unknowns.items():  # indices of variables count from 1
            dependencies = " ".join(str(other + 1) for other in known)
            ET.SubElement(group, "Unknown", index=str(reference + 1), dependencies=dependencies)
    return document(root)


def _add_variables(parent: ET.Element, block: Block) -> None:
    for v in exported_variables(block):
        named = stated(name=v.own.name, valueReference=str(v.reference), description=v.own.description, **v.attributes)
        link = None if v.state is None else str(v.state + 1)  # indices of variables count from 1
        element = ET.SubElement(parent, "ScalarVariable", named)
        ET.SubElement(element, "Real", stated(unit=v.own.unit, start=v.start, derivative=link))
    refs = layout(block)
    if refs.substeps is not None:
        element = ET.SubElement(
            parent,
            "ScalarVariable",
            name=SUBSTEPS_NAME,
            valueReference=str(refs.substeps),
            description=SUBSTEPS_DESCRIPTION,
            causality="parameter",
            variability="fixed",
            initial="exact",
        )
        ET.SubElement(element, "Integer", start="0", min="0")
