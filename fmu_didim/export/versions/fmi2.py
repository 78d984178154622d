"""FMI 2.0: modelDescription.xml of an exported block.

Source: "Functional Mock-up Interface for Model Exchange and Co-Simulation", version 2.0, section 2.2.
"""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree import ElementTree as ET

from fmu_didim.base.files import file_name
from fmu_didim.dynamics.block import Block
from fmu_didim.export.platforms import Platform
from fmu_didim.export.structure import model_structure
from fmu_didim.export.units import add_units
from fmu_didim.export.variables import SUBSTEPS_ATTRIBUTES, TOLERANCE_ATTRIBUTES, exported_variables, layout
from fmu_didim.export.versions.base import WrittenVersion
from fmu_didim.export.xml_file import add_defaults, document, stated

_MAIN = "fmi2.c"


def _model_description(block: Block, guid: str, tool: str, directional: bool) -> str:
    """The variables stand in the order of their value references."""
    about = stated(modelName=block.name, guid=guid, description=block.description, generationTool=tool)
    fixed = {"variableNamingConvention": "flat", "numberOfEventIndicators": "0"}
    root = ET.Element("fmiModelDescription", {"fmiVersion": "2.0"} | about | fixed)
    common = {
        "modelIdentifier": file_name(block.name),
        "canNotUseMemoryManagementFunctions": "true",
        "canGetAndSetFMUstate": "true",
        "canSerializeFMUstate": "true",
        "providesDirectionalDerivative": str(directional).lower(),
        "canBeInstantiatedOnlyOncePerProcess": "false",
    }
    exchange = ET.SubElement(root, "ModelExchange", {**common, "completedIntegratorStepNotNeeded": "true"})
    simulation = ET.SubElement(root, "CoSimulation", {**common, "canHandleVariableCommunicationStepSize": "true"})
    for interface in (exchange, simulation):
        files = ET.SubElement(interface, "SourceFiles")
        ET.SubElement(files, "File", name=_MAIN)
    add_units(root, block)
    add_defaults(root, block.sample_time)
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
        named = SUBSTEPS_ATTRIBUTES | {"valueReference": str(refs.substeps)}
        ET.SubElement(ET.SubElement(parent, "ScalarVariable", named), "Integer", start="0", min="0")
        named = TOLERANCE_ATTRIBUTES | {"valueReference": str(refs.tolerance)}
        ET.SubElement(ET.SubElement(parent, "ScalarVariable", named), "Real", start="0", min="0")


def _folders(platforms: Sequence[Platform], host: Platform) -> dict[str, Platform]:
    """The bits for Intel's processors, and since 2.0.4 the tuples of FMI 3.0 for all others (section 2.3).

    An ARM machine's own binary also goes where tools on that machine look for it that know only ``linux64`` and
    ``darwin64`` (FMPy 0.3 is one), unless the standard's owner of that folder is there.
    """
    folders = {p.bits_folder if p.architecture in ("x86", "x86_64") else p.tuple_folder: p for p in platforms}
    if host in platforms:
        folders.setdefault(host.bits_folder, host)
    return folders


FMI_2 = WrittenVersion(name="2.0", main=_MAIN, describe=_model_description, folders=_folders)
