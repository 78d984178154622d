"""Packs the C sources of this folder as FMUs; the libraries are kept in the cache, nothing is written here."""

from __future__ import annotations

import hashlib
import shutil
import zipfile
from functools import cache
from pathlib import Path

import fmpy

from fmu_didim.base.cache import cached_folder
from fmu_didim.export import compile_shared_library

HERE = Path(__file__).parent

SLAVE = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="slave" guid="awkward">
  <CoSimulation modelIdentifier="slave" canGetAndSetFMUstate="true" canHandleVariableCommunicationStepSize="true"/>
  <UnitDefinitions>{definitions}</UnitDefinitions>
  <DefaultExperiment{step}/>
  <ModelVariables>
    <ScalarVariable name="{u}" valueReference="0" causality="input"><Real start="0"{u_unit}/></ScalarVariable>
    <ScalarVariable name="{y}" valueReference="1" causality="output"><Real{y_unit}/></ScalarVariable>
    <ScalarVariable name="a" valueReference="2" causality="parameter" variability="{variability}">
      <Real start="2"{a_unit}/></ScalarVariable>
    <ScalarVariable name="d" valueReference="3" causality="parameter" variability="{variability}">
      <Real start="0.5"/></ScalarVariable>
    <ScalarVariable name="unused" valueReference="4" causality="parameter" variability="{variability}">
      <Real start="0"/></ScalarVariable>
    <ScalarVariable name="n" valueReference="5" causality="parameter" variability="fixed">
      <Integer start="1"/></ScalarVariable>
    <ScalarVariable name="flip" valueReference="6" causality="parameter" variability="fixed">
      <Boolean start="false"/></ScalarVariable>
    <ScalarVariable name="label" valueReference="7" causality="parameter" variability="fixed">
      <String start="single"/></ScalarVariable>
    <ScalarVariable name="twice_a" valueReference="9" causality="calculatedParameter" variability="fixed">
      <Real/></ScalarVariable>
    <ScalarVariable name="internal" valueReference="10" initial="exact"><Real start="0"/></ScalarVariable>
  </ModelVariables>
  <ModelStructure><Outputs><Unknown index="2"{dependencies}/></Outputs></ModelStructure>
</fmiModelDescription>
"""

EVENTS = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="events" guid="awkward" numberOfEventIndicators="1">
  <ModelExchange modelIdentifier="events"/>
  <ModelVariables>
    <ScalarVariable name="u" valueReference="0" causality="input"><Real start="0"/></ScalarVariable>
    <ScalarVariable name="y" valueReference="1" causality="output"><Real/></ScalarVariable>
    <ScalarVariable name="x" valueReference="2"><Real/></ScalarVariable>
    <ScalarVariable name="der(x)" valueReference="3"><Real derivative="3"/></ScalarVariable>
  </ModelVariables>
  <ModelStructure><Derivatives><Unknown index="4"/></Derivatives></ModelStructure>
</fmiModelDescription>
"""

ARRAYS = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="arrays" instantiationToken="awkward">
  <CoSimulation modelIdentifier="arrays"/>
  <ModelVariables>
    <Float64 name="u" valueReference="0" causality="input" start="0 0"><Dimension start="2"/></Float64>
    <Float64 name="y" valueReference="1" causality="output"><Dimension start="2"/></Float64>
    <Float64 name="A" valueReference="2" causality="parameter" variability="fixed" start="1 0 0 1">
      <Dimension start="2"/><Dimension start="2"/></Float64>
    <Float64 name="z" valueReference="3" causality="output"/>
    <Int32 name="n" valueReference="4" causality="parameter" variability="fixed" start="1"/>
    <Boolean name="off" valueReference="5" causality="parameter" variability="fixed" start="false"/>
  </ModelVariables>
  <ModelStructure><Output valueReference="1"/><Output valueReference="3"/></ModelStructure>
