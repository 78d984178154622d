"""FMI 3.0: modelDescription.xml and buildDescription.xml of an exported block.

Source: "Functional Mock-up Interface Specification", version 3.0, sections 2.4 and 2.5.1.
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

_MAIN, _TIME = "fmi3.c", "time"


def _model_description(block: Block, token: str, tool: str, directional: bool) -> str:
    """The variables stand in the order of their value references; the independent one, ``time``, is the last."""
    about = stated(modelName=block.name, instantiationToken=token, description=block.description, generationTool=tool)
    root = ET.Element("fmiModelDescription", {"fmiVersion": "3.0"} | about, variableNamingConvention="flat")
    common = {
        "modelIdentifier": file_name(block.name),
        "canBeInstantiatedOnlyOncePerProcess": "false",
        "canGetAndSetFMUState": "true",
        "canSerializeFMUState": "true",
        "providesDirectionalDerivatives": str(directional).lower(),
        "providesAdjointDerivatives": "false",
    }
    ET.SubElement(root, "ModelExchange", common | {"needsCompletedIntegratorStep": "false"})
    steps = {"canHandleVariableCommunicationStepSize": "true", "hasEventMode": "false"}
    ET.SubElement(root, "CoSimulation", common | steps)
    add_units(root, block, time=True)
    add_defaults(root, block.sample_time)
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


def _build_description(block: Block) -> dict[str, str]:
    """The files to compile (not those they include)."""
    root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = ET.SubElement(root, "BuildConfiguration", modelIdentifier=file_name(block.name))
    group = ET.SubElement(configuration, "SourceFileSet", language="C99")
    ET.SubElement(group, "SourceFile", name=_MAIN)
    return {"buildDescription.xml": document(root)}


def _add_variables(parent: ET.Element, block: Block) -> None:
    refs = layout(block)
    for v in exported_variables(block):
        named = stated(name=v.own.name, valueReference=str(v.reference), description=v.own.description, **v.attributes)
        link = None if v.state is None else str(v.state)
        ET.SubElement(parent, "Float64", named | stated(start=v.start, derivative=link, unit=v.own.unit))
    if refs.substeps is not None:
        numbers = {"valueReference": str(refs.substeps), "start": "0", "min": "0"}
        ET.SubElement(parent, "Int32", SUBSTEPS_ATTRIBUTES | numbers)
        ET.SubElement(parent, "Float64", TOLERANCE_ATTRIBUTES | numbers | {"valueReference": str(refs.tolerance)})
    time = {"causality": "independent", "variability": "continuous", "unit": "s"}
    ET.SubElement(parent, "Float64", {"name": _TIME, "valueReference": str(refs.time), **time})


def _folders(platforms: Sequence[Platform], host: Platform) -> dict[str, Platform]:
    """Platform tuples (section 2.5.1.4.1)."""
    return {p.tuple_folder: p for p in platforms}


FMI_3 = WrittenVersion(
    name="3.0",
    main=_MAIN,
    describe=_model_description,
    folders=_folders,
    sources=_build_description,
    own_names=(_TIME,),
)
