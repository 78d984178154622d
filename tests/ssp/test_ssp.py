"""SSP archives: read back as written, foreign ones understood as the standard says, bad ones refused."""

from __future__ import annotations

import json
import math
import re
import zipfile
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import yaml
from fmpy.ssp.ssd import read_ssd, read_ssv

import fmu_didim
from fmu_didim import export_ssp, identify
from fmu_didim.base.errors import FmuDidimError, FmuError, InputError, UnknownNameError
from fmu_didim.case import load_case
from fmu_didim.components import Component, FmuComponent, load_fmu, rename
from fmu_didim.components.parameter_names import name_parameters
from fmu_didim.controllers import read_controller
from fmu_didim.cosim import Connection, System, simulate
from fmu_didim.data.signals import Trajectory, trajectory
from fmu_didim.dynamics.block import Block
from fmu_didim.export import build_fmu
from fmu_didim.fit.derivatives import sensitivity
from fmu_didim.report.numbers import loop_lines
from fmu_didim.ssp import read_ssp, write_ssp
from fmu_didim.ssp.transform import Unit, conversion
from tests.awkward.build import ARRAYS, awkward_fmu, library
from tests.awkward.build import pack as build_awkward
from tests.cases import scara_case
from tests.helpers import NEAR, PERIOD, ROOT, component, drive, loop, on_reference, reference, scara, scara_pd

SSP = "http://ssp-standard.org/SSP1/SystemStructure"
HEAD = (
    f'xmlns:ssd="{SSP}Description" xmlns:ssc="{SSP}Common" xmlns:ssv="{SSP}ParameterValues" '
    f'xmlns:ssm="{SSP}ParameterMapping" version="1.0"'
)
TORQUES = ["plant.tau1", "plant.tau2"]
DEG = math.pi / 180
KELVIN = (0, 0, 0, 0, 1, 0, 0, 0)


@cache
def plant() -> FmuComponent:
    return load_fmu(build_fmu(scara().block()))


@cache
def controller() -> FmuComponent:
    return load_fmu(build_fmu(read_controller(ROOT / "controllers/scara_pd.yaml")))


@cache
def motion() -> Trajectory:
    return reference(0.5)


def direct(**options: Any) -> System:
    return loop(plant(), controller(), motion(), **options)


def outputs(system: System, along: Trajectory | None = None) -> dict[str, np.ndarray]:
    """All recorded commands and motions."""
    return dict(simulate(system, along or motion()).applied)


def assert_same(left: Mapping[str, np.ndarray], right: Mapping[str, np.ndarray], tolerance: float = 1e-12) -> None:
    shared = [name for name in left if name in right and not name.startswith("reference.")]
    assert {"controller.command1", "controller.command2", "plant.q1", "plant.ddq2"} <= set(shared)
    for name in shared:
        assert np.abs(left[name] - right[name]).max() <= tolerance * np.abs(right[name]).max(), name


# Written and read back


@pytest.mark.parametrize("options", [{}, {"delay_samples": 1.3}, {"drive_gains": (1.5, -0.8)}])
def test_what_is_written_is_read_back_exactly(options: dict[str, Any], tmp_path: Path) -> None:
    system = direct(**options)
    if "drive_gains" in options:
        system = system.replace("controller", controller().with_parameters({"Kp1": 2000.0, "Kp2": -50.0, "Kd2": -3.0}))
    path = write_ssp(system, tmp_path / "scara.ssp", name="SCARA <loop> & drive")
    again = read_ssp(path)
    assert again.connections == system.connections
    assert (again.order, again.step_size, again.delays) == (system.order, system.step_size, system.delays)
    for name, part in system.components.items():
        assert again.components[name].parameter_values() == part.parameter_values()
        assert again.components[name].inputs == part.inputs
    assert_same(outputs(again), outputs(system))
    second = write_ssp(again, tmp_path / "again.ssp", name="SCARA <loop> & drive")
    assert second.read_bytes() == path.read_bytes()


def test_roles_start_values_and_integer_options_survive(tmp_path: Path) -> None:
    base = direct()
    part = rename(plant(), inputs={"torque1": "tau1"}, outputs={"angle1": "q1"}).with_substeps(16)
    assert part is not None
    part = part.with_names(tuple(replace(v, start=0.25) for v in part.inputs), part.outputs)
    links = tuple(
        replace(c, target=c.target.replace("plant.tau1", "plant.torque1"),
                source=c.source.replace("plant.q1", "plant.angle1"))
        for c in base.connections if c.target != "plant.tau2"
    )  # fmt: skip
    system = System({**base.components, "plant": on_reference(part, motion())}, links, base.order, PERIOD)
    again = read_ssp(write_ssp(system, tmp_path / "x.ssp", name="x"))
    assert again.connections == links
    assert [v.name for v in again.components["plant"].inputs] == ["torque1", "tau2"]
    assert [v.start for v in again.components["plant"].inputs] == [0.25, 0.25]
    assert again.components["plant"].describe()["options"] == {"substeps": 16}
    mine, theirs = outputs(again), outputs(system)
    for name in theirs:
        assert np.array_equal(mine[name], theirs[name])


def test_identified_parameters_act(tmp_path: Path) -> None:
    identified = {"ZZ1": 3.6, "Fv1": 0.05, "MX2": 0.2}
    path = write_ssp(direct(), tmp_path / "x.ssp", name="x", parameters={"plant": identified})
    again = read_ssp(path)
    wanted = direct()
    wanted = wanted.replace("plant", wanted.components["plant"].with_parameters(identified))
    assert_same(outputs(again), outputs(wanted))
    assert np.abs(outputs(again)["controller.command1"] - outputs(direct())["controller.command1"]).max() > 0.1
    values = {p.name: float(p.value) for p in read_ssv(str(path), "resources/plant.ssv").parameters}
    assert identified.items() <= values.items()


