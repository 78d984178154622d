"""The same robot in classical frames, in modified ones and as a URDF; what is told of the convention that was read."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from pydantic import ValidationError

from fmu_didim.base.errors import InputError
from fmu_didim.data.signals import Array
from fmu_didim.dynamics.robot import RobotDescription, RobotModel, read_robot, write_robot
from fmu_didim.dynamics.robot.description import Joint, modified_joints
from fmu_didim.dynamics.robot.formats.write_urdf import pose_of
from fmu_didim.workflow.robot_file import robot_lines, write_picture
from tests.dynamics.robot.test_urdf import bare

NAMES = ("XX", "YY", "ZZ", "XY", "XZ", "YZ")
PLACES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


def rotation(axis: int, angle: float) -> Array:
    """(4, 4), written out."""
    c, s = np.cos(angle), np.sin(angle)
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    pose = np.eye(4)
    pose[i, i] = pose[j, j] = c
    pose[i, j], pose[j, i] = -s, s
    return pose


def shift(axis: int, length: float) -> Array:
    pose = np.eye(4)
    pose[axis, 3] = length
    return pose


def link_about(mass: float, centre: Array, at_centre: Array) -> dict[str, float]:
    """Parameters about the origin of a frame by Steiner's theorem, of a body whose centre and axes are in it."""
    inertia = at_centre + mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    moments = dict(zip(("MX", "MY", "MZ"), mass * centre, strict=True))
    return {
        k: float(v)
        for k, v in ({"M": mass} | moments | {n: inertia[p] for n, p in zip(NAMES, PLACES, strict=True)}).items()
    }


class Arm:
    """A drawn arm of mixed joints: rows in the classical convention; masses, centres and inertias in these frames."""

    def __init__(self, seed: int, n: int = 5) -> None:
        rng = np.random.default_rng(seed)
        self.types = ["revolute", *rng.choice(["revolute", "prismatic"], n - 2), "revolute"]
        right = np.pi / 2 * rng.integers(-1, 3, n)
        self.alpha = right if seed % 2 else rng.uniform(-2, 2, n)
        self.a, self.d = rng.normal(scale=0.3, size=(2, n))
        self.theta = rng.uniform(-3, 3, n)
        self.mass, self.centre = rng.uniform(0.5, 5.0, n), rng.normal(scale=0.2, size=(n, 3))
        root = rng.normal(size=(n, 3, 3))
        self.at_centre = 0.02 * (root @ root.transpose(0, 2, 1) + np.eye(3))
        self.gravity = (1.0, -2.0, -9.0)

    def behind(self, j: int) -> Array:
        """(4, 4) of classical frame j in the frame that lies on its link where its joint has moved."""
        return shift(0, self.a[j]) @ rotation(0, self.alpha[j])

    def before(self, j: int, q: float) -> Array:
        turned, slid = (q, 0.0) if self.types[j] == "revolute" else (0.0, q)
        return rotation(2, self.theta[j] + turned) @ shift(2, self.d[j] + slid)

    def document(self, *, standard: bool) -> dict[str, Any]:
        joints = []
        for j, kind in enumerate(self.types):
            if standard:
                row, body = (self.alpha[j], self.a[j]), (self.centre[j], self.at_centre[j])
            else:
                row = (0.0, 0.0) if j == 0 else (self.alpha[j - 1], self.a[j - 1])
                pose = self.behind(j)
                turn = pose[:3, :3]
                body = (turn @ self.centre[j] + pose[:3, 3], turn @ self.at_centre[j] @ turn.T)
            joints.append(
                {
                    "type": kind, "alpha": float(row[0]), "a": float(row[1]), "theta": float(self.theta[j]),
                    "d": float(self.d[j]), "parameters": link_about(float(self.mass[j]), *body),
                }
            )  # fmt: skip
        return {"name": "arm", "gravity": self.gravity, "joints": joints} | ({"frames": "standard"} if standard else {})

    def urdf(self) -> str:
        """Link j has the frame in which joint j moves about z, with its body behind the row of the table."""
        parts, placed = ['<robot name="arm"><link name="l0"/>'], upright(self.gravity)
        for j, kind in enumerate(self.types):
            after = self.before(j, 0.0) @ self.behind(j)
            centre = after[:3, :3] @ self.centre[j] + after[:3, 3]
            inertia = after[:3, :3] @ self.at_centre[j] @ after[:3, :3].T
            entries = " ".join(f'i{"xyz"[i]}{"xyz"[k]}="{float(inertia[i, k])!r}"' for i, k in PLACES)
            parts.append(
                f'<link name="l{j + 1}"><inertial><origin xyz="{text(centre)}"/><mass value="{float(self.mass[j])!r}"/>'
                f'<inertia {entries}/></inertial></link><joint name="j{j}" type="{kind}"><parent link="l{j}"/>'
                f'<child link="l{j + 1}"/><origin xyz="{text(placed[:3, 3])}" rpy="{text(angles(placed))}"/>'
                '<axis xyz="0 0 1"/><limit lower="-9" upper="9" effort="1" velocity="1"/></joint>'
            )
            placed = after
        return "".join([*parts, "</robot>"])