</fmiModelDescription>
"""

TENSORS = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="tensors" instantiationToken="awkward">
  <CoSimulation modelIdentifier="tensors" canHandleVariableCommunicationStepSize="true"/>
  <ModelVariables>
    <Float64 name="u" valueReference="0" causality="input" start="0 0"><Dimension start="2"/></Float64>
    <Float64 name="V" valueReference="1" causality="input" start="0 0 0 0 0 0">
      <Dimension start="2"/><Dimension start="3"/></Float64>
    <Float64 name="S" valueReference="2" causality="input" start="0 0 0 0 0 0 0 0 0 0 0 0">
      <Dimension start="2"/><Dimension start="2"/><Dimension start="3"/></Float64>
    <Float64 name="a" valueReference="3" causality="parameter" variability="tunable" start="1 2">
      <Dimension start="2"/></Float64>
    <Float64 name="B" valueReference="4" causality="parameter" variability="fixed" start="1 2 3 4 5 6">
      <Dimension start="2"/><Dimension start="3"/></Float64>
    <Float64 name="T" valueReference="5" causality="parameter" variability="fixed" start="1 2 3 4 5 6 7 8 9 10 11 12">
      <Dimension start="2"/><Dimension start="2"/><Dimension start="3"/></Float64>
    <Float64 name="y" valueReference="6" causality="output"><Dimension start="2"/></Float64>
    <Float64 name="Y" valueReference="7" causality="output"><Dimension start="2"/><Dimension start="3"/></Float64>
    <Float64 name="Z" valueReference="8" causality="output">
      <Dimension start="2"/><Dimension start="2"/><Dimension start="3"/></Float64>
    <Float64 name="time" valueReference="9" causality="independent"/>
  </ModelVariables>
  <ModelStructure>
    <Output valueReference="6" dependencies=""/><Output valueReference="7" dependencies="1"/>
    <Output valueReference="8" dependencies="2"/>
  </ModelStructure>
</fmiModelDescription>
"""
"""Arrays of one, two and three dimensions; y follows no input at once."""

DEFAULTS = {
    "u": "u",
    "y": "y",
    "u_unit": "",
    "y_unit": "",
    "a_unit": "",
    "variability": "tunable",
    "definitions": "",
    "dependencies": "",
    "step": ' stepSize="0.01"',
}


@cache
def library(source: str, *macros: str) -> Path:
    """The shared library of a C file with some macros defined, compiled once."""
    text = (HERE / f"{source}.c").read_text(encoding="utf-8")
    code = "".join(f"#define {macro}\n" for macro in macros) + text
    key = hashlib.sha256(f"{code}{fmpy.platform_tuple}".encode()).hexdigest()
    name = f"{source}{fmpy.sharedLibraryExtension}"

    def fill(folder: Path) -> None:
        (folder / "main.c").write_text(code, encoding="utf-8")
        compile_shared_library(folder, folder / name, main="main.c")

    return cached_folder("awkward", key, fill) / name


def pack(path: Path, xml: str, binary: Path | None, *, place: str | None = None, name: str | None = None) -> Path:
    """Write an FMU from a model description and a library.

    Args:
        place: folder in ``binaries``, default the one for this platform; name: of the library there.
    """
    major = 3 if 'fmiVersion="3' in xml else 2
    folder = place or (fmpy.platform_tuple if major == 3 else fmpy.platform)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", xml)
        if binary is not None:
            with archive.open(f"binaries/{folder}/{name or binary.name}", "w") as target, binary.open("rb") as source:
                shutil.copyfileobj(source, target)
    return path


def awkward_fmu(folder: Path, *macros: str, **options: str) -> Path:
    """A slave of ``slave.c`` with these faults; options fill in its model description."""
    path = folder / ("_".join(macros) or "plain").lower()
    return pack(path.with_suffix(".fmu"), SLAVE.format(**{**DEFAULTS, **options}), library("slave", *macros))


def by(tool: str, fmu: Path) -> Path:
    """The same FMU, said to come from another tool."""
    copy = fmu.with_name(f"{tool.split()[0].lower()}.fmu")
    with zipfile.ZipFile(fmu) as old, zipfile.ZipFile(copy, "w", zipfile.ZIP_DEFLATED) as new:
        for item in old.infolist():
            content = old.read(item)
            if item.filename == "modelDescription.xml":
                before = content.decode("utf-8")
                start = before.index('generationTool="') + len('generationTool="')
                content = (before[:start] + tool + before[before.index('"', start) :]).encode("utf-8")
            new.writestr(item, content)
    return copy