def test_another_tool_reads_it_and_the_schemas_accept_it(tmp_path: Path) -> None:
    path = write_ssp(direct(drive_gains=(1.5, 1.0)), tmp_path / "x.ssp", name="x", parameters={"plant": {"ZZ1": 3.6}})
    structure = read_ssd(str(path))  # validates SSD and SSV against the schemas of the standard
    assert structure.version == "1.0"
    assert [c.name for c in structure.system.elements] == ["controller", "plant"]
    assert len(structure.system.connections) == len(direct().connections)
    assert [c.name for c in structure.system.connectors] == ["q1", "dq1", "q2", "dq2"]
    with zipfile.ZipFile(path) as archive:
        assert archive.testzip() is None
        root = ET.fromstring(archive.read("SystemStructure.ssd"))
    assert root.tag == f"{{{SSP}Description}}SystemStructureDescription"
    transformations = root.findall(f".//{{{SSP}Common}}LinearTransformation")
    assert [t.get("factor") for t in transformations] == ["1.5"]


def test_a_gain_between_unlike_units_is_not_converted_again(tmp_path: Path) -> None:
    """A controller that works in degrees: the gain of the connection holds the conversion already."""
    block = scara_pd()
    units = {"rad": "deg", "rad/s": "deg/s"}
    block = replace(block, name="degrees", inputs=tuple(replace(v, unit=units[v.unit]) for v in block.inputs))
    law = load_fmu(build_fmu(block), si_units=False)
    base = loop(plant(), law, motion())
    links = tuple(replace(c, gain=1 / DEG) if c.target.startswith("controller") else c for c in base.connections)
    system = System(base.components, links, base.order, PERIOD)
    path = write_ssp(system, tmp_path / "x.ssp", name="x")
    read_ssd(str(path))
    again = read_ssp(path)
    assert again.connections == links
    # Shown in SI, its values are not those that an SSP would hold.
    shown = replace(system, components={**system.components, "controller": load_fmu(build_fmu(block))})
    with pytest.raises(InputError, match="an SSP holds the FMU's own"):
        write_ssp(shown, tmp_path / "y.ssp", name="y")


# Archives by hand


def fmu_files() -> dict[str, Path]:
    return {"resources/plant.fmu": plant().path, "resources/law.fmu": controller().path}


def pack(path: Path, files: Mapping[str, str | bytes | Path]) -> Path:
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in files.items():
            archive.writestr(name, content.read_bytes() if isinstance(content, Path) else content)
    return path


def connectors(names: str, kind: str, unit: str = "") -> str:
    real = f'<ssc:Real unit="{unit}"/>' if unit else "<ssc:Real/>"
    return "".join(f'<ssd:Connector name="{n}" kind="{kind}">{real}</ssd:Connector>' for n in names.split())


def link(source: str, target: str, inner: str = "", attributes: str = "") -> str:
    ends = []
    for side, end in (("start", source), ("end", target)):
        element, dot, connector = end.rpartition(".")
        ends.append((f'{side}Element="{element}" ' if dot else "") + f'{side}Connector="{connector}"')
    return f"<ssd:Connection {' '.join(ends)} {attributes}>{inner}</ssd:Connection>"


def element(name: str, source: str, content: str, bindings: str = "") -> str:
    bound = f"<ssd:ParameterBindings>{bindings}</ssd:ParameterBindings>" if bindings else ""
    return (
        f'<ssd:Component name="{name}" source="resources/{source}.fmu">'
        f"<ssd:Connectors>{content}</ssd:Connectors>{bound}</ssd:Component>"
    )


def values(rows: str, units: str = "") -> str:
    return f'<ssv:ParameterSet {HEAD} name="set"><ssv:Parameters>{rows}</ssv:Parameters>{units}</ssv:ParameterSet>'


def real(name: str, value: float, unit: str = "") -> str:
    stated = f' unit="{unit}"' if unit else ""
    return f'<ssv:Parameter name="{name}"><ssv:Real value="{value!r}"{stated}/></ssv:Parameter>'


def inline(rows: str, attributes: str = "") -> str:
    return (
        f"<ssd:ParameterBinding {attributes}><ssd:ParameterValues>{values(rows)}</ssd:ParameterValues>"
        "</ssd:ParameterBinding>"
    )


def linear(factor: float, offset: float = 0.0) -> str:
    return f'<ssc:LinearTransformation factor="{factor!r}" offset="{offset!r}"/>'


UNITS = (
    '<ssc:Unit name="deg"><ssc:BaseUnit rad="1" factor="0.017453292519943295"/></ssc:Unit>'
    '<ssc:Unit name="deg/s"><ssc:BaseUnit rad="1" s="-1" factor="0.017453292519943295"/></ssc:Unit>'
    '<ssc:Unit name="rad"><ssc:BaseUnit rad="1"/></ssc:Unit>'
    '<ssc:Unit name="cNm"><ssc:BaseUnit kg="1" m="2" s="-2" factor="0.01"/></ssc:Unit>'
    '<ssc:Unit name="volt"><ssc:BaseUnit kg="1" m="2" s="-3" A="-1"/></ssc:Unit>'
)
LAW_PORTS = connectors("q_ref1 dq_ref1 q1 dq1 q_ref2 dq_ref2 q2 dq2", "input") + connectors(
    "command1 command2", "output"
)
PLANT_PORTS = connectors("tau1 tau2", "input") + connectors("q1 q2 dq1 dq2", "output")
FEEDBACK = tuple(link(f"plant.{s}{j}", f"law.{s}{j}") for s in ("q", "dq") for j in (1, 2))
FORWARD = tuple(link(f"law.command{j}", f"plant.tau{j}") for j in (1, 2))
WANTED = tuple(link(f"{s}{j}", f"law.{s}_ref{j}") for s in ("q", "dq") for j in (1, 2))
LINKS = (*WANTED, *FEEDBACK, *FORWARD)