def text(values: Any) -> str:
    return " ".join(repr(float(v)) for v in values)


def angles(pose: Array) -> tuple[float, float, float]:
    """Roll, pitch and yaw."""
    r = pose[:3, :3]
    return float(np.arctan2(r[2, 1], r[2, 2])), float(-np.arcsin(r[2, 0])), float(np.arctan2(r[1, 0], r[0, 0]))


def upright(gravity: tuple[float, ...]) -> Array:
    """(4, 4) of a base, in which gravity is this, in a root in which it points along -z."""
    z = -np.array(gravity) / np.linalg.norm(gravity)
    x = np.cross([0.0, 1.0, 0.0], z) / np.linalg.norm(np.cross([0.0, 1.0, 0.0], z))
    pose = np.eye(4)
    pose[:3, :3] = np.stack([x, np.cross(z, x), z])
    return pose


def end(robot: RobotDescription, q: Array) -> Array:
    """(4, 4) of the last modified frame in that of the base."""
    pose = np.eye(4)
    for joint, position in zip(robot.joints, q, strict=True):
        moved = "theta" if joint.type == "revolute" else "d"
        pose = pose @ pose_of(joint.model_copy(update={moved: getattr(joint, moved) + position}))
    return pose


@pytest.mark.parametrize("seed", range(10))
def test_three_routes_to_one_robot_agree(seed: int, tmp_path: Path) -> None:
    arm, rng = Arm(seed), np.random.default_rng(seed)
    (path := tmp_path / "arm.urdf").write_text(arm.urdf(), encoding="utf-8")
    standard, modified = (RobotDescription.model_validate(arm.document(standard=s)) for s in (True, False))
    from_urdf = read_robot(path)
    from_urdf = from_urdf.model_copy(
        update={"gravity": tuple(np.array(from_urdf.gravity) * np.linalg.norm(arm.gravity) / 9.81)}
    )
    models = [bare(robot) for robot in (standard, modified, from_urdf)]
    for _ in range(4):
        q, dq, ddq = rng.normal(size=(3, len(arm.types)))
        for motion in ((q, dq, ddq), (q, 0 * q, 0 * q)):
            torques = [np.array(m.inverse(*motion, m.parameter_values, [])).ravel() for m in models]
            size = np.abs(torques[1]).max()
            np.testing.assert_allclose(torques[0], torques[1], rtol=0, atol=1e-12 * size)
            np.testing.assert_allclose(torques[2], torques[1], rtol=0, atol=1e-11 * size)  # lengths have 12 digits
        there = np.eye(4)
        for j, position in enumerate(q):
            there = there @ arm.before(j, position) @ arm.behind(j)
        np.testing.assert_allclose(end(standard, q) @ arm.behind(len(q) - 1), there, atol=1e-12)
        np.testing.assert_allclose(end(modified, q), end(standard, q), atol=1e-12)


