"""modelDescription.xml and buildDescription.xml of an exported block, for FMI 3.0.

Source: "Functional Mock-up Interface Specification", version 3.0, sections 2.4 and 2.5.1.
"""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree import ElementTree as ET

from fmu_didim.block import Block
from fmu_didim.export.c_code import SUBSTEPS_DESCRIPTION, SUBSTEPS_NAME, TIME_NAME, check_exportable, layout
from fmu_didim.export.structure import model_structure
from fmu_didim.export.units import add_units
from fmu_didim.export.variables import exported_variables
from fmu_didim.export.xml_file import document, stated


def model_description(block: Block, *, token: str, generation_tool: str) -> str:
    """The text of modelDescription.xml of a block, for co-simulation and model exchange.

    Value references are those of :func:`fmu_didim.export.c_code.layout`, and the variables stand in
    that order; the independent variable ``time`` is the last one.

    Args:
        block: the block.
        token: the instantiation token compiled into the binary.
        generation_tool: name and version of the exporter.

    Raises:
        InputError: a name or a start value cannot be exported.
    """
    check_exportable(block, fmi_version="3.0")
    root = ET.Element("fmiModelDescription", fmiVersion="3.0", modelName=block.name, instantiationToken=token)
    if block.description:
        root.set("description", block.description)
    root.set("generationTool", generation_tool)
    root.set("variableNamingConvention", "flat")
    common = {
        "modelIdentifier": block.name,
        "canBeInstantiatedOnlyOncePerProcess": "false",
        "canGetAndSetFMUState": "true",
        "canSerializeFMUState": "true",
        "providesDirectionalDerivatives": "true",
        "providesAdjointDerivatives": "false",
    }
    ET.SubElement(root, "ModelExchange", common | {"needsCompletedIntegratorStep": "false"})
    steps = {"canHandleVariableCommunicationStepSize": "true", "hasEventMode": "false"}
    ET.SubElement(root, "CoSimulation", common | steps)
    add_units(root, block, time=True)
    categories = ET.SubElement(root, "LogCategories")
    ET.SubElement(categories, "Category", name="logStatusError", description="Errors; they are always logged.")
    if block.sample_time is not None:
        ET.SubElement(root, "DefaultExperiment", startTime="0", stepSize=repr(block.sample_time))
    _add_variables(ET.SubElement(root, "ModelVariables"), block)
    structure = model_structure(block)
    element = ET.SubElement(root, "ModelStructure")
    for kind, unknowns in (
        ("Output", structure.outputs),
        ("ContinuousStateDerivative", structure.derivatives),
        ("InitialUnknown", structure.initial),
    ):
        for reference, known in unknowns.items():
            ET.SubElement(element, kind, valueReference=str(reference), dependencies=" ".join(map(str, known)))
    return document(root)


def build_description(block: Block, *, source_files: Sequence[str]) -> str:
    """The text of sources/buildDescription.xml: the files to compile (not those they include)."""
    root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = ET.SubElement(root, "BuildConfiguration", modelIdentifier=block.name)
    group = ET.SubElement(configuration, "SourceFileSet", language="C99")
    for name in source_files:
        ET.SubElement(group, "SourceFile", name=name)
    return document(root)


def _add_variables(parent: ET.Element, block: Block) -> None:
    refs = layout(block)
    for v in exported_variables(block):
        named = stated(name=v.own.name, valueReference=str(v.reference), description=v.own.description, **v.attributes)
        link = None if v.state is None else str(v.state)
        ET.SubElement(parent, "Float64", named | stated(start=v.start, derivative=link, unit=v.own.unit))
    if refs.substeps is not None:
        ET.SubElement(
            parent,
            "Int32",
            name=SUBSTEPS_NAME,
            valueReference=str(refs.substeps),
            description=SUBSTEPS_DESCRIPTION,
            causality="parameter",
            variability="fixed",
            initial="exact",
            start="0",
            min="0",
        )
    time = {"causality": "independent", "variability": "continuous", "unit": "s"}
    ET.SubElement(parent, "Float64", {"name": TIME_NAME, "valueReference": str(refs.time), **time})