def ssd(
    *,
    links: tuple[str, ...] = LINKS,
    ports: str | None = None,
    elements: str | None = None,
    bindings: str = "",
    annotations: str = "",
) -> str:
    """A description, by default of the SCARA loop with the plant named first."""
    own = connectors("q1 dq1 q2 dq2", "input", "") if ports is None else ports
    inner = elements if elements is not None else element("plant", "plant", PLANT_PORTS) + element(
        "law", "law", LAW_PORTS
    )  # fmt: skip
    bound = f"<ssd:ParameterBindings>{bindings}</ssd:ParameterBindings>" if bindings else ""
    return (
        f'<?xml version="1.0" encoding="UTF-8"?><ssd:SystemStructureDescription {HEAD} name="x"><ssd:System name="s">'
        f"<ssd:Connectors>{own}</ssd:Connectors>{bound}<ssd:Elements>{inner}</ssd:Elements>"
        f"<ssd:Connections>{''.join(links)}</ssd:Connections>{annotations}</ssd:System>"
        f"<ssd:Units>{UNITS}</ssd:Units></ssd:SystemStructureDescription>"
    )


def by_hand(path: Path, text: str, extra: Mapping[str, str] | None = None) -> Path:
    return pack(path / "hand.ssp", {"SystemStructure.ssd": text, **fmu_files(), **(extra or {})})


def equivalent(
    plant_values: Mapping[str, float], law_values: Mapping[str, float] | None = None, extra: tuple[Connection, ...] = ()
) -> System:
    """The same loop in Python, with the names of the archive."""
    law: Component = controller().with_parameters(law_values or {})
    links = [Connection(f"reference.{s}{j}", f"law.{s}_ref{j}") for s in ("q", "dq") for j in (1, 2)]
    links += [Connection(f"plant.{s}{j}", f"law.{s}{j}") for s in ("q", "dq") for j in (1, 2)]
    links += [Connection(f"law.command{j}", f"plant.tau{j}") for j in (1, 2)]
    kept = [c for c in links if c.target not in {e.target for e in extra} or c.target.startswith("plant")]
    kept = [c for c in kept if (c.source, c.target) not in {(e.source, e.target) for e in extra}]
    parts = {"law": law, "plant": plant().with_parameters(plant_values)}
    return System(parts, (*kept, *extra), ("law", "plant"), PERIOD)


def assert_equal_torque(archive: System, python: System, mine: Trajectory, theirs: Trajectory) -> None:
    left, right = outputs(archive, mine), outputs(python, theirs)
    for name in ("law.command1", "law.command2", "plant.q1", "plant.q2"):
        assert np.abs(left[name] - right[name]).max() <= 1e-12 * np.abs(right[name]).max(), name


def start_values() -> dict[str, float]:
    row = dict(zip(motion().names, motion().values[0], strict=True))
    return {f"{s}_start{j}": float(row[f"{s}{j}"]) for s in ("q", "dq") for j in (1, 2)}


def started(rows: str = "") -> str:
    return inline("".join(real(n, v) for n, v in start_values().items()) + rows)


def test_an_archive_by_hand_gives_order_and_step_without_annotation(tmp_path: Path) -> None:
    elements = element("plant", "plant", PLANT_PORTS, started()) + element("law", "law", LAW_PORTS)
    system = read_ssp(by_hand(tmp_path, ssd(elements=elements)))
    assert system.order == ("law", "plant")  # fed by the reference: first
    assert system.step_size == PERIOD  # of the FMU of the controller
    assert_equal_torque(system, equivalent(start_values()), motion(), motion())
    assert read_ssp(tmp_path / "hand.ssp", step_size=0.0025).step_size == 0.0025


def test_units_transformations_and_offsets_of_connections(tmp_path: Path) -> None:
    ports = (
        connectors("q1 q2", "input", "deg") + connectors("dq1 dq2", "input") + connectors("seen", "output", "deg")
    )  # fmt: skip
    elements = element("plant", "plant", PLANT_PORTS, started()) + element("law", "law", LAW_PORTS)
    links = (
        *WANTED,
        *FEEDBACK,
        link("plant.q1", "seen"),
        link("law.command1", "plant.tau1", linear(1.5)),
        link("law.command2", "plant.tau2", linear(1.0, 0.07)),
    )
    system = read_ssp(by_hand(tmp_path, ssd(links=links, ports=ports, elements=elements)))
    assert Connection("law.command1", "plant.tau1", 1.5) in system.connections
    assert len(system.components) == 3
    # The same in Python: degrees by a gain, the offset by a column of ones.
    extra = (
        Connection("reference.q1", "law.q_ref1", DEG),
        Connection("reference.q2", "law.q_ref2", DEG),
        Connection("law.command1", "plant.tau1", 1.5),
        Connection("reference.one", "plant.tau2", 0.07),
    )
    columns = {n: c.copy() for n, c in zip(motion().names, motion().values.T, strict=True)}
    for name in ("q1", "q2"):
        columns[name] = columns[name] / DEG
    columns["one"] = np.ones_like(columns["q1"])
    degrees = trajectory(motion().time, columns)
    assert_equal_torque(system, equivalent(start_values(), extra=extra), degrees, degrees)
    # And the offset survives another round.
    again = read_ssp(write_ssp(system, tmp_path / "again.ssp", name="x"))
    assert (again.connections, again.order) == (system.connections, system.order)
    assert_equal_torque(again, equivalent(start_values(), extra=extra), degrees, degrees)


def test_a_connector_may_have_another_unit_than_its_variable(tmp_path: Path) -> None:
    """The transformation acts on the value in the unit of the connector it ends in."""
    law = connectors("q_ref1", "input", "deg") + LAW_PORTS.replace(connectors("q_ref1", "input"), "")
    own = connectors("q1", "output", "deg") + PLANT_PORTS.replace(connectors("q1", "output"), "")
    links = (link("q1", "law.q_ref1", linear(3.0, 10.0)), *WANTED[1:], *FEEDBACK, *FORWARD)
    text = ssd(
        elements=element("plant", "plant", own) + element("law", "law", law),
        links=links,
        ports=connectors("q1", "input", "rad") + connectors("q2 dq1 dq2", "input"),
    )
    system = read_ssp(by_hand(tmp_path, text))
    gains = {c.target: c.gain for c in system.connections}
    assert gains["law.q1"] == pytest.approx(1.0, rel=1e-15)  # rad, deg, rad
    name = next(name for name in system.components if name not in ("law", "plant"))
    assert system.order == (name, "law", "plant")
    wanted = {"factor": 3.0, "offset": 10.0 * DEG}
    assert system.components[name].parameter_values() == pytest.approx(wanted, rel=1e-15)


