"""The robot of a case with identified values for other tools: the same torque there, and what is told beside it."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from fmu_didim import ResultDocument, export_robot, load_case
from fmu_didim.base.errors import InputError
from fmu_didim.cli.main import main
from fmu_didim.dynamics.base_parameters import base_parameters
from fmu_didim.dynamics.effects.motor import Motor
from fmu_didim.dynamics.physical_set import ENTRIES
from fmu_didim.dynamics.robot import RobotDescription, RobotModel, read_robot, write_robot
from fmu_didim.dynamics.robot.body import body_of
from fmu_didim.dynamics.robot.formats.urdf import read_urdf
from fmu_didim.dynamics.robot.formats.write_urdf import pose_of
from fmu_didim.results.result import read_result
from tests.dynamics.robot.test_urdf import drawn
from tests.helpers import ROOT
from tests.tools.robot_files import by_mujoco, by_pinocchio, differences, links, points

TX40, SCARA = ROOT / "examples/tx40/discover_load.yaml", ROOT / "examples/scara/identify.yaml"


@pytest.fixture(scope="module")
def scara(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An identified SCARA."""
    out = tmp_path_factory.mktemp("scara")
    assert main(["identify", str(SCARA), "--out", str(out), "--quiet"]) == 0
    return out / "result.json"


def bare(robot: RobotDescription) -> RobotModel:
    """The robot without friction, and without motor inertias."""
    joints = (
        j.model_copy(update={"parameters": {k: v for k, v in j.parameters.items() if k in ENTRIES}})
        for j in robot.joints
    )  # fmt: skip
    return links(robot.model_copy(update={"joints": tuple(joints), "identified": "computed", "known": ()}))


def test_pinocchio_has_the_torque_of_a_robot_in_frames_of_denavit_and_hartenberg(tmp_path: Path) -> None:
    pytest.importorskip("pinocchio")
    made = export_robot(TX40, tmp_path / "tx40.urdf")
    for q, dq, ddq, torque in points(bare(made.robot)):
        theirs = by_pinocchio(made.path, q, dq, ddq)
        np.testing.assert_allclose(theirs, torque, rtol=0, atol=1e-9 * np.abs(torque).max())
    assert made.away < 0.01
    assert any("Ia3" in remark and "no place" in remark for remark in made.remarks)


