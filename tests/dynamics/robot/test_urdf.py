"""URDF files: the same torque as Pinocchio's, and what no serial robot has is refused by name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fmu_didim import identify, load_case
from fmu_didim.base.errors import InputError
from fmu_didim.cli.main import main
from fmu_didim.dynamics.base_parameters import base_parameters
from fmu_didim.dynamics.robot import RobotDescription, RobotModel, read_robot, write_robot
from fmu_didim.dynamics.robot.body import right_angle
from fmu_didim.dynamics.robot.formats.urdf import read_urdf
from fmu_didim.dynamics.robot.formats.write_urdf import urdf_of
from tests.helpers import ROOT

AXES = ["0 0 1", "0 1 0", "1 0 0", "0 0 -1", "0 0 1"]
TURNS = [0.0, np.pi / 2, -np.pi / 2, np.pi]


def link(name: str, rng: np.random.Generator) -> str:
    root = rng.normal(size=(3, 3))
    j, m = root @ root.T + np.eye(3), rng.uniform(0.5, 3.0)
    entries = " ".join(f'i{"xyz"[a]}{"xyz"[b]}="{0.02 * m * j[a, b]}"' for a in range(3) for b in range(a, 3))
    centre, turn = text(0.1 * rng.normal(size=3)), text(rng.normal(size=3))
    return (
        f'<link name="{name}"><inertial><origin xyz="{centre}" rpy="{turn}"/>'
        f'<mass value="{m}"/><inertia {entries}/></inertial></link>'
    )


def joint(
    name: str, kind: str, parent: str, child: str, *, xyz: str = "0 0 0", rpy: str = "0 0 0", axis: str = "0 0 1"
) -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>'
        '<limit lower="-2" upper="2" effort="9" velocity="3"/></joint>'
    )


def text(values: np.ndarray) -> str:
    return " ".join(str(float(v)) for v in values)


def drawn(seed: int, folder: Path, joints: int = 7) -> Path:
    """A chain with fixed and sliding joints; axes that are askew, or parallel, crossing and on each other."""
    rng, parts = np.random.default_rng(seed), ['<robot name="drawn 1">', '<link name="l0"/>']
    for j in range(1, joints + 1):
        kind = "revolute" if j in (1, joints) else str(rng.choice(["revolute", "continuous", "prismatic", "fixed"]))
        if seed % 2:
            pose = {
                "xyz": text(0.3 * rng.normal(size=3)),
                "rpy": text(rng.normal(size=3)),
                "axis": text(rng.normal(size=3)),
            }
        else:
            xyz, rpy = 0.3 * rng.integers(0, 2, size=3), rng.choice(TURNS, size=3)
            pose = {"xyz": text(xyz), "rpy": text(rpy), "axis": str(rng.choice(AXES))}
        parts += [link(f"l{j}", rng), joint(f"j{j}", kind, f"l{j - 1}", f"l{j}", **pose)]
    (path := folder / "drawn.urdf").write_text("".join([*parts, "</robot>"]), encoding="utf-8")
    return path


def bare(robot: RobotDescription) -> RobotModel:
    """The robot with nothing but its links."""
    joints = (j.model_copy(update={"effects": ()}) for j in robot.joints)
    return RobotModel(robot.model_copy(update={"joints": tuple(joints)}))


@pytest.mark.parametrize("seed", range(12))
def test_torque_is_that_of_pinocchio(seed: int, tmp_path: Path) -> None:
    pin = pytest.importorskip("pinocchio")
    path, rng = drawn(seed, tmp_path), np.random.default_rng(seed)
    theirs, robot = pin.buildModelFromUrdf(str(path)), bare(read_robot(path))
    chi = robot.parameter_values
    for _ in range(3):
        q, dq, ddq = rng.normal(size=(3, robot.joint_count))
        q_theirs = pin.neutral(theirs)
        for one in list(theirs.joints)[1:]:
            angle = q[one.idx_v]
            q_theirs[one.idx_q : one.idx_q + one.nq] = [angle] if one.nq == 1 else [np.cos(angle), np.sin(angle)]
        wanted = pin.rnea(theirs, theirs.createData(), q_theirs, dq, ddq)
        got = np.array(robot.inverse(q, dq, ddq, chi, [])).ravel()
        np.testing.assert_allclose(got, wanted, rtol=0, atol=1e-9 * np.abs(wanted).max())


TREE = '<robot name="r"><link name="a"/><link name="b"/><link name="c"/><link name="d"/>{}</robot>'
FIRST = joint("j1", "revolute", "a", "b")
HEAVY = '<link name="d"><inertial><mass value="-1"/></inertial></link>'
REFUSED = [
    ("<robot", "no XML"),
    ('<sdf version="1.7"/>', "no URDF"),
    ('<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:macro/></robot>', "no URDF"),
    ('<!DOCTYPE robot [<!ENTITY a "b">]><robot/>', "document type"),
    (TREE.format(""), "no joint that moves"),
    (TREE.format(FIRST + joint("j2", "revolute", "b", "x")), "names a link that is not there"),
    (TREE.format(FIRST + joint("j2", "revolute", "c", "b")), "closed loop"),
    (TREE.format(FIRST + joint("j2", "revolute", "b", "a")), "ring without a root"),
    (TREE.format(FIRST + joint("j2", "revolute", "b", "c") + joint("j3", "prismatic", "b", "d")), "--tip b "),
    (TREE.format(FIRST + joint("j2", "floating", "b", "c")), "type of joint is not known"),
    (TREE.format(FIRST + joint("j2", "revolute", "b", "c").replace("<limit", '<mimic joint="j1"/><limit')), "mimic"),
    (TREE.format(joint("j1", "revolute", "a", "b", axis="0 0 0")), "axis has no direction"),
    (TREE.format(joint("j1", "revolute", "a", "b", xyz="0 0")), "not 3 finite numbers"),
    (TREE.format(joint("j1", "revolute", "a", "b", rpy="0 nan 0")), "not 3 finite numbers"),
    (TREE.format(FIRST).replace('<link name="d"/>', HEAVY), "negative"),
    (TREE.format(FIRST).replace('<link name="d"/>', "<link/>"), "link has no name"),
    (TREE.format(FIRST.replace('<parent link="a"/>', "")), "no parent link"),
]  # fmt: skip


@pytest.mark.parametrize(("content", "words"), REFUSED)
def test_what_is_no_serial_robot_is_refused(content: str, words: str, tmp_path: Path) -> None:
    (path := tmp_path / "r.urdf").write_text(content, encoding="utf-8")
    with pytest.raises(InputError, match=words) as caught:
        read_robot(path)
    assert caught.value.next_step


def test_a_tip_leaves_the_gripper_where_it_is(tmp_path: Path) -> None:
    """Its mass belongs to the link that carries it."""
    rng = np.random.default_rng(3)
    names = ["base", "arm", "left", "right"]
    fingers = joint("f1", "prismatic", "arm", "left", xyz="0 0.1 0.5") + joint(
        "f2", "prismatic", "arm", "right", xyz="0 -0.1 0.5"
    )
    content = "".join(
        [
            '<robot name="r">',
            *(link(n, rng) for n in names),
            joint("j1", "revolute", "base", "arm"),
            fingers,
            "</robot>",
        ]
    )
    (path := tmp_path / "r.urdf").write_text(content, encoding="utf-8")
    with pytest.raises(InputError, match="left, right"):
        read_robot(path)
    with_fingers = read_urdf(path, tip="arm")
    (tmp_path / "alone.urdf").write_text(content.replace(fingers, ""), encoding="utf-8")
    alone = read_urdf(tmp_path / "alone.urdf", tip="arm")
    assert [j.name for j in with_fingers.joints] == ["j1"]
    assert with_fingers.joints[0].parameters["M"] > alone.joints[0].parameters["M"]
    with pytest.raises(InputError, match="No joint that moves leads"):
        read_urdf(path, tip="base")
    with pytest.raises(InputError, match="no link of the name"):
        read_urdf(path, tip="hand")


def test_the_verb_shows_and_writes_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, out = drawn(3, tmp_path), tmp_path / "robot.yaml"
    assert main(["robot", str(path), "--out", str(out)]) == 0
    shown = capsys.readouterr().out
    assert "base parameters: " in shown
    assert read_robot(out) == read_robot(path)
    assert main(["robot", str(path), "--out", str(out)]) == 1
    assert "there already" in capsys.readouterr().err
    assert main(["robot", str(out), "--tip", "l3"]) == 1
    assert main(["robot", str(tmp_path / "none.urdf")]) == 1


@pytest.mark.gate
def test_a_case_takes_it_as_its_robot(tmp_path: Path) -> None:
    """The SCARA of the examples as a URDF: the same base parameters, the same answer."""
    case = load_case(ROOT / "examples/scara/identify.yaml")
    before = read_robot(ROOT / "fmus/scara/robot.yaml")
    links = ['<link name="l0"/>']
    for j, one in enumerate(before.joints, start=1):
        zz, centre = one.parameters["ZZ"], [one.parameters.get(name, 0.0) for name in ("MX", "MY")]
        links.append(
            f'<link name="l{j}"><inertial><origin xyz="{centre[0]} {centre[1]} 0"/>'
            f'<mass value="1"/><inertia ixx="1" iyy="1" izz="{zz}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        )
    second = f"{before.joints[1].a} 0 0"
    moves = joint("j1", "revolute", "l0", "l1") + joint("j2", "revolute", "l1", "l2", xyz=second)
    content = f'<robot name="scara">{"".join(links)}{moves}</robot>'
    (path := tmp_path / "scara.urdf").write_text(content, encoding="utf-8")
    robot = read_robot(path)
    assert [(j.type, j.alpha, j.a, j.d) for j in robot.joints] == [(j.type, j.alpha, j.a, j.d) for j in before.joints]
    found = identify(case.with_(robot=str(path), estimator={"kind": "didim"}))
    wanted = identify(case.with_(estimator={"kind": "didim"}))
    for name in ("ZZ2", "MX2", "MY2"):
        one, other = found.parameters[name], wanted.parameters[name]
        assert abs(one.value - other.value) < 2 * one.std


def test_what_rounded_angles_leave_is_no_value(tmp_path: Path) -> None:
    """A link that lies along an axis of its frame, turned by angles of twelve digits, has one first moment and three
    inertias; a small link far out keeps its own."""
    slim = (
        '<link name="{}"><inertial><origin xyz="0 0 {}" rpy="0 1.570796326795 0"/><mass value="{}"/>'
        '<inertia ixx="{}" ixy="0" ixz="0" iyy="{}" iyz="0" izz="{}"/></inertial></link>'
    )
    content = "".join([
        '<robot name="r"><link name="a"/>', slim.format("b", 0.3, 10.0, 0.04, 1.2, 1.2),
        slim.format("c", 0.01, 0.02, 1e-6, 2e-6, 2.5e-6),
        joint("j1", "revolute", "a", "b", rpy="1.570796326795 0 0"),
        joint("j2", "revolute", "b", "c", xyz="0 0 0.6", rpy="0 1.570796326795 3.14159265359"), "</robot>",
    ])  # fmt: skip
    (path := tmp_path / "r.urdf").write_text(content, encoding="utf-8")
    for link_ in read_urdf(path).joints:
        held = {name for name in link_.parameters if name not in ("M", "Fv", "Fc")}
        assert len(held & {"MX", "MY", "MZ"}) == 1 and held - {"MX", "MY", "MZ"} == {"XX", "YY", "ZZ"}


@pytest.mark.parametrize(
    ("written", "read"),
    [
        (1.57, np.pi / 2), (-1.5708, -np.pi / 2), (1.5707, np.pi / 2), (1.570796327, np.pi / 2), (np.pi / 2, np.pi / 2),
        (3.14, np.pi), (3.1416, np.pi), (-3.1415, -np.pi), (4.712, 3 * np.pi / 2),
        (1.6, 1.6), (1.58, 1.58), (3.15, 3.15), (1.5705, 1.5705), (1.570792, 1.570792), (0.7854, 0.7854), (0.0, 0.0),
        (0.003, 0.003),
    ],
)  # fmt: skip
def test_rounded_right_angles_are_exact(written: float, read: float) -> None:
    assert right_angle(written) == read


def test_rounded_angles_leave_no_parameters_that_no_data_tell_apart(tmp_path: Path) -> None:
    """A motor across the axis before it acts like the inertia of its link, whatever digits the file has."""
    names = []
    for quarter in ("1.5707963267948966", "1.5708", "1.57"):
        parts = ['<robot name="arm"><link name="l0"/>', *(link(f"l{j}", np.random.default_rng(j)) for j in (1, 2, 3))]
        parts += [joint("j1", "revolute", "l0", "l1"), joint("j2", "revolute", "l1", "l2", rpy=f"{quarter} 0 0")]
        parts += [joint("j3", "revolute", "l2", "l3", xyz="0.4 0 0", rpy=f"-{quarter} -{quarter} 0"), "</robot>"]
        (path := tmp_path / "arm.urdf").write_text("".join(parts), encoding="utf-8")
        names.append(base_parameters(RobotModel(read_urdf(path))).names)
    assert names[0] == names[1] == names[2]
    assert "Ia2" not in names[0]


def calibrated(folder: Path, error: float, seed: int = 5) -> Path:
    """A six-axis arm with a parallel upper arm, forearm and wrist, each joint turned by some ``error`` in rad."""
    rng = np.random.default_rng(seed)
    meant = [
        ("0 0 0.18", (0, 0, 0)), ("0 0 0", (np.pi / 2, 0, 0)), ("-0.61 0 0", (0, 0, 0)), ("-0.57 0 0.17", (0, 0, 0)),
        ("0 -0.12 0", (np.pi / 2, 0, 0)), ("0 0.11 0", (np.pi / 2, np.pi, np.pi)),
    ]  # fmt: skip
    parts = ['<robot name="arm"><link name="l0"/>', *(link(f"l{j}", np.random.default_rng(j)) for j in range(1, 7))]
    for j, (xyz, rpy) in enumerate(meant, start=1):
        off = np.zeros(3) if j == 1 else error * rng.normal(size=3)
        parts.append(joint(f"j{j}", "revolute", f"l{j - 1}", f"l{j}", xyz=xyz, rpy=text(np.array(rpy) + off)))
    (path := folder / f"arm{error}.urdf").write_text("".join([*parts, "</robot>"]), encoding="utf-8")
    return path


@pytest.mark.parametrize("error", [1e-8, 1e-6, 1e-4, 2e-3])
def test_a_calibrated_arm_keeps_its_frames_at_the_joints(error: float, tmp_path: Path) -> None:
    """Its torque is that of Pinocchio, no frame is far away, and it has the parameters of the arm as it was meant."""
    pin = pytest.importorskip("pinocchio")
    path, rng = calibrated(tmp_path, error), np.random.default_rng(2)
    theirs, robot = pin.buildModelFromUrdf(str(path)), bare(read_robot(path))
    assert max(abs(value) for j in robot.description.joints for value in (j.a, j.d)) < 1.0
    for _ in range(3):
        q, dq, ddq = rng.normal(size=(3, 6))
        wanted = pin.rnea(theirs, theirs.createData(), q, dq, ddq)
        got = np.array(robot.inverse(q, dq, ddq, robot.parameter_values, [])).ravel()
        np.testing.assert_allclose(got, wanted, rtol=0, atol=1e-9 * np.abs(wanted).max())
    meant = bare(read_robot(calibrated(tmp_path, 0.0)))
    assert base_parameters(robot).standard == base_parameters(meant).standard


@pytest.mark.parametrize("error", [1e-4, 2e-3])
def test_base_parameters_of_a_calibrated_arm_give_its_torque(error: float, tmp_path: Path) -> None:
    """But for what axes that are a little off do in the parameters that are held at zero: a hundredth at most."""
    robot, rng = bare(read_robot(calibrated(tmp_path, error))), np.random.default_rng(4)
    base = base_parameters(robot)
    whole, grouped = robot.parameter_values, base.expand(base.reduce(robot.parameter_values))
    off, size = 0.0, 0.0
    for q, dq, ddq in rng.normal(size=(50, 3, 6)):
        torque = [np.array(robot.inverse(q, dq, ddq, chi, [])).ravel() for chi in (whole, grouped)]
        off, size = max(off, float(np.abs(torque[0] - torque[1]).max())), max(size, float(np.abs(torque[0]).max()))
    assert off < 3 * error * size


def test_what_is_written_back_has_the_angle_that_is_left(tmp_path: Path) -> None:
    robot = read_robot(calibrated(tmp_path, 2e-3))
    write_robot(robot, tmp_path / "robot.yaml")
    urdf_of(robot).write(tmp_path / "again.urdf")
    again, other = read_robot(tmp_path / "robot.yaml"), bare(read_robot(tmp_path / "again.urdf"))
    assert any(joint.beta for joint in robot.joints)
    assert again.joints == robot.joints
    q, dq, ddq = np.random.default_rng(6).normal(size=(3, 6))
    torque = [np.array(r.inverse(q, dq, ddq, r.parameter_values, [])).ravel() for r in (bare(robot), other)]
    np.testing.assert_allclose(torque[1], torque[0], atol=1e-9 * np.abs(torque[0]).max())