@pytest.mark.parametrize(
    ("source", "target", "value", "wanted"),
    [
        (("degC", KELVIN, 1.0, 273.15), ("K", KELVIN), 20.0, 293.15),
        (("K", KELVIN), ("degC", KELVIN, 1.0, 273.15), 293.15, 20.0),
        (("degF", KELVIN, 5 / 9, 459.67 * 5 / 9), ("degRe", KELVIN, 1.25, 273.15), 212.0, 80.0),
        (("mm", (0, 1, 0, 0, 0, 0, 0, 0), 1e-3), ("km", (0, 1, 0, 0, 0, 0, 0, 0), 1e3), 5.0, 5e-6),
        (("Hz", (0, 0, -1, 0, 0, 0, 0, 1), 2 * math.pi), ("rad/s", (0, 0, -1, 0, 0, 0, 0, 1)), 2.0, 4 * math.pi),
    ],
)
def test_units_are_converted_by_factor_and_offset(source: Any, target: Any, value: float, wanted: float) -> None:
    assert conversion(Unit(*source), Unit(*target), where="")(value) == pytest.approx(wanted, rel=1e-14)


def test_hertz_without_an_angle_is_not_taken_for_radians() -> None:
    with pytest.raises(InputError, match="different quantities"):
        conversion(Unit("Hz", (0, 0, -1, 0, 0, 0, 0, 0)), Unit("rad/s", (0, 0, -1, 0, 0, 0, 0, 1)), where="")


def test_suppressed_conversion_leaves_the_transformation_alone(tmp_path: Path) -> None:
    ports = connectors("q1 q2", "input", "deg") + connectors("dq1 dq2", "input", "rad")
    suppressed = 'suppressUnitConversion="true"'
    links = (
        link("q1", "law.q_ref1", linear(2.0), suppressed),
        link("q2", "law.q_ref2", linear(2.0)),
        *(link(f"dq{j}", f"law.dq_ref{j}", "", suppressed) for j in (1, 2)),
        *FEEDBACK,
        *FORWARD,
    )
    gains = {c.target: c.gain for c in read_ssp(by_hand(tmp_path, ssd(links=links, ports=ports))).connections}
    assert gains["law.q_ref1"] == 2.0
    assert gains["law.q_ref2"] == pytest.approx(2 * DEG, rel=1e-15)
    assert gains["law.dq_ref1"] == 1.0


def test_bindings_of_all_kinds_and_their_priority(tmp_path: Path) -> None:
    """Inline, SSV, SSV + SSM, prefix; later over earlier, system over component."""
    friction = values(
        real("friction.joint1", 25.0, "cNm") + real("viscous", 7.0) + real("unused", 1.0),
        '<ssv:Units><ssc:Unit name="cNm"><ssc:BaseUnit kg="1" m="2" s="-2" factor="0.01"/></ssc:Unit></ssv:Units>',
    )
    mapping = (
        f"<ssm:ParameterMapping {HEAD}>"
        f'<ssm:MappingEntry source="friction.joint1" target="plant.Fc1">{linear(2.0, 0.1)}</ssm:MappingEntry>'
        f'<ssm:MappingEntry source="viscous" target="plant.Fv1">{linear(0.01)}</ssm:MappingEntry>'
        '<ssm:MappingEntry source="viscous" target="plant.Fv2" suppressUnitConversion="true">'
        f"{linear(0.002)}</ssm:MappingEntry></ssm:ParameterMapping>"
    )
    system_level = (
        '<ssd:ParameterBinding source="resources/friction.ssv">'
        '<ssd:ParameterMapping source="resources/map%20it.ssm"/></ssd:ParameterBinding>'
        '<ssd:ParameterBinding source="resources/law.ssv" prefix="law."/>'
        + inline(real("plant.ZZ2", 0.07) + real("stiff", 3000.0))
        + inline(real("plant.ZZ2", 0.08))
    )
    elements = element(
        "plant",
        "plant",
        PLANT_PORTS + connectors("Fc1", "parameter", "cNm"),
        started(real("ZZ1", 3.6) + real("Fc1", 9.0)),
    ) + element("law", "law", LAW_PORTS + connectors("Kp1", "parameter"))
    text = ssd(
        elements=elements,
        bindings=system_level,
        ports=connectors("q1 dq1 q2 dq2", "input") + connectors("stiff", "parameter"),
        links=(*LINKS, link("stiff", "law.Kp1", linear(1.1))),
    )
    files = {
        "resources/friction.ssv": friction,
        "resources/map it.ssm": mapping,
        "resources/law.ssv": values(real("Kd2", 3.5)),
    }
    system = read_ssp(by_hand(tmp_path, text, files))
    wanted = {"ZZ1": 3.6, "Fc1": 0.501, "Fv1": 0.07, "Fv2": 0.014, "ZZ2": 0.08, **start_values()}
    law_wanted = {"Kd2": 3.5, "Kp1": 3300.0}
    got = system.components["plant"].parameter_values()
    assert {name: got[name] for name in wanted} == pytest.approx(wanted, rel=1e-14)
    got = system.components["law"].parameter_values()
    assert {name: got[name] for name in law_wanted} == pytest.approx(law_wanted, rel=1e-14)
    assert_equal_torque(system, equivalent(wanted, law_wanted), motion(), motion())


def test_values_bound_to_inputs_are_start_values_and_units_of_values_count(tmp_path: Path) -> None:
    rows = real("tau2", 30.0, "cNm") + real("q_start1", 90.0, "deg")
    elements = element("plant", "plant", PLANT_PORTS, inline(rows)) + element("law", "law", LAW_PORTS)
    system = read_ssp(by_hand(tmp_path, ssd(elements=elements, links=(*WANTED, *FEEDBACK, FORWARD[0]))))
    assert [v.start for v in system.components["plant"].inputs] == [0.0, pytest.approx(0.3, rel=1e-15)]
    assert system.components["plant"].parameter_values()["q_start1"] == pytest.approx(math.pi / 2, rel=1e-15)


