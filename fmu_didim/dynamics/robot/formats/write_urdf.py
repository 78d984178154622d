"""URDF, written: a robot by itself, or the values of a robot in the file that it was read from.

Joint j has its frame where frame j of the robot is at q = 0 (see :mod:`.urdf`), Tx(a) Rx(alpha) Ry(beta) Rz(theta)
Tz(d) in the frame of link j-1, and the z axis for its axis. The root stands so that gravity points downwards, as ROS
has it. Source: the URDF specification of ROS.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from fmu_didim.base.errors import InputError
from fmu_didim.data.signals import Array
from fmu_didim.dynamics.robot.body import Body, body_of, inverse, rounded, text_of, turn
from fmu_didim.dynamics.robot.description import Joint, RobotDescription
from fmu_didim.dynamics.robot.formats.urdf import GRAVITY, serial_robot

DAMPING, FRICTION = "Fv", "Fc"
"""Parameters that ``dynamics`` of a joint holds."""
UNKNOWN = 1e6
"""[N.m, N, rad/s, m/s, m] For limits that a joint must state and a robot does not."""


def urdf_of(robot: RobotDescription) -> ET.ElementTree[ET.Element]:
    """The file of a robot by itself. Raises InputError where a link has no mass."""
    root = ET.Element("robot", name=robot.name)
    root.append(ET.Comment(f" {robot.description or robot.name}; written by fmu_didim "))
    ET.SubElement(root, "link", name="base")
    parent, upright = "base", _upright(robot.gravity)
    if not np.allclose(upright, np.eye(4)):
        ET.SubElement(root, "link", name="frame0")
        _joint(root, "base_to_frame0", "fixed", "base", "frame0", upright)
        parent = "frame0"
    names = joint_names(robot)
    for j, (joint, name) in enumerate(zip(robot.joints, names, strict=True), start=1):
        link = ET.SubElement(root, "link", name=f"link{j}")
        _put_body(link, body_of(joint.parameters), f"link {j} of robot '{robot.name}'")
        moves = "prismatic" if joint.type == "prismatic" else "continuous" if joint.limits is None else "revolute"
        element = _joint(root, name, moves, parent, f"link{j}", pose_of(joint))
        ET.SubElement(element, "axis", xyz="0 0 1")
        if moves != "continuous":
            low, high = joint.limits or (-UNKNOWN, UNKNOWN)
            limits = {"lower": low, "upper": high, "effort": UNKNOWN, "velocity": UNKNOWN}
            ET.SubElement(element, "limit", {key: text_of(value) for key, value in limits.items()})
        _put_friction(element, joint)
        parent = f"link{j}"
    ET.indent(root)
    return ET.ElementTree(root)


def urdf_like(path: Path | str, robot: RobotDescription) -> ET.ElementTree[ET.Element]:
    """The file at ``path`` with the values of a robot that was read from it: each link that moves holds all that its
    joint carries, links behind fixed joints nothing. All else stays as it is.

    Raises:
        InputError: the robot has other joints than the file, or a link has no mass.
    """
    serial = serial_robot(path)
    theirs, ours = [joint.name for joint, _ in serial.chain], [joint.name for joint in robot.joints]
    if theirs != ours:
        raise InputError(
            "The robot has other joints than the URDF.", where=str(path), got=", ".join(ours), valid=", ".join(theirs),
            next_step="Take the URDF that the robot description was made from.",
        )  # fmt: skip
    links = {link.get("name"): link for link in serial.root.iter("link")}
    elements = {element.get("name"): element for element in serial.root.findall("joint")}
    for k, ((joint, _), own) in enumerate(zip(serial.chain, robot.joints, strict=True)):
        body = body_of(own.parameters).seen_from(inverse(serial.inside(k)))
        for name in (joint.child, *serial.behind(k)):
            for inertial in links[name].findall("inertial"):
                links[name].remove(inertial)
        _put_body(links[joint.child], body, f"link {k + 1} of robot '{robot.name}'")
        _put_friction(elements[joint.name], own)
    ET.indent(serial.root)
    return ET.ElementTree(serial.root)


def joint_names(robot: RobotDescription) -> list[str]:
    """The names of the joints, unique; ``joint1`` and so on where they have none."""
    names = [joint.name for joint in robot.joints]
    unique = all(names) and len(set(names)) == len(names)
    return names if unique else [f"joint{j}" for j in range(1, len(names) + 1)]


def pose_of(joint: Joint) -> Array:
    """(4, 4) of the frame of a joint at zero in that of the link before it."""
    pose = joint.before
    pose[:3, 3] += joint.d * pose[:3, 2]
    pose[:3, :3] = pose[:3, :3] @ turn(2, joint.theta)
    return pose


def not_in_urdf(robot: RobotDescription) -> list[str]:
    """Parameters of a robot, by name with the joint number and their unit, that a URDF has no place for."""
    return [
        *not_held(robot, (DAMPING, FRICTION)),
        *(
            [f"a gravity of {np.linalg.norm(robot.gravity):.6g} m/s2, which the simulator sets"]
            if not math.isclose(float(np.linalg.norm(robot.gravity)), -GRAVITY[2], rel_tol=1e-3) else []
        ),
    ]  # fmt: skip


def not_held(robot: RobotDescription, held: Sequence[str]) -> list[str]:
    """Parameters of effects, by name with the joint number and their unit, whose names are none of these; and what is
    known of the motors."""
    found = []
    for j, joint in enumerate(robot.joints, start=1):
        for effect in joint.all_effects():
            for v in (*effect.parameters(joint.type), *effect.shapes(joint.type)):
                value = joint.parameters.get(v.name, v.start)
                stands = v.name in held or (v.name == "v0" and set(held) & set(joint.parameters))
                if not stands and value != effect.neutral.get(v.name, 0.0):
                    found.append(f"{v.name}{j} = {value:.6g} {v.unit} ({effect.title[:1].lower()}{effect.title[1:]})")
    motors = {j: joint.motor for j, joint in enumerate(robot.joints, start=1) if joint.motor is not None}
    return [*dict.fromkeys(found), *(f"the motor of joint {j} ({motor.stated()})" for j, motor in motors.items())]


def _upright(gravity: Sequence[float]) -> Array:
    """(4, 4) of the frame of the base of a robot in that of a root whose z axis points upwards."""
    down, pose = np.array(gravity), np.eye(4)
    length = float(np.linalg.norm(down))
    if length:
        # The rotation R with the least angle and R down = (0, 0, -length); Rodrigues' formula.
        v, target = down / length, np.array(GRAVITY) / -GRAVITY[2]
        cross, cosine = np.cross(v, target), float(v @ target)
        skew = np.array([[0, -cross[2], cross[1]], [cross[2], 0, -cross[0]], [-cross[1], cross[0], 0]])
        pose[:3, :3] = turn(0, math.pi) if cosine < -1 + 1e-12 else np.eye(3) + skew + skew @ skew / (1 + cosine)
    return pose


def _joint(root: ET.Element, name: str, type_: str, parent: str, child: str, pose: Array) -> ET.Element:
    element = ET.SubElement(root, "joint", name=name, type=type_)
    ET.SubElement(element, "parent", link=parent)
    ET.SubElement(element, "child", link=child)
    ET.SubElement(element, "origin", xyz=text_of_pose(pose[:3, 3]), rpy=text_of_pose(_roll_pitch_yaw(pose[:3, :3])))
    return element


def text_of_pose(values: Iterable[float]) -> str:
    """Lengths and angles of an attribute, without what is left of products of rotations."""
    return text_of(*map(rounded, values))


def _roll_pitch_yaw(turned: Array) -> tuple[float, float, float]:
    """Angles about fixed axes of a rotation Rz(yaw) Ry(pitch) Rx(roll)."""
    sine = -float(turned[2, 0])
    level = math.hypot(turned[0, 0], turned[1, 0])
    if level < 1e-9:  # roll and yaw turn about one axis
        return math.atan2(-turned[1, 2], turned[1, 1]), math.atan2(sine, level), 0.0
    return math.atan2(turned[2, 1], turned[2, 2]), math.atan2(sine, level), math.atan2(turned[1, 0], turned[0, 0])


def _put_body(link: ET.Element, body: Body, where: str) -> None:
    if not body.mass > 0:
        raise InputError(
            "A link has no mass, and what reads a URDF needs one.", where=where, got=f"M = {body.mass:g} kg",
            next_step="Write the values of a result (--result), which become those of links that exist.",
        )  # fmt: skip
    body, inertial = body.without_rounding, ET.Element("inertial")
    ET.SubElement(inertial, "origin", xyz=text_of(*body.centre), rpy="0 0 0")
    ET.SubElement(inertial, "mass", value=text_of(body.mass))
    tensor = body.at_centre
    entries = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    ET.SubElement(inertial, "inertia", {key: text_of(tensor[place]) for key, place in entries.items()})
    link.insert(0, inertial)


def _put_friction(element: ET.Element, joint: Joint) -> None:
    values = {
        key: text_of(joint.parameters[name])
        for key, name in (("damping", DAMPING), ("friction", FRICTION)) if name in joint.parameters
    }  # fmt: skip
    if values:
        for old in element.findall("dynamics"):
            element.remove(old)
        ET.SubElement(element, "dynamics", values)
