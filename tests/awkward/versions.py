"""Model descriptions of the slaves for other versions, types and modes of FMI."""

from __future__ import annotations

from pathlib import Path

from tests.awkward.build import library, pack

SLAVE_1 = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="1.0" modelName="slave1" modelIdentifier="slave1" guid="awkward"
    numberOfContinuousStates="1" numberOfEventIndicators="0">
  <DefaultExperiment startTime="0" stopTime="1"/>
  <ModelVariables>
    <ScalarVariable name="u" valueReference="0" causality="input"><Real start="0"{u_unit}/></ScalarVariable>
    <ScalarVariable name="y" valueReference="1" causality="output"><Real/>
      <DirectDependency><Name>u</Name></DirectDependency></ScalarVariable>
    <ScalarVariable name="minus_y" valueReference="1" causality="output" alias="negatedAlias"><Real/></ScalarVariable>
    <ScalarVariable name="steps" valueReference="7" causality="output" variability="discrete"><Integer/>
      <DirectDependency/></ScalarVariable>
    <ScalarVariable name="a" valueReference="2" variability="parameter"><Real start="2"/></ScalarVariable>
    <ScalarVariable name="d" valueReference="3" variability="parameter"><Real start="0.5"/></ScalarVariable>
    <ScalarVariable name="n" valueReference="4" variability="parameter"><Integer start="1"/></ScalarVariable>
    <ScalarVariable name="flip" valueReference="5" variability="parameter"><Boolean start="false"/></ScalarVariable>
    <ScalarVariable name="label" valueReference="6" variability="parameter"><String start="x"/></ScalarVariable>
    <ScalarVariable name="words" valueReference="6" causality="input"><String start="x"/></ScalarVariable>
  </ModelVariables>
  {implementation}
</fmiModelDescription>
"""
STAND_ALONE = """<Implementation><CoSimulation_StandAlone><Capabilities canHandleVariableCommunicationStepSize="true"/>
  </CoSimulation_StandAlone></Implementation>"""

TYPED_2 = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="typed2" guid="awkward">
  <CoSimulation modelIdentifier="typed2"/>
  <TypeDefinitions><SimpleType name="Mode"><Enumeration><Item name="slow" value="1"/><Item name="fast" value="2"/>
    </Enumeration></SimpleType></TypeDefinitions>
  <ModelVariables>
    <ScalarVariable name="gear" valueReference="2" causality="input" variability="discrete">
      <Integer start="1"/></ScalarVariable>
    <ScalarVariable name="u" valueReference="0" causality="input"><Real start="0" unit="deg"/></ScalarVariable>
    <ScalarVariable name="on" valueReference="4" causality="input" variability="discrete">
      <Boolean start="true"/></ScalarVariable>
    <ScalarVariable name="mode" valueReference="6" causality="input" variability="discrete">
      <Enumeration declaredType="Mode" start="1"/></ScalarVariable>
    <ScalarVariable name="words" valueReference="8" causality="input" variability="discrete">
      <String start="none"/></ScalarVariable>
    <ScalarVariable name="y" valueReference="1" causality="output"><Real unit="deg"/></ScalarVariable>
    <ScalarVariable name="off" valueReference="5" causality="output" variability="discrete"><Boolean/></ScalarVariable>
    <ScalarVariable name="mode_out" valueReference="7" causality="output" variability="discrete">
      <Enumeration declaredType="Mode"/></ScalarVariable>
    <ScalarVariable name="double_gear" valueReference="3" causality="output" variability="discrete">
      <Integer/></ScalarVariable>
  </ModelVariables>
  <ModelStructure><Outputs>
    <Unknown index="6" dependencies="1 2 3"/><Unknown index="7" dependencies="3"/><Unknown index="8"/>
    <Unknown index="9" dependencies=""/>
  </Outputs></ModelStructure>
</fmiModelDescription>
"""

TYPES_3 = (
    "Float64", "Float32", "Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64", "Boolean",
    "Enumeration",
)  # fmt: skip


