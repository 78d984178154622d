"""Which FMU is the plant and which the controller: told by its signals, or asked; the case that is written runs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from fmu_didim.base.errors import InputError
from fmu_didim.case import load_case
from fmu_didim.cli.main import main
from fmu_didim.components.fmu.description import FmuDescription, FmuVariable
from fmu_didim.controllers import read_controller
from fmu_didim.dynamics.block import Block
from fmu_didim.dynamics.robot import RobotModel, read_robot
from fmu_didim.export import build_fmu
from fmu_didim.workflow.init import start_case
from fmu_didim.workflow.init.fmu_roles import FmuPorts, mappings, reading
from tests.awkward.build import awkward_fmu
from tests.conftest import ROOT
from tests.workflow.test_init import CONSTANT, GEAR, GEOMETRY, as_csv, assert_same, by_hand, filled, values_of

VENDOR = {"q_ref1": "u_s1", "q_ref2": "u_s2", "q1": "u_m1", "q2": "u_m2", "command1": "y1", "command2": "y2"}
"""The names of the Modelica Standard Library's controllers."""
BARE = {"tau1": "in[1]", "tau2": "in[2]", "q1": "out[1]", "q2": "out[2]"}
DRIVE = [f"{c:g}" for joint in zip(CONSTANT, GEAR, strict=True) for c in joint]


def ports(inputs: str, outputs: str, at_once: bool | None = None) -> FmuPorts:
    """An FMU with these ports: ``name`` or ``name:unit``, separated by blanks."""
    sides = (("input", inputs), ("output", outputs))
    named = [(causality, *text.partition(":")[::2]) for causality, texts in sides for text in texts.split()]
    variables = tuple(
        FmuVariable(name, i, "Real", causality, "continuous", "exact", unit=unit)
        for i, (causality, name, unit) in enumerate(named)
    )
    of_inputs = tuple(v.name for v in variables if v.causality == "input")
    known = {v.name: of_inputs if at_once else () for v in variables if v.causality == "output"}
    fmu = FmuDescription(
        Path("x.fmu"), Path(), "", "2.0", "x", "", "", (), (), variables,
        dependencies=None if at_once is None else known,
    )  # fmt: skip
    return FmuPorts(Path("x.fmu"), fmu)


TOLD = [
    # joints, inputs, outputs, role
    (1, "u_s1 u_m1", "y1", "controller"),
    (2, "a1 a2 b1 b2", "y1 y2", "controller"),
    (2, "a1 a2", "y1 y2 y3 y4", "plant"),
    (2, "q_ref1 q_ref2 q1 q2", "command1 command2", "controller"),
    (2, "tau1 tau2", "q1 q2 dq1 dq2", "plant"),
    (1, "u:N.m", "y:rad", "plant"),
    (1, "u:rad", "y:N.m", "controller"),
    (1, "error", "torque", "controller"),
    (1, "torque", "angle", "plant"),
    (1, "e:rad", "u:V", "controller"),
    (1, "tau_cmd disturbance:N.m", "phi:rad", "plant"),  # units and names against the count
    (2, "setpoint1 setpoint2 actual1 actual2", "u1 u2", "controller"),
    (1, "speed_ref:rad/s speed:rad/s", "current:A", "controller"),
]
ASKED = [
    (1, "u", "y", None, "1 input and 1 output for 1 torque"),
    (2, "u1 u2", "y1 y2", True, "an output follows an input at once, as in most controllers"),
    (2, "u1 u2", "y1 y2", False, "no output follows an input at once, as in most plants"),
    (1, "u:N.m", "torque", None, "units are those of a plant; its names are those of a controller"),
    (2, "a b c", "d e f g", None, "3 inputs and 4 outputs for 2 torques"),
    (1, "tau1 tau2", "y1", None, "names are those of a plant"),  # by count it would be a controller
]


@pytest.mark.parametrize(("joints", "inputs", "outputs", "role"), TOLD)
def test_the_role_is_told(joints: int, inputs: str, outputs: str, role: str) -> None:
    assert reading(ports(inputs, outputs), joints).role == role