def test_systems_inside_systems_are_flattened(tmp_path: Path) -> None:
    """Each connection and value passes the connectors of the inner system, and is transformed there too."""
    inner = (
        '<ssd:System name="arm"><ssd:Connectors>'
        + connectors("u1 u2", "input") + connectors("y1 y2", "output", "deg") + connectors("w1 w2", "output")
        + connectors("inertia", "parameter")
        + "</ssd:Connectors><ssd:ParameterBindings>" + inline(real("inertia", 1.0) + real("plant.Fv1", 0.05))
        + "</ssd:ParameterBindings><ssd:Elements>"
        + element("plant", "plant", PLANT_PORTS + connectors("ZZ1", "parameter"), started(real("Fv1", 9.0)))
        + "</ssd:Elements><ssd:Connections>" + link("inertia", "plant.ZZ1", linear(2.0))
        + "".join(link(f"u{j}", f"plant.tau{j}", linear(2.0)) for j in (1, 2))
        + "".join(link(f"plant.q{j}", f"y{j}") + link(f"plant.dq{j}", f"w{j}") for j in (1, 2))
        + "</ssd:Connections></ssd:System>"
    )  # fmt: skip
    links = (
        *WANTED,
        *(link(f"arm.y{j}", f"law.q{j}") + link(f"arm.w{j}", f"law.dq{j}") for j in (1, 2)),
        *(link(f"law.command{j}", f"arm.u{j}", linear(0.75)) for j in (1, 2)),
    )
    text = ssd(
        elements=element("law", "law", LAW_PORTS) + inner, links=links, bindings=inline(real("arm.inertia", 1.9))
    )
    system = read_ssp(by_hand(tmp_path, text))
    assert set(system.components) == {"law", "arm_plant"}
    extra = tuple(Connection(f"law.command{j}", f"plant.tau{j}", 1.5) for j in (1, 2))
    python = equivalent({"ZZ1": 3.8, "Fv1": 0.05, **start_values()}, extra=extra)
    left, right = outputs(system), outputs(python)
    for j in (1, 2):
        difference = np.abs(left[f"law.command{j}"] - right[f"law.command{j}"])
        assert difference.max() <= 1e-11 * np.abs(right[f"law.command{j}"]).max()  # q goes through deg and back


# Refusals


@cache
def good() -> dict[str, Any]:
    return {"SystemStructure.ssd": ssd(), **fmu_files()}


TWICE = (*LINKS, link("dq1", "plant.tau1"))
BOOLEAN = (
    '<ssc:BooleanMappingTransformation><ssc:MapEntry source="true" target="false"/></ssc:BooleanMappingTransformation>'
)
NESTED_TYPE = element("plant", "plant", PLANT_PORTS).replace("source=", 'type="application/x-ssp-package" source=')
BOMB = '<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;">]>'
LOOP_OF_ONE = (
    '<ssd:Annotations><ssc:Annotation type="org.fmu-didim.loop"><loop xmlns="urn:fmu-didim:loop:1" step_size="0.005">'
    '<component name="law"/></loop></ssc:Annotation></ssd:Annotations>'
)


def structure(**options: Any) -> dict[str, Any]:
    return {**good(), "SystemStructure.ssd": ssd(**options)}


def bound(rows: str) -> dict[str, Any]:
    return structure(bindings=inline(rows))


TUBE = (
    f'<ssd:System name="tube"><ssd:Connectors>{connectors("a", "input")}{connectors("b", "output")}</ssd:Connectors>'
    f"<ssd:Connections>{link('a', 'b')}</ssd:Connections></ssd:System>"
)