def _typed_3() -> str:
    rows, structure = [], []
    for k, name in enumerate(TYPES_3):
        more = ' declaredType="Mode"' if name == "Enumeration" else ""
        size = '<Dimension start="2"/>' if name == "Int16" else ""
        start = "false" if name == "Boolean" else "1 1" if name == "Int16" else "1"
        head = f'variability="discrete"{more}'
        rows += [
            f'<{name} name="u_{name}" valueReference="{2 * k}" causality="input" {head} start="{start}">',
            f"{size}</{name}>",
            f'<{name} name="y_{name}" valueReference="{2 * k + 1}" causality="output" {head}>{size}</{name}>',
        ]
        structure.append(f'<Output valueReference="{2 * k + 1}" dependencies="{2 * k}"/>')
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="typed3" instantiationToken="awkward">
  <CoSimulation modelIdentifier="typed3"/>
  <TypeDefinitions><EnumerationType name="Mode"><Item name="slow" value="1"/><Item name="fast" value="2"/>
    </EnumerationType></TypeDefinitions>
  <ModelVariables>{"".join(rows)}</ModelVariables>
  <ModelStructure>{"".join(structure)}</ModelStructure>
</fmiModelDescription>
"""


TYPED_3 = _typed_3()

CLOCKED = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="clocked" instantiationToken="awkward">
  <{interface} modelIdentifier="clocked" {abilities} canGetAndSetFMUState="true"/>
  <DefaultExperiment stepSize="0.01"/>
  <ModelVariables>
    <Float64 name="r" valueReference="0" causality="input" variability="discrete" {clocks} start="0"/>
    <Float64 name="y" valueReference="1" causality="input" variability="discrete" {clocks} start="0"/>
    <Float64 name="u" valueReference="2" causality="output" variability="discrete" {clocks}/>
    <Float64 name="kp" valueReference="3" causality="parameter" variability="tunable" start="3"/>
    <Float64 name="ki" valueReference="4" causality="parameter" variability="tunable" start="5"/>
    {clock}
    <Int32 name="ticks" valueReference="6" causality="output"/>
  </ModelVariables>
  <ModelStructure><Output valueReference="2" dependencies="0 1"/><Output valueReference="6" dependencies=""/>
  </ModelStructure>
</fmiModelDescription>
"""
CLOCK = (
    '<Clock name="sample" valueReference="5" causality="{causality}" intervalVariability="{variability}" {interval}/>'
)

SAWTOOTH = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="sawtooth" instantiationToken="awkward">
  <CoSimulation modelIdentifier="sawtooth" hasEventMode="{events}" canHandleVariableCommunicationStepSize="true"/>
  <ModelVariables>
    <Float64 name="u" valueReference="0" causality="input" start="0"/>
    <Float64 name="x" valueReference="1" causality="output"/>
    <Int32 name="jumps" valueReference="2" causality="output"/>
  </ModelVariables>
  <ModelStructure><Output valueReference="1" dependencies=""/><Output valueReference="2" dependencies=""/>
  </ModelStructure>
</fmiModelDescription>
"""


def fmi_1(folder: Path, *macros: str, u_unit: str = "", implementation: str = STAND_ALONE) -> Path:
    """The slave of FMI 1.0."""
    xml = SLAVE_1.format(u_unit=u_unit, implementation=implementation)
    return pack(folder / "slave1.fmu", xml, library("slave1", *macros))


def typed(folder: Path, version: int) -> Path:
    """The slave with values of all types, of FMI 2.0 or 3.0."""
    return pack(folder / f"typed{version}.fmu", {2: TYPED_2, 3: TYPED_3}[version], library(f"typed{version}"))


def clocked(
    folder: Path,
    *,
    plain: bool = False,
    interface: str = "CoSimulation",
    abilities: str = 'hasEventMode="true"',
    causality: str = "input",
    variability: str = "constant",
    interval: str = 'intervalDecimal="0.01"',
) -> Path:
    """The PI controller on a clock, or without one."""
    clock = "" if plain else CLOCK.format(causality=causality, variability=variability, interval=interval)
    xml = CLOCKED.format(
        interface=interface, abilities="" if plain else abilities, clocks="" if plain else 'clocks="5"', clock=clock
    )
    name = "plain" if plain else "clocked"
    return pack(folder / f"{name}.fmu", xml, library("clocked", *(["PLAIN"] if plain else [])))


def sawtooth(folder: Path, *macros: str, events: bool = True) -> Path:
    """The slave with an event."""
    xml = SAWTOOTH.format(events=str(events).lower())
    return pack(folder / f"sawtooth{'_'.join(macros)}.fmu", xml, library("sawtooth", *macros))