def test_mujoco_has_it_too(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    made = export_robot(TX40, tmp_path / "tx40.xml")
    for q, dq, ddq, torque in points(bare(made.robot)):
        np.testing.assert_allclose(by_mujoco(made.path, q, dq, ddq), torque, atol=1e-9 * np.abs(torque).max())


def test_mjcf_has_links_frames_and_what_joints_hold(tmp_path: Path) -> None:
    made = export_robot(TX40, tmp_path / "tx40.xml")
    bodies = list(ET.parse(made.path).getroot().iter("body"))
    for joint, body in zip(made.robot.joints, bodies, strict=True):
        w, x, y, z = (float(part) for part in body.attrib["quat"].split())
        turned = Rotation.from_quat([x, y, z, w]).as_matrix()
        np.testing.assert_allclose(turned, pose_of(joint)[:3, :3], atol=1e-12)
        at = [float(part) for part in body.attrib["pos"].split()]
        np.testing.assert_allclose(at, pose_of(joint)[:3, 3], atol=1e-12)
        (inertial, moves), link = body.findall("inertial") + body.findall("joint"), body_of(joint.parameters)
        assert float(inertial.attrib["mass"]) == link.mass
        xx, yy, zz, xy, xz, yz = (float(part) for part in inertial.attrib["fullinertia"].split())
        np.testing.assert_allclose([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], link.at_centre)
        held = {"armature": "Ia", "damping": "Fv", "frictionloss": "Fc"}
        assert all(float(moves.attrib[a]) == joint.parameters[p] for a, p in held.items() if a in moves.attrib)
        assert {a for a, p in held.items() if joint.parameters.get(p)} <= moves.attrib.keys()


@pytest.mark.parametrize("seed", range(6))
def test_files_keep_their_torque_through_fixed_joints_and_axes_that_are_askew(seed: int, tmp_path: Path) -> None:
    pytest.importorskip("pinocchio")
    found = list(differences(drawn(seed, tmp_path)))
    assert {"in its file", "by itself"} <= {way for way, *_ in found}
    assert max(off for _, off, _ in found) < 1e-9
    assert not any(said for *_, said in found)  # ROS's check_urdf, where it is there


def test_the_file_of_a_case_keeps_what_is_no_inertia(tmp_path: Path) -> None:
    path = drawn(3, tmp_path)
    text = path.read_text(encoding="utf-8").replace('<link name="l1">', '<link name="l1"><visual><!-- it --></visual>')
    path.write_text(text, encoding="utf-8")
    made = export_robot(loop_of(tmp_path, path), tmp_path / "inside.urdf")
    written = made.path.read_text(encoding="utf-8")
    assert "<!-- it -->" in written and "<visual>" in written
    assert [j.name for j in read_urdf(made.path).joints] == [j.name for j in read_urdf(path).joints]
    alone = export_robot(loop_of(tmp_path, as_yaml(path, tmp_path)), tmp_path / "alone.urdf")
    assert "<visual>" not in alone.path.read_text(encoding="utf-8")
    assert any("No distribution of mass" in remark for remark in made.remarks)  # its numbers are any


def as_yaml(path: Path, folder: Path) -> Path:
    write_robot(read_urdf(path), folder / "described.yaml")
    return folder / "described.yaml"


def loop_of(folder: Path, robot: Path) -> dict[str, Any]:
    """The content of a case with this robot and a controller with one gain for each joint."""
    description = read_robot(robot)
    count = len(description.joints)
    kinds = [joint.type for joint in description.joints]
    controller = {
        "schema": 1, "law": "pd", "name": "pd", "joints": kinds, "rate_hz": 100, "Kp": [100.0] * count,
        "Kd": [10.0] * count,
    }  # fmt: skip
    (folder / "pd.yaml").write_text(yaml.safe_dump(controller), encoding="utf-8")
    joints = [{"cosine": [0.1], "sine": [0.1]} for _ in range(count)]
    return {
        "schema": 1, "name": "drawn", "robot": str(robot), "plant": {"kind": "model"},
        "controller": {"kind": "model", "source": str(folder / "pd.yaml")},
        "train": {
            "reference": {"kind": "fourier", "fundamental_hz": 0.5, "duration_s": 2, "joints": joints},
            "torque": {"file": "none.csv"},
        },
    }  # fmt: skip


def test_identified_values_are_in_the_file(scara: Path, tmp_path: Path) -> None:
    result = read_result(scara)
    made = export_robot(SCARA, tmp_path / "scara.urdf", result=scara)
    for name, value in made.base.items():
        assert value == pytest.approx(result.parameters[name].value, rel=1e-6), name
    text = made.path.read_text(encoding="utf-8")
    assert "values identified in SCARA, torque at 10 Hz (valid)" in text
    assert any("a gravity of 0 m/s2" in remark for remark in made.remarks)
    assert any("no mass of link 1, 2" in remark for remark in made.remarks)
    again = read_urdf(made.path)
    for ours, theirs in zip(made.robot.joints, again.joints, strict=True):
        assert theirs.parameters["Fv"] == ours.parameters["Fv"]
        assert theirs.parameters["ZZ"] == pytest.approx(ours.parameters["ZZ"])


def test_a_description_with_identified_values_gives_the_same_torque_and_can_be_identified_again(
    scara: Path, tmp_path: Path
) -> None:
    made = export_robot(SCARA, tmp_path / "robot.yaml", result=scara)
    robot = read_robot(made.path)
    assert robot.joints == made.robot.joints
    assert "identified in" in robot.source
    parameters = load_case(SCARA).with_(robot=str(made.path), plant={"kind": "model"}).model
    for name, value in zip(parameters.names, parameters.start, strict=True):
        assert value == pytest.approx(made.base[name], rel=1e-9)


@pytest.mark.gate
def test_draws_scatter_as_the_covariance_says(scara: Path, tmp_path: Path) -> None:
    made = export_robot(SCARA, tmp_path / "scara.yaml", result=scara, draws=60, seed=4)
    result = read_result(scara)
    assert [path.name for path in made.draws[:2]] == ["scara_01.yaml", "scara_02.yaml"]
    drawn_values = []
    for path in made.draws:
        robot = RobotModel(read_robot(path))
        base = base_parameters(robot)
        drawn_values.append(dict(zip(base.names, base.reduce(robot.parameter_values), strict=True)))
    for name, parameter in result.parameters.items():
        own = np.array([one[name] for one in drawn_values])
        assert 0.7 < own.std() / parameter.std < 1.4, name
    first = made.draws[0].read_text(encoding="utf-8")
    again = export_robot(SCARA, tmp_path / "again.yaml", result=scara, draws=1, seed=4)
    assert again.draws[0].read_text(encoding="utf-8") == first
    assert any("60 draws from the covariance, seed 4" in remark for remark in made.remarks)


def doubted(scara: Path, folder: Path) -> Path:
    document = json.loads(scara.read_text(encoding="utf-8"))
    document["verdict"] = "doubtful"
    document["parameters"]["ZZ2"]["value"] *= -1
    (folder / "result.json").write_text(json.dumps(document), encoding="utf-8")
    return folder / "result.json"


def test_what_may_mislead_is_told(scara: Path, tmp_path: Path) -> None:
    made = export_robot(SCARA, tmp_path / "scara.urdf", result=doubted(scara, tmp_path))
    assert any("The result is doubtful" in remark for remark in made.remarks)
    assert any("No links have these base parameters" in remark for remark in made.remarks)
    assert made.away > 10


def test_a_format_that_cannot_state_a_motor_says_so(tmp_path: Path) -> None:
    case = load_case(SCARA)
    assert isinstance(case.robot, RobotDescription)
    motor = {"gear_ratio": 100, "pole_pairs": 4}
    joints = [joint.model_copy(update={"motor": Motor(**motor)}) for joint in case.robot.joints[:1]]
    driven = case.with_(robot=case.robot.model_copy(update={"joints": (*joints, *case.robot.joints[1:])}))
    for name in ("robot.urdf", "robot.xml"):
        remarks = export_robot(driven, tmp_path / name).remarks
        assert any("the motor of joint 1 (gear_ratio: 100, pole_pairs: 4)" in remark for remark in remarks), remarks
    assert export_robot(driven, tmp_path / "robot.yaml").robot.joints[0].motor == Motor(**motor)
    assert read_robot(tmp_path / "robot.yaml").joints[0].motor == Motor(**motor)


def test_wrong_input_is_refused_before_anything_is_written(scara: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="written as URDF, MJCF or YAML"):
        export_robot(SCARA, tmp_path / "robot.sdf")
    with pytest.raises(InputError, match="another robot"):
        export_robot(TX40, tmp_path / "robot.urdf", result=scara)
    with pytest.raises(InputError, match="no covariance to draw from"):
        export_robot(SCARA, tmp_path / "robot.urdf", draws=3)
    (tmp_path / "robot_2.urdf").write_text("mine", encoding="utf-8")
    with pytest.raises(InputError, match="there already"):
        export_robot(SCARA, tmp_path / "robot.urdf", result=scara, draws=3)
    assert (tmp_path / "robot_2.urdf").read_text(encoding="utf-8") == "mine"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["robot_2.urdf"]


def test_the_command_says_what_it_wrote(scara: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.copy(scara, tmp_path / "result.json")
    command = ["export", str(SCARA), "--robot", str(tmp_path / "s.urdf"), "--result", str(tmp_path), "--draws", "2"]
    assert main(command) == 0
    said = capsys.readouterr().out
    assert "s.urdf and s_1.urdf to s_2.urdf" in said
    assert "Data determine base parameters alone." in said
    assert main(["export", str(SCARA), "--draws", "2"]) == 1
    assert "--draws goes with --robot" in capsys.readouterr().err
    assert isinstance(read_result(tmp_path), ResultDocument)