REFUSED: dict[str, tuple[dict[str, Any], type[FmuDidimError], tuple[str, ...]]] = {
    "path traversal": ({**good(), "../evil.txt": "x"}, InputError, ("outside", "../evil.txt")),
    "absolute path": ({**good(), "/etc/evil": "x"}, InputError, ("outside",)),
    "same name twice": ({**good(), "RESOURCES/plant.fmu": b"x"}, InputError, ("same name",)),
    "no description": (fmu_files(), InputError, ("no SystemStructure.ssd",)),
    "not XML": ({**good(), "SystemStructure.ssd": "<a>"}, InputError, ("well-formed",)),
    "entities": (
        {**good(), "SystemStructure.ssd": ssd().replace("?>", "?>" + BOMB, 1)}, InputError, ("document type",),
    ),
    "other namespace": (
        {**good(), "SystemStructure.ssd": ssd().replace("SSP1", "SSP9")}, InputError, ("expected kind",),
    ),
    "other version": (
        {**good(), "SystemStructure.ssd": ssd().replace('version="1.0" name', 'version="3.0" name')}, InputError,
        ("version of SSP", "3.0", "1.0, 2.0"),
    ),
    "missing FMU": (
        {k: v for k, v in good().items() if k != "resources/law.fmu"}, InputError,
        ("does not contain 'resources/law.fmu'", "Component law"),
    ),
    "source outside": (
        structure(elements=element("plant", "../../plant", PLANT_PORTS)), InputError, ("inside the archive",),
    ),
    "no FMU": ({**good(), "resources/law.fmu": b"no zip"}, FmuError, ("Component law", "resources/law.fmu")),
    "other type": (structure(elements=NESTED_TYPE), InputError, ("Only FMUs", "Component plant")),
    "unknown connector": (
        structure(links=(*LINKS[:-1], link("law.command3", "plant.tau2"))), UnknownNameError,
        ("command3", "law.command3 -> plant.tau2", "Did you mean"),
    ),
    "unknown element": (
        structure(links=(*LINKS[:-1], link("lav.command2", "plant.tau2"))), UnknownNameError,
        ("lav", "lav.command2 -> plant.tau2"),
    ),
    "connector without variable": (
        structure(elements=element("plant", "plant", PLANT_PORTS + connectors("q9", "output"))
                  + element("law", "law", LAW_PORTS)), UnknownNameError, ("q9", "Component plant"),
    ),
    "doubled input": (structure(links=TWICE), InputError, ("dq1 -> plant.tau1", "law.command1 -> plant.tau1")),
    "backwards": (
        structure(links=(*LINKS[:-1], link("plant.tau2", "law.command2"))), InputError,
        ("cannot start", "plant.tau2 -> law.command2"),
    ),
    "transformation of booleans": (
        structure(links=(*LINKS[:-1], link("law.command2", "plant.tau2", BOOLEAN))), InputError,
        ("BooleanMappingTransformation", "law.command2 -> plant.tau2"),
    ),
    "a circle without a component": (
        structure(elements=element("plant", "plant", PLANT_PORTS) + element("law", "law", LAW_PORTS) + TUBE,
                  links=(*LINKS[1:], link("tube.b", "tube.a"), link("tube.b", "law.q_ref1"))),
        InputError, ("circle", "Connection"),
    ),
    "unlike dimensions": (
        structure(ports=connectors("q1 q2 dq1 dq2", "input", "volt")), InputError,
        ("different quantities", "q1 -> law.q_ref1", "suppressUnitConversion"),
    ),
    "undefined unit": (
        structure(ports=connectors("q1 q2 dq1 dq2", "input", "furlong")), InputError, ("furlong", "not defined"),
    ),
    "unknown parameter": (bound(real("plant.ZZ9", 1.0)), UnknownNameError, ("'plant.ZZ9'", "Did you mean")),
    "a value that is no number": (
        bound('<ssv:Parameter name="plant.ZZ1"><ssv:String value="a"/></ssv:Parameter>'), InputError,
        ("Only numbers", "plant.ZZ1"),
    ),
    "an array joined with a scalar": (
        structure(ports=connectors("q1 q2 dq1 dq2", "input").replace("/></ssd", '/><ssc:Dimension size="2"/></ssd')),
        InputError, ("different shapes", "a scalar and 2", "q1 -> law.q_ref1"),
    ),
    "an array whose size is elsewhere": (
        structure(ports=connectors("q1", "input").replace("/></ssd", '/><ssc:Dimension sizeConnector="n"/></ssd')),
        InputError, ("size of each dimension", "'q1'", "got:   none"),
    ),
    "infinite value": (bound(real("plant.ZZ1", math.inf)), InputError, ("finite", "plant.ZZ1")),
    "binding without content": (
        structure(bindings="<ssd:ParameterBinding/>"), InputError, ("Give either", "ParameterBinding 1"),
    ),
    "missing SSV": (
        structure(bindings='<ssd:ParameterBinding source="resources/no.ssv"/>'), InputError, ("resources/no.ssv",),
    ),
    "annotation that does not fit": (structure(annotations=LOOP_OF_ONE), InputError, ("annotation",)),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_wrong_archives_are_refused(case: str, tmp_path: Path) -> None:
    files, kind, words = REFUSED[case]
    path = pack(tmp_path / "wrong.ssp", files)
    with pytest.raises(kind) as caught:
        read_ssp(path)
    assert str(path) in str(caught.value)
    for word in words:
        assert word in str(caught.value)
    assert not (tmp_path.parent / "evil.txt").exists()


def test_unmatched_names_are_ignored_when_that_is_wanted(tmp_path: Path) -> None:
    path = pack(tmp_path / "x.ssp", bound(real("plant.ZZ9", 1.0) + real("plant.ZZ1", 3.6)))
    assert read_ssp(path, strict=False).components["plant"].parameter_values()["ZZ1"] == 3.6


def test_version_2_is_read_by_its_namespace(tmp_path: Path) -> None:
    """Its types are those of FMI 3.0, and a connector of the system may be named with an empty element."""
    text = ssd(elements=element("plant", "plant", PLANT_PORTS, started()) + element("law", "law", LAW_PORTS))
    text = re.sub(r'(?<!<\?xml )version="1.0"', 'version="2.0"', text).replace("ssc:Real", "ssc:Float64")
    text = text.replace("ssv:Real", "ssv:Float64")
    text = text.replace('Connection startConnector="q1"', 'Connection startElement="" startConnector="q1"')
    assert 'startElement=""' in text
    assert "Float64" in text
    system = read_ssp(by_hand(tmp_path, text))
    assert_equal_torque(system, equivalent(start_values()), motion(), motion())


def test_connectors_of_arrays(tmp_path: Path) -> None:
    """Of version 2.0 with FMUs of FMI 3.0: whole arrays into an inner system and on, one element by its name."""
    two = '<ssc:Dimension size="2"/>'

    def array(name: str, kind: str) -> str:
        return f'<ssd:Connector name="{name}" kind="{kind}"><ssc:Float64/>{two}</ssd:Connector>'

    part = array("u", "input") + array("y", "output")
    inner = (
        f'<ssd:System name="box"><ssd:Connectors>{array("a", "input")}{array("b", "output")}</ssd:Connectors>'
        f"<ssd:Elements>{element('first', 'arrays', part)}</ssd:Elements>"
        f"<ssd:Connections>{link('a', 'first.u')}{link('first.y', 'b')}</ssd:Connections></ssd:System>"
    )
    text = ssd(
        ports=array("r", "input"), elements=inner + element("second", "arrays", part),
        links=(link("r", "box.a"), link("box.b[2]", "second.u[1]"), link("box.b[1]", "second.u[2]")),
        bindings=inline(real("box.first.A[1,2]", 10.0)),
    )  # fmt: skip
    text = re.sub(r'(?<!<\?xml )version="1.0"', 'version="2.0"', text)
    fmu = build_awkward(tmp_path / "arrays.fmu", ARRAYS, library("arrays"))
    path = pack(tmp_path / "x.ssp", {"SystemStructure.ssd": text, "resources/arrays.fmu": fmu})
    system = read_ssp(path, step_size=0.01)
    wave = np.arange(20)[:, None] * [1.0, -0.3]
    given = trajectory(np.arange(20) * 0.01, {"r[1]": wave[:, 0], "r[2]": wave[:, 1]})
    found = simulate(system, given).applied
    y = np.column_stack([wave[:, 0] + 10 * wave[:, 1], wave[:, 1]])
    for j in (1, 2):
        np.testing.assert_allclose(found[f"box_first.y[{j}]"], y[:, j - 1], atol=1e-12)
        np.testing.assert_allclose(found[f"second.y[{j}]"], y[:, 2 - j], atol=1e-12)


ANNOTATION = (
    '<ssd:Annotations><ssc:Annotation type="other.tool"><{0}:Algorithm><{0}:{1} {2}="0.0025"/></{0}:Algorithm>'
    "</ssc:Annotation></ssd:Annotations>"
)


@pytest.mark.parametrize(
    ("element_name", "key"), [("FixedStepAlgorithm", "baseStepSize"), ("FixedStepMaster", "initialStepSize")]
)
def test_prefixes_that_are_not_declared_and_the_step_of_another_tool(
    element_name: str, key: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    text = ssd(annotations=ANNOTATION.format("osp", element_name, key)).replace(f' xmlns:ssc="{SSP}Common"', "")
    assert "xmlns:osp" not in text
    system = read_ssp(by_hand(tmp_path, text))
    assert system.step_size == 0.0025
    assert "does not declare" in caplog.text
    assert "ssc" in caplog.text
    assert "osp" in caplog.text


def test_a_value_of_a_connector_that_leads_nowhere_is_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    ports = connectors("q1 dq1 q2 dq2 spare", "input")
    text = ssd(ports=ports, bindings=inline(real("spare", 2.0) + real("plant.ZZ1", 3.6)))
    system = read_ssp(by_hand(tmp_path, text))
    assert system.components["plant"].parameter_values()["ZZ1"] == 3.6
    assert "'spare' goes nowhere" in caplog.text


def test_a_step_that_nobody_states_is_asked_for(tmp_path: Path) -> None:
    elements = element("plant", "plant", PLANT_PORTS)
    links = tuple(link(f"q{j}", f"plant.tau{j}") for j in (1, 2))
    path = by_hand(tmp_path, ssd(elements=elements, links=links))
    with pytest.raises(InputError, match="step_size"):
        read_ssp(path)
    assert read_ssp(path, step_size=0.01).step_size == 0.01


@pytest.mark.parametrize("content", [b"", b"no zip file"])
def test_what_is_no_archive_is_refused(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "x.ssp").write_bytes(content)
    with pytest.raises(InputError, match="zip archive"):
        read_ssp(tmp_path / "x.ssp")
    with pytest.raises(InputError, match="does not exist"):
        read_ssp(tmp_path / "y.ssp")


def test_writing_refuses_what_ssp_cannot_say(tmp_path: Path) -> None:
    path = tmp_path / "x.ssp"
    law: Block = scara_pd()
    with pytest.raises(InputError, match=r"not an FMU[\s\S]*kind fmu"):
        write_ssp(loop(plant(), component("model", law), motion()), path, name="x")
    injected = direct(injections={"command1": "ddq1"})
    with pytest.raises(InputError, match=r"controller.command1 -> plant.tau1 and reference.ddq1 -> plant.tau1"):
        write_ssp(injected, path, name="x")
    with pytest.raises(UnknownNameError, match="robot"):
        write_ssp(direct(), path, name="x", parameters={"robot": {}})
    with pytest.raises(UnknownNameError, match="ZZ9"):
        write_ssp(direct(), path, name="x", parameters={"plant": {"ZZ9": 1.0}})
    with pytest.raises(InputError, match="well-formed"):
        write_ssp(direct(), path, name="\0")
    assert list(tmp_path.iterdir()) == []


def test_jacobi_order_survives_the_round_trip(tmp_path: Path) -> None:
    parallel = replace(direct(), jacobi=True)
    assert read_ssp(write_ssp(parallel, tmp_path / "loop.ssp", name="loop")).jacobi
    assert not read_ssp(write_ssp(direct(), tmp_path / "other.ssp", name="loop")).jacobi


# From a case and back to one


def written(tmp_path: Path, **changes: Any) -> Path:
    """The closed loop of a case as an archive."""
    return export_ssp(scara_case(tmp_path, **changes), tmp_path / "loop.ssp")


def case_of(archive: Path, folder: Path, **plant: Any) -> Path:
    """The SCARA example whose loop is the archive."""
    path = scara_case(folder)
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    del content["controller"]
    content["system"] = archive.name
    content["plant"] = plant
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return path


@pytest.mark.gate
def test_case_from_an_archive_gives_the_same_torque_and_the_same_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = case_of(written(tmp_path), tmp_path)
    expected = fmu_didim.simulate("examples/scara/identify.yaml")
    table = fmu_didim.simulate(path)
    assert table.names == expected.names
    assert np.abs(table.values - expected.values).max() <= 1e-12 * np.abs(expected.values).max()
    found, known = identify(path), identify("examples/scara/identify.yaml").estimate
    assert (np.abs(found.estimate.value - known.value) <= NEAR * known.standard_deviation).all()
    # Of the FMUs in an archive no equations are known, so their sensitivities are differences.
    monkeypatch.setattr(sensitivity, "with_derivatives", lambda *arguments: None)
    wanted = identify("examples/scara/identify.yaml")
    assert (np.abs(found.estimate.value - wanted.estimate.value) <= NEAR * wanted.estimate.standard_deviation).all()
    np.testing.assert_allclose(found.estimate.standard_deviation, wanted.estimate.standard_deviation, rtol=1e-3)
    assert found.document.consistency is not None
    assert found.document.consistency.agrees
    assert found.document.provenance["files"].keys() >= {"loop.ssp"}
    assert loop_lines(found.document.loop)[:2] == [
        "controller: scara_pd.fmu in loop.ssp, FMI 2.0 co-simulation, run again by reset",
        "plant: scara.fmu in loop.ssp, FMI 2.0 co-simulation, run again by reset",
    ]


def test_delay_of_an_archive_holds_unless_the_case_gives_another(tmp_path: Path) -> None:
    path = case_of(written(tmp_path, loop={"delay_samples": 1.5}), tmp_path)
    (tmp_path / "x").mkdir()
    late = scara_case(tmp_path / "x", loop={"delay_samples": 1.5})
    expected = fmu_didim.simulate(late)
    np.testing.assert_array_equal(fmu_didim.simulate(path).values, expected.values)
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    content["loop"] = {"delay_s": 0.0}
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    np.testing.assert_array_equal(
        fmu_didim.simulate(path).values, fmu_didim.simulate("examples/scara/identify.yaml").values
    )


def test_foreign_names_are_mapped(tmp_path: Path) -> None:
    """An archive of another tool: other names of the component, its variables, and the inputs of the system."""
    with zipfile.ZipFile(written(tmp_path)) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    root = ET.fromstring(files["SystemStructure.ssd"])
    system = next(e for e in root if e.tag.endswith("}System"))
    connectors = next(e for e in system if e.tag.endswith("}Connectors"))
    next(c for c in connectors if c.get("name") == "dq1").set("name", "speed_wanted")
    for element in root.iter():
        for key in ("name", "startElement", "endElement"):
            if element.get(key) == "plant":
                element.set(key, "arm")
        if element.get("startConnector") == "dq1" and element.get("startElement") is None:
            element.set("startConnector", "speed_wanted")
    files["SystemStructure.ssd"] = ET.tostring(root)
    with zipfile.ZipFile(tmp_path / "foreign.ssp", "w") as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    path = case_of(tmp_path / "foreign.ssp", tmp_path, component="arm")
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    content["system"] = {"source": "foreign.ssp", "inputs": {"dq1": "speed_wanted"}}
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    expected = fmu_didim.simulate("examples/scara/identify.yaml")
    np.testing.assert_allclose(fmu_didim.simulate(path).values, expected.values, rtol=0, atol=1e-12)
    content["system"]["inputs"] = {"dq1": "speed"}
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    with pytest.raises(UnknownNameError, match="no input of the system named 'speed'"):
        load_case(path)
    content["plant"]["component"] = "robot"
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    with pytest.raises(UnknownNameError, match=r"no component named 'robot'(.|\n)*arm"):
        load_case(path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"controller": {"source": "x.yaml"}}, "not both"),
        ({"plant": {"substeps": 3}}, "component, inputs, outputs, parameter_names, parameters only, not substeps"),
        ({"loop": {"injections": {"command1": "x"}}}, "connect the test signal in the archive"),
        ({"system": None}, "give controller: "),
    ],
)
def test_what_an_archive_settles_is_not_taken_from_the_case(
    tmp_path: Path, changes: dict[str, Any], message: str
) -> None:
    path = case_of(tmp_path / "loop.ssp", tmp_path)
    content = yaml.safe_load(path.read_text(encoding="utf-8")) | changes
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    with pytest.raises(InputError, match=message):
        load_case(path)