def by_parts(document: dict[str, Any], amplitudes: Array) -> dict[str, Any]:
    """The arm of a document with a load that joins its link 3, and this much of it."""
    joints = [dict(joint) for joint in document["joints"]]
    joints[2] |= {"effects": ["payload_change"]}
    joints[2]["parameters"] = joints[2]["parameters"] | dict(zip(("dM", "dMX", "dMY", "dMZ"), amplitudes, strict=True))
    return document | {"joints": joints}


def test_a_load_that_joins_a_link_is_brought_along() -> None:
    arm, rng = Arm(1), np.random.default_rng(1)
    centre, pose = np.array([0.1, -0.2, 0.3]), arm.behind(2)
    there = pose[:3, :3] @ centre + pose[:3, 3]
    models = []
    for standard, c in ((True, centre), (False, there)):
        document = by_parts(arm.document(standard=standard), np.array([2.0, *(2.0 * c)]))
        models.append(RobotModel(RobotDescription.model_validate(document)))
    q, dq, ddq = rng.normal(size=(3, 5))
    one, other = (np.array(m.regressor(q, dq, ddq, 5.0, []) @ m.parameter_values).ravel() for m in models)
    np.testing.assert_allclose(one, other, rtol=1e-12)


# P. Corke, B. Armstrong-Helouvry, ICRA 1994: rows alpha, a, d, mass, centre and diagonal inertia about it in classical
# frames, and inertia of the motor times the square of its gear ratio.
PUMA = (
    ("pi/2", 0.0, 0.672, 0.0, (0.0, 0.0, 0.0), (0.0, 0.35, 0.0), 200e-6 * 62.6111**2),
    (0.0, 0.4318, 0.0, 17.4, (-0.3638, 0.006, 0.2275), (0.13, 0.524, 0.539), 200e-6 * 107.815**2),
    ("-pi/2", 0.0203, 0.15005, 4.8, (-0.0203, -0.0141, 0.070), (0.066, 0.086, 0.0125), 200e-6 * 53.7063**2),
    ("pi/2", 0.0, 0.4318, 0.82, (0.0, 0.019, 0.0), (1.8e-3, 1.3e-3, 1.8e-3), 33e-6 * 76.0364**2),
    ("-pi/2", 0.0, 0.0, 0.34, (0.0, 0.0, 0.0), (0.3e-3, 0.4e-3, 0.3e-3), 33e-6 * 71.923**2),
    (0.0, 0.0, 0.0, 0.09, (0.0, 0.0, 0.032), (0.15e-3, 0.15e-3, 0.04e-3), 33e-6 * 76.686**2),
)  # fmt: skip
POSTURE = np.array([0.0, np.pi / 4, np.pi, 0.0, np.pi / 4, 0.0])
PUMA_GRAVITY = (0.0, 31.6399, 6.0351, 0.0, 0.0283, 0.0)
PUMA_INERTIA = (
    (3.6594, -0.4044, 0.1006, -0.0025, 0.0, 0.0), (-0.4044, 4.4137, 0.3509, 0.0, 0.0024, 0.0),
    (0.1006, 0.3509, 0.9378, 0.0, 0.0015, 0.0), (-0.0025, 0.0, 0.0, 0.1925, 0.0, 0.0),
    (0.0, 0.0024, 0.0015, 0.0, 0.1713, 0.0), (0.0, 0.0, 0.0, 0.0, 0.0, 0.1941),
)  # fmt: skip
"""As P. Corke, Robotics, Vision and Control, prints them in this posture, in N.m and kg.m2."""


def puma(**options: Any) -> RobotDescription:
    joints = [
        {
            "type": "revolute", "alpha": alpha, "a": a, "d": d, "effects": ["motor_inertia"],
            "parameters": link_about(mass, np.array(centre), np.diag(inertia)) | {"Ia": motor},
        }
        for alpha, a, d, mass, centre, inertia, motor in PUMA
    ]  # fmt: skip
    return RobotDescription.model_validate({"name": "puma", "joints": joints} | options)