@pytest.mark.parametrize(("joints", "inputs", "outputs", "at_once", "hint"), ASKED)
def test_the_role_is_asked_for(joints: int, inputs: str, outputs: str, at_once: bool | None, hint: str) -> None:
    found = reading(ports(inputs, outputs, at_once), joints)
    assert found.role is None
    assert hint in found.reason


def test_ports_are_mapped_as_far_as_their_names_tell() -> None:
    made = mappings(ports("u_s u_m", "y"), "controller", 1)
    assert made == {"inputs": {"q_ref1": "u_s", "q1": "u_m"}, "outputs": {"command1": "y"}}
    made = mappings(ports("a1 a2 b1 b2", "y1 y2"), "controller", 2)
    assert made["inputs"] == dict.fromkeys(("q_ref1", "q_ref2", "q1", "q2"), "EDIT")
    assert made["outputs"] == {"command1": "y1", "command2": "y2"}
    made = mappings(ports("M1:N.m M2:N.m", "w1:rad/s w2:rad/s phi1:rad phi2:rad x"), "plant", 2)
    assert made["inputs"] == {"tau1": "M1", "tau2": "M2"}
    assert made["outputs"] == {"q1": "phi1", "q2": "phi2", "dq1": "w1", "dq2": "w2"}
    assert not mappings(ports("tau1", "q1 dq1 ddq1"), "plant", 1)


def renamed(block: Block, name: str, names: dict[str, str], folder: Path) -> Path:
    """The FMU of a block as another tool might have made it: other names, no units, no velocities."""

    def bare(variables):  # type: ignore[no-untyped-def]
        return tuple(replace(v, name=names.get(v.name, v.name), unit="", description="") for v in variables)

    new = replace(block, name=name, inputs=bare(block.inputs), outputs=bare(block.outputs))
    return build_fmu(new, directory=folder)