def test_identified_values_and_delay_go_into_the_archive(tmp_path: Path) -> None:
    case = scara_case(tmp_path, estimator={"estimate_delay": True})
    outcome = identify(case, out=tmp_path / "out")
    values = dict(zip(outcome.estimate.names, outcome.estimate.value, strict=True))
    result = tmp_path / "out" / "result.json"
    saved = json.loads(result.read_text(encoding="utf-8"))
    values["delay"] = saved["parameters"]["delay"]["value"] = 0.75  # that of these data is not far from 0
    result.write_text(json.dumps(saved), encoding="utf-8")
    archive = export_ssp(case, tmp_path / "identified.ssp", result=result)
    system = read_ssp(archive)
    assert system.delays["plant"] == values["delay"]
    parameters = system.components["plant"].parameter_values()
    assert (parameters["ZZ1"], parameters["Fc2"]) == (values["ZZ1R"], values["Fc2"])
    with zipfile.ZipFile(archive) as content:
        (tmp_path / "plant.ssv").write_bytes(content.read("resources/plant.ssv"))
    bound = {p.name: float(p.value) for p in read_ssv(str(tmp_path / "plant.ssv")).parameters}
    assert bound["Fc2"] == values["Fc2"]
    with pytest.raises(InputError, match="There is no result"):
        export_ssp(case, tmp_path / "x.ssp", result=tmp_path)