def test_a_published_table_gives_the_published_torques() -> None:
    model, zero = RobotModel(puma(frames="standard")), np.zeros(6)
    gravity = np.array(model.inverse(POSTURE, zero, zero, model.parameter_values, [])).ravel()
    np.testing.assert_allclose(gravity, PUMA_GRAVITY, atol=6e-5)
    columns = [np.array(model.inverse(POSTURE, zero, e, model.parameter_values, [])).ravel() for e in np.eye(6)]
    np.testing.assert_allclose(np.array(columns).T - gravity[:, None], PUMA_INERTIA, atol=6e-5)
    as_modified = RobotModel(puma())
    wrong = np.array(as_modified.inverse(POSTURE, zero, zero, as_modified.parameter_values, [])).ravel()
    assert np.abs(wrong - gravity).max() > 5.0  # read in the other convention it is another robot, and runs as well


def test_which_convention_was_read_is_told(tmp_path: Path) -> None:
    standard, given = "read in the classical (standard) convention and brought to modified", "write frames: standard"
    for robot, told, other in ((puma(frames="standard"), standard, given), (puma(), given, standard)):
        page = write_picture(robot, tmp_path / f"{robot.original_frames}.html").read_text(encoding="utf-8")
        lines = " ".join(" ".join(robot_lines(robot)).split())
        assert told in lines and told in page
        assert other not in lines and other not in page
    modified = RobotDescription.model_validate(Arm(0).document(standard=False))
    assert given not in " ".join(" ".join(robot_lines(modified)).split())


def test_what_is_written_is_in_modified_frames_and_says_so(tmp_path: Path) -> None:
    robot = puma(frames="standard")
    write_robot(robot, path := tmp_path / "robot.yaml")
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    assert (content["frames"], content["original_frames"]) == ("modified", "standard")
    assert read_robot(path) == robot  # and is not brought there twice
    assert robot.joints[1].alpha == pytest.approx(np.pi / 2)
    write_robot(puma(), path)
    assert "frames" not in path.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("entry", "is_refused"),
    [
        ({"known": ["MX2"]}, True), ({"known": ["M2", "Ia2"]}, False), ({"known": ["MX6"]}, False),
        ({"identified": {"ZZ1R": "ZZ1"}}, True), ({"identified": {"Ia3": "Ia3"}}, False),
    ],
)  # fmt: skip
def test_names_that_would_mean_another_frame_are_refused(entry: dict[str, Any], is_refused: bool) -> None:
    if is_refused:
        with pytest.raises(ValidationError, match=r"classical frame.*robot FILE --out"):
            puma(frames="standard", **entry)
    else:
        puma(frames="standard", **entry)


def test_another_word_for_the_convention_is_refused(tmp_path: Path) -> None:
    (path := tmp_path / "r.yaml").write_text("{name: r, frames: classical, joints: [{type: revolute}]}")
    with pytest.raises(InputError, match="'modified' or 'standard'"):
        read_robot(path)


@pytest.mark.parametrize("seed", range(3))
def test_the_angle_of_nearly_parallel_axes_moves_with_alpha_to_the_next_row(seed: int) -> None:
    """Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta), row by row, ends where the modified frames and the last row end."""
    rng, rows, place = np.random.default_rng(seed), [], np.eye(4)
    for alpha, a, theta, d, beta in rng.uniform(-0.5, 0.5, (4, 5)):
        rows.append(Joint(type="revolute", alpha=alpha, a=a, theta=theta, d=d, beta=beta))
        place = place @ rotation(2, theta) @ shift(2, d) @ shift(0, a) @ rotation(0, alpha) @ rotation(1, beta)
    found = np.eye(4)
    for joint in modified_joints(tuple(rows)):
        found = found @ pose_of(joint)
    np.testing.assert_allclose(found @ rows[-1].before, place, atol=1e-12)