@pytest.mark.gate
def test_a_controller_with_the_names_of_its_vendor_becomes_the_controller(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """And the case with it, once robot and drives are filled in, gives the values of a case by hand."""
    law = read_controller(ROOT / "controllers/scara_pd.yaml")
    assert {v.name for v in (*law.inputs, *law.outputs)} <= {*VENDOR, *(f"d{q}" for q in VENDOR)}
    names = VENDOR | {f"d{q}": f"d{q}_vendor" for q in VENDOR if "q" in q}
    fmu = renamed(law, "axes", names, tmp_path)
    assert main(["init", *map(str, as_csv(tmp_path)), str(fmu), "--out", str(tmp_path / "my case")]) == 0
    told = capsys.readouterr().out
    assert "the controller, by " in told and "for 2 torques in the log" in told
    case = tmp_path / "my case/case.yaml"
    content = yaml.safe_load(case.read_text(encoding="utf-8"))
    assert content["controller"]["source"] == "../axes.fmu" and content["plant"] == {"kind": "model"}
    assert not (case.parent / "controller.yaml").exists()
    filled(case, *DRIVE)
    filled(case.parent / "robot.yaml", *GEOMETRY)
    assert main(["validate", str(case)]) == 0, capsys.readouterr().out
    assert_same(values_of(load_case(case)), by_hand(case.parent))


def test_a_plant_with_other_names_becomes_the_plant(tmp_path: Path) -> None:
    """By counts alone: two inputs, six outputs."""
    block = RobotModel(read_robot(ROOT / "fmus/scara/robot.yaml")).block()
    motions = {v.name: f"out{i}" for i, v in enumerate(block.outputs, start=1)}
    fmu = renamed(block, "arm", {"tau1": "in1", "tau2": "in2"} | motions, tmp_path)
    made = start_case([*as_csv(tmp_path), fmu], tmp_path / "made", law="pd")
    content = yaml.safe_load(made.files[0].read_text(encoding="utf-8"))
    assert content["plant"]["source"] == "../arm.fmu"
    assert content["plant"]["inputs"] == {"tau1": "in1", "tau2": "in2"}
    assert content["plant"]["outputs"] == {"q1": "EDIT", "q2": "EDIT"}


def one_joint(folder: Path) -> Path:
    rows = "".join(f"{k / 100},{k / 50},3\n" for k in range(20))
    (folder / "log.csv").write_text("t,q1,tau1\n" + rows, encoding="utf-8")
    return folder / "log.csv"


def test_equal_counts_are_asked_for_with_both_readings(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, fmu = one_joint(tmp_path), awkward_fmu(tmp_path)
    assert main(["init", str(log), str(fmu), "--out", str(tmp_path / "asked")]) == 1
    told = " ".join(capsys.readouterr().err.split())
    assert "cannot be told from its signals" in told and "1 input and 1 output for 1 torque in the log" in told
    assert "as the plant it takes torques (u) and gives the motion (y)" in told
    assert "as the controller it takes set points and measurements (u) and gives torques" in told
    assert f"--plant {fmu}, or --controller {fmu}" in told
    assert not (tmp_path / "asked").exists()
    for role in ("plant", "controller"):
        out = tmp_path / role
        assert main(["init", str(log), f"--{role}", str(fmu), "--out", str(out)]) == 0
        assert f"the {role}, as you say" in capsys.readouterr().out
        assert yaml.safe_load((out / "case.yaml").read_text(encoding="utf-8"))[role]["source"] == f"../{fmu.name}"


def test_what_is_left_is_the_other_one(tmp_path: Path) -> None:
    log, fmu = one_joint(tmp_path), awkward_fmu(tmp_path)
    made = start_case([log, fmu, ROOT / "controllers/emps.yaml"], tmp_path / "a")
    assert yaml.safe_load(made.files[0].read_text(encoding="utf-8"))["plant"]["source"] == f"../{fmu.name}"
    assert any("as the controller is given by another file" in taken for _, _, taken in made.found)


def test_what_contradicts_itself_is_refused(tmp_path: Path) -> None:
    log, fmu = one_joint(tmp_path), awkward_fmu(tmp_path)
    with pytest.raises(InputError, match=r"two controllers[\s\S]*--plant"):
        start_case([log], tmp_path / "a", law="pd", controller=fmu)
    with pytest.raises(InputError, match="cannot be the plant and the controller"):
        start_case([log], tmp_path / "a", plant=fmu, controller=fmu)
    with pytest.raises(InputError, match=r"Only an FMU[\s\S]*--plant[\s\S]*robot\.yaml"):
        start_case([log], tmp_path / "a", plant=ROOT / "fmus/emps/robot.yaml")
    other = tmp_path / "other.fmu"
    other.write_bytes(fmu.read_bytes())
    with pytest.raises(InputError, match="cannot be told"):
        start_case([log, fmu, other], tmp_path / "a")
    start_case([log, fmu, other], tmp_path / "a", plant=other)


def test_modelica_files_are_taken_as_fmus_are(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The case that is written is run: its loop is that of the shipped example."""
    pytest.importorskip("rumoca", reason="a Modelica file needs the extra modelica: pip install 'fmu-didim[modelica]'")
    models = [str(ROOT / f"fmus/scara/modelica/{name}.mo") for name in ("Scara", "PD")]
    robot = str(ROOT / "fmus/scara/robot.yaml")
    assert main(["init", *map(str, as_csv(tmp_path)), *models, robot, "--out", str(tmp_path / "made")]) == 0
    told = capsys.readouterr().out
    assert "Scara.mo" in told and "the plant, by the units and names" in told
    path = tmp_path / "made/case.yaml"
    filled(path, *DRIVE)
    assert main(["validate", str(path)]) == 0, capsys.readouterr().out
    case = load_case(path, require_torque=False)
    assert case.document.plant.source is not None and case.document.plant.source.endswith("modelica/Scara.mo")
    assert case.controller is not None and len(case.controller.inputs) == 8


def test_a_modelica_file_without_the_compiler_says_how_to_get_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from importlib.metadata import PackageNotFoundError

    def absent(name: str) -> str:
        raise PackageNotFoundError(name)

    monkeypatch.setattr("fmu_didim.export.modelica.version", absent)
    assert main(["init", str(one_joint(tmp_path)), str(ROOT / "fmus/scara/modelica/PD.mo")]) == 1
    assert "fmu-didim[modelica]" in capsys.readouterr().err