def test_timing_and_model_exchange_survive(tmp_path: Path) -> None:
    own = load_fmu(plant().path, interface="model-exchange", substeps=6, si_units=False)
    system = replace(
        loop(own, controller(), motion()), every={"controller": 2}, substeps={"plant": 4},
        after_step=frozenset({"controller"}), algebraic_loops="iterate",
    )  # fmt: skip
    again = read_ssp(write_ssp(system, tmp_path / "x.ssp", name="x"))
    assert (again.every, again.substeps, again.after_step) == (system.every, system.substeps, system.after_step)
    assert again.algebraic_loops == "iterate"
    part = again.components["plant"]
    assert isinstance(part, FmuComponent)
    assert (part.interface.kind, part.solver, part.substeps) == ("model-exchange", "rk4", 6)
    assert_same(outputs(again), outputs(system))


def test_start_values_of_states_survive_under_their_own_names(tmp_path: Path) -> None:
    fmu = load_fmu(awkward_fmu(tmp_path), si_units=False)
    part = name_parameters(fmu, {"q_start1": "internal", "decay": "a"}).with_parameters({"q_start1": 0.5, "decay": 3.0})
    system = System({"plant": part}, (), ("plant",), 0.01)
    again = read_ssp(write_ssp(system, tmp_path / "x.ssp", name="x")).components["plant"]
    assert isinstance(again, FmuComponent)
    assert again.start_values["internal"] == 0.5
    assert again.parameter_values()["a"] == 3.0
    inputs = np.ones((4, 1))
    np.testing.assert_array_equal(drive(again, inputs, 0.01), drive(part, inputs, 0.01))
