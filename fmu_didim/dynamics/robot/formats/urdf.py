"""URDF: links and joints of any pose, brought to modified Denavit-Hartenberg frames.

With all joints at zero, joint j has an axis through p_j along z_j in the frame of the root. Frame j lies on link j:
z_j is the axis of joint j, x_j the common normal from z_j to z_j+1, and the origin its foot on z_j; the frame of the
base is that of link 1 at zero. Then

    alpha_j = angle from z_j-1 to z_j about x_j-1       a_j = distance of both along x_j-1
    theta_j = angle from x_j-1 to x_j about z_j         d_j = distance of the feet of both normals along z_j

Axes that are parallel but for the errors that a calibration finds have their common normal metres or kilometres away:
there x_j points across z_j, from where the joint is, to z_j+1, and beta_j+1 is the angle about the y axis that is left
(S. Hayati, M. Mirmirani, "Improving the absolute positioning accuracy of robot manipulators", 1985). Links behind fixed
joints belong to the link before them; what the root carries does not move. Sources: W. Khalil, J. Kleinfinger, "A new
geometric notation for open and closed-loop robots", ICRA 1986; the URDF specification of ROS.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from fmu_didim.base.errors import InputError
from fmu_didim.data.signals import Array
from fmu_didim.dynamics.robot.body import Body, inverse, parameters_of, right_angle, rounded, turn
from fmu_didim.dynamics.robot.description import Joint, RobotDescription

SUFFIX = ".urdf"
MAXIMUM_BYTES = 16 * 2**20
"""[bytes] Of a file that is read: a description with names of meshes has some hundred thousand."""
GRAVITY = (0.0, 0.0, -9.81)
"""[m/s2] In the frame of the root, whose z axis points upwards by the convention of ROS (REP 103)."""
PARALLEL = 0.02
"""[1] Sine of the angle of two axes below which they are parallel but for errors: calibrations find some 1e-3, and no
arm has axes that are meant to stand at one degree."""
SAME_AXIS = 1e-9
"""[m] Distance of two parallel axes below which they are one."""
CUT = "End the robot before it (fmu-didim robot FILE --tip LINK --out robot.yaml)"
MOVING = {"revolute": "revolute", "continuous": "revolute", "prismatic": "prismatic"}
"""Types of joints of URDF that move -> those of a description."""


@dataclass(frozen=True)
class UrdfJoint:
    """A joint of the file; pose (4, 4) of its frame in that of its parent link, axis (3,) there."""

    name: str
    type: str
    parent: str
    child: str
    pose: Array
    axis: Array
    limits: tuple[float, float] | None
    friction: Mapping[str, float]
    mimics: str = ""


@dataclass(frozen=True)
class SerialRobot:
    """The joints of a file that move, from the root to the tip.

    Attributes:
        root: the element of the robot; joints: all of the file.
        chain: those that move, with the pose (4, 4) of each in the frame of the root.
        frames: (4, 4) of each link there, in modified Denavit-Hartenberg convention.
        carried: joint -> what it carries up to the next one, in the frame of its child link.
    """

    root: ET.Element
    joints: tuple[UrdfJoint, ...]
    chain: list[tuple[UrdfJoint, Array]]
    frames: list[Array]
    carried: dict[str, Body]

    def inside(self, k: int) -> Array:
        """(4, 4) frame of link k, from 0, in that of its joint and child link."""
        return inverse(self.chain[k][1]) @ self.frames[k]

    def behind(self, k: int) -> list[str]:
        """The links that hang on the child link of joint k, from 0, without a joint that moves between."""
        moving, found = {joint.name for joint, _ in self.chain}, list[str]()
        new = [self.chain[k][0].child]
        while new:
            link = new.pop()
            children = [j.child for j in self.joints if j.parent == link and j.name not in moving]
            found += children
            new += children
        return found


def serial_robot(path: Path | str, tip: str = "") -> SerialRobot:
    """What :func:`read_urdf` reads, as the file has it; with the same errors."""
    path = Path(path)
    root = _root(path)
    bodies = {_name(link, path, "link"): _body(link, path) for link in root.iter("link")}
    joints = [_joint(element, path) for element in root.findall("joint")]
    return serial_of(bodies, joints, tip, path, root)


def serial_of(
    bodies: Mapping[str, Body], joints: Sequence[UrdfJoint], tip: str, path: Path, root: ET.Element
) -> SerialRobot:
    """The serial robot of links, each with what it weighs in its own frame, and joints; errors as of
    :func:`read_urdf`."""
    chain, carried = _chain(bodies, joints, tip, path)
    if not chain:
        raise InputError(
            "No joint that moves leads to this link.", where=str(path), got=tip,
            valid=", ".join(joint.child for joint in joints if joint.type in MOVING), next_step="Take another tip.",
        )  # fmt: skip
    frames = _frames([pose for _, pose in chain], [joint.axis for joint, _ in chain])
    return SerialRobot(root, tuple(joints), chain, frames, carried)


def read_urdf(path: Path | str, *, tip: str = "") -> RobotDescription:
    """The description of the serial robot of a URDF file, its values those of the file.

    Args:
        tip: the link at which the robot ends, where it has branches; joints that do not lead there do not move, and
            what they carry belongs to the link that carries them.

    Raises:
        InputError: the file is no URDF, or its robot has branches, a loop, or joints that mimic others, float or slide
            in a plane.
    """
    serial = serial_robot(path, tip)
    return described(serial, serial.root.get("name") or Path(path).stem, Path(path), GRAVITY)


def described(serial: SerialRobot, name: str, path: Path, gravity: Sequence[float]) -> RobotDescription:
    """The description of a serial robot that was read from a file, with gravity (3,) in m/s2 in the frame of its
    root."""
    chain, frames = serial.chain, serial.frames
    base = frames[0]
    joints = []
    for k, (joint, _) in enumerate(chain):
        before = base if k == 0 else frames[k - 1]
        inside = serial.inside(k)
        joints.append(
            Joint(
                name=joint.name, type=MOVING[joint.type], limits=joint.limits,  # type: ignore[arg-type]
                parameters={**parameters_of(serial.carried[joint.name].seen_from(inside)), **joint.friction},
                **_denavit_hartenberg(before, frames[k]),
            )
        )  # fmt: skip
    turned = base[:3, :3].T @ np.array(gravity)
    return RobotDescription(
        name=_identifier(name), description=f"From {path.name}", source=path.name,
        gravity=tuple(rounded(float(g)) for g in turned), joints=tuple(joints),  # type: ignore[arg-type]
    )  # fmt: skip


def _root(path: Path) -> ET.Element:
    """The element of the robot; a document type, the way to bombs of entities, is refused unread."""
    try:
        if path.stat().st_size > MAXIMUM_BYTES:
            raise InputError(
                "The file is too large for a robot description.", where=str(path), got=f"{path.stat().st_size} bytes",
                valid=f"up to {MAXIMUM_BYTES}", next_step="Give the URDF file alone; meshes are not read.",
            )  # fmt: skip
        content = path.read_bytes()
    except OSError as error:
        raise InputError(
            "The file cannot be read.", where=str(path), got=str(error.strerror or error),
            next_step="Check the path and the rights of the file.",
        ) from error  # fmt: skip
    if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
        raise InputError(
            "The file has a document type, which is not read.", where=str(path),
            next_step="Take the <!DOCTYPE ...> out.",
        )  # fmt: skip
    try:
        root = ET.fromstring(content, ET.XMLParser(target=ET.TreeBuilder(insert_comments=True)))
    except ET.ParseError as error:
        raise InputError(
            "The file is no XML.", where=str(path), got=str(error),
            next_step="Expand xacro files first: ros2 run xacro xacro robot.urdf.xacro > robot.urdf.",
        ) from error  # fmt: skip
    if root.tag != "robot" or any("xacro" in str(element.tag) for element in root.iter()):
        raise InputError(
            "The file is no URDF.", where=str(path), got=f"<{root.tag}>" if root.tag != "robot" else "xacro macros",
            valid="<robot> with links and joints",
            next_step="Expand xacro files first: ros2 run xacro xacro robot.urdf.xacro > robot.urdf.",
        )  # fmt: skip
    return root


def _name(element: ET.Element, path: Path, what: str) -> str:
    name = element.get("name")
    if not name:
        raise InputError(f"A {what} has no name.", where=str(path), next_step=f"Give each {what} a name.")
    return name


def numbers_of(element: ET.Element | None, key: str, default: Sequence[float], where: str) -> list[float]:
    """Numbers of an attribute, as many as the default has."""
    text = None if element is None else element.get(key)
    if text is None:
        return list(default)
    try:
        values = [float(part) for part in text.split()]
    except ValueError:
        values = []
    if len(values) != len(default) or not all(math.isfinite(value) for value in values):
        raise InputError(
            f"The entry '{key}' is not {len(default)} finite number{'s' if len(default) > 1 else ''}.", where=where,
            got=text, next_step="Correct it in the file.",
        )  # fmt: skip
    return values


def _number(element: ET.Element, key: str, where: str) -> float:
    return numbers_of(element, key, [0.0], where)[0]


def pose_of(element: ET.Element | None, where: str) -> Array:
    """(4, 4) of an ``origin``: fixed axes roll, pitch, yaw, then the shift. 1.5708 is read as pi/2."""
    pose = np.eye(4)
    pose[:3, 3] = numbers_of(element, "xyz", [0.0] * 3, where)
    roll, pitch, yaw = map(right_angle, numbers_of(element, "rpy", [0.0] * 3, where))
    pose[:3, :3] = turn(2, yaw) @ turn(1, pitch) @ turn(0, roll)
    return pose


def _body(link: ET.Element, path: Path) -> Body:
    """What a link weighs, in its own frame; nothing where the file does not say it."""
    inertial, where = link.find("inertial"), f"{path}: link {link.get('name')}"
    if inertial is None:
        return Body()
    mass, inertia = inertial.find("mass"), inertial.find("inertia")
    m = 0.0 if mass is None else _number(mass, "value", where)
    if m < 0:
        raise InputError("The mass of a link is negative.", where=where, got=m, next_step="Correct it in the file.")
    tensor = np.zeros((3, 3))
    if inertia is not None:
        for i, j, key in ((0, 0, "ixx"), (0, 1, "ixy"), (0, 2, "ixz"), (1, 1, "iyy"), (1, 2, "iyz"), (2, 2, "izz")):
            tensor[i, j] = tensor[j, i] = _number(inertia, key, where)
    at_centre = Body(m, np.zeros(3), tensor)
    return at_centre.seen_from(inverse(pose_of(inertial.find("origin"), where)))


def _joint(element: ET.Element, path: Path) -> UrdfJoint:
    name = _name(element, path, "joint")
    where, ends = f"{path}: joint {name}", {}
    for end in ("parent", "child"):
        found = element.find(end)
        ends[end] = "" if found is None else found.get("link", "")
        if not ends[end]:
            raise InputError(f"The joint has no {end} link.", where=where, next_step=f"Name its {end}: link.")
    type_, axis = element.get("type", ""), np.array(numbers_of(element.find("axis"), "xyz", [1.0, 0.0, 0.0], where))
    length = float(np.linalg.norm(axis))
    if type_ in MOVING and not length > 0:
        raise InputError("The axis has no direction.", where=where, got="0 0 0", next_step="Give <axis xyz='0 0 1'/>.")
    mimic, dynamics = element.find("mimic"), element.find("dynamics")
    friction = {
        parameter: _number(dynamics, key, where)
        for parameter, key in (("Fv", "damping"), ("Fc", "friction"))
        if dynamics is not None and dynamics.get(key) is not None
    }
    return UrdfJoint(
        name, type_, ends["parent"], ends["child"], pose_of(element.find("origin"), where),
        axis / (length or 1.0), _limits(element, where), friction,
        "" if mimic is None else mimic.get("joint", "another joint"),
    )  # fmt: skip


def _limits(element: ET.Element, where: str) -> tuple[float, float] | None:
    limit = element.find("limit")
    if limit is None or element.get("type") == "continuous":
        return None
    low, high = _number(limit, "lower", where), _number(limit, "upper", where)
    return (low, high) if low < high else None


def _chain(
    bodies: Mapping[str, Body], joints: Sequence[UrdfJoint], tip: str, path: Path
) -> tuple[list[tuple[UrdfJoint, Array]], dict[str, Body]]:
    """The joints that move, from the root to the tip, with the pose (4, 4) of each in the frame of the root; and what
    each carries up to the next one, in its own frame."""
    into = _tree(bodies, joints, path)
    way = list(_way(into, tip or _only_tip(bodies, joints, path), bodies, path))[::-1]
    on_way = {joint.name for joint in way}
    _check_types([j for j in joints if not tip or j.name in on_way], path)
    chain, pose, carried = list[tuple[UrdfJoint, Array]](), np.eye(4), dict[str, Body]()
    for joint in way:
        pose = pose @ joint.pose
        if joint.type in MOVING:
            chain.append((joint, pose))
    moving = {joint.name for joint, _ in chain}
    for joint, _ in chain:
        carried[joint.name] = _carried(joint.child, bodies, joints, moving)
    return chain, carried


def _tree(bodies: Mapping[str, Body], joints: Sequence[UrdfJoint], path: Path) -> dict[str, UrdfJoint]:
    """Link -> the joint that leads to it."""
    into = dict[str, UrdfJoint]()
    for joint in joints:
        for link in (joint.parent, joint.child):
            if link not in bodies:
                raise InputError(
                    "A joint names a link that is not there.", where=f"{path}: joint {joint.name}", got=link,
                    valid=", ".join(bodies), next_step="Correct the name, or add the link.",
                )  # fmt: skip
        if joint.child in into:
            raise InputError(
                "Two joints lead to one link: the robot has a closed loop.", where=str(path),
                got=f"{into[joint.child].name} and {joint.name} to {joint.child}", valid="serial robots",
                next_step="Describe the loop by an equivalent serial robot.",
            )  # fmt: skip
        into[joint.child] = joint
    for link in bodies:
        list(_way(into, link, bodies, path))  # ends at a root
    return into


def _way(into: Mapping[str, UrdfJoint], link: str, bodies: Mapping[str, Body], path: Path) -> Iterator[UrdfJoint]:
    """The joints from a link back to the root."""
    if link not in bodies:
        raise InputError(
            "There is no link of the name of the tip.", where=str(path), got=link, valid=", ".join(bodies),
            next_step="Take the last link of the robot.",
        )  # fmt: skip
    seen = {link}
    while link in into:
        yield into[link]
        link = into[link].parent
        if link in seen:
            raise InputError(
                "The joints form a ring without a root.", where=str(path), got=link,
                next_step="Correct the parents and children of the joints.",
            )  # fmt: skip
        seen.add(link)


def _only_tip(bodies: Mapping[str, Body], joints: Sequence[UrdfJoint], path: Path) -> str:
    """The last link behind all joints that move; raises InputError where there are several, or none."""
    moving = [joint for joint in joints if joint.type != "fixed"]
    beyond = {joint.name: _behind(joint.child, joints) for joint in moving}
    last = [joint for joint in moving if not any(other.parent in beyond[joint.name] for other in moving)]
    if not last:
        raise InputError(
            "The robot of this file has no joint that moves.", where=str(path),
            got=", ".join(f"{joint.name} ({joint.type or 'no type'})" for joint in joints) or "no joints",
            valid=", ".join(MOVING), next_step="Give the file of the whole robot.",
        )  # fmt: skip
    if len(last) > 1:
        shared = [j for j in moving if all(end.parent in beyond[j.name] or end is j for end in last)]
        tip = last[0].child if not shared else min(shared, key=lambda joint: len(beyond[joint.name])).child
        raise InputError(
            "The robot has branches.", where=str(path), got=f"it ends in {', '.join(joint.child for joint in last)}",
            valid="a serial robot",
            next_step=f"Say where it ends, fmu-didim robot {path.name} --tip {tip} --out robot.yaml; joints that do "
            "not lead there do not move then.",
        )  # fmt: skip
    return last[0].child


def _behind(link: str, joints: Sequence[UrdfJoint]) -> set[str]:
    """A link and all that hang on it."""
    found, new = set[str](), [link]
    while new:
        found.add(link := new.pop())
        new += [joint.child for joint in joints if joint.parent == link and joint.child not in found]
    return found


def _check_types(joints: Sequence[UrdfJoint], path: Path) -> None:
    """Raise InputError for joints that no serial robot has."""
    for joint in joints:
        if joint.mimics and joint.type in MOVING:
            raise InputError(
                "A joint mimics another one.", where=f"{path}: joint {joint.name}", got=f"mimic {joint.mimics}",
                valid="joints with a drive of their own",
                next_step=f"{CUT}, or make the joint fixed.",
            )  # fmt: skip
        if joint.type not in (*MOVING, "fixed"):
            raise InputError(
                "This type of joint is not known.", where=f"{path}: joint {joint.name}", got=joint.type or "no type",
                valid=", ".join((*MOVING, "fixed")),
                next_step=f"{CUT}, or fix the base.",
            )  # fmt: skip


def _carried(link: str, bodies: Mapping[str, Body], joints: Sequence[UrdfJoint], moving: set[str]) -> Body:
    """What a link and all that hangs on it without one of the moving joints weigh, in its frame."""
    total = bodies[link]
    for joint in joints:
        if joint.parent == link and joint.name not in moving:
            behind = _carried(joint.child, bodies, joints, moving)
            total = total + behind.seen_from(inverse(joint.pose))
    return total


def _frames(poses: Sequence[Array], axes: Sequence[Array]) -> list[Array]:
    """(4, 4) frames of the links in that of the root, at zero."""
    z = [pose[:3, :3] @ axis for pose, axis in zip(poses, axes, strict=True)]
    p = [pose[:3, 3] for pose in poses]
    frames = list[Array]()
    for k in range(len(z)):
        spare = poses[k][:3, :3] if not frames else frames[-1][:3, :3]
        if k + 1 < len(z):
            x, origin = _normal(p[k], z[k], p[k + 1], z[k + 1], spare)
        else:
            x, origin = _across(z[k], spare), p[k]
        frame = np.eye(4)
        frame[:3, 0], frame[:3, 1], frame[:3, 2], frame[:3, 3] = x, np.cross(z[k], x), z[k], origin
        frames.append(frame)
    return frames


def _normal(p: Array, z: Array, q: Array, w: Array, spare: Array) -> tuple[Array, Array]:
    """Direction of the common normal of the axes (p, z) and (q, w), and its foot on the first.

    Of parallel axes, or nearly parallel ones, it is taken through p; of one axis and the other on it, along one of the
    columns of ``spare``.
    """
    cross, between = np.cross(z, w), q - p
    sine = float(np.linalg.norm(cross))
    if sine < PARALLEL:
        across = between - (between @ z) / (w @ z) * w  # to where the second axis meets the plane through p across z
        distance = float(np.linalg.norm(across))
        return (across / distance if distance > SAME_AXIS else _across(z, spare)), p
    x = cross / sine
    foot = p + float(np.cross(between, w) @ cross) / sine**2 * z
    return (x if between @ x >= 0 else -x), foot


def _across(z: Array, spare: Array) -> Array:
    """A unit vector across z: what is left of the column of ``spare`` that is least along it, the first that is."""
    left = [column - (column @ z) * z for column in spare.T]
    best = next(v for v in left if np.linalg.norm(v) > 0.5)
    return np.asarray(best / np.linalg.norm(best))


def _denavit_hartenberg(before: Array, frame: Array) -> dict[str, float]:
    """alpha, a, theta, d and beta from one frame to the next, whose axis crosses the x axis of the first."""
    step = inverse(before) @ frame
    across, along, rest = step[:3, 2]
    alpha, beta = math.atan2(-along, rest), math.asin(min(max(across, -1.0), 1.0))
    spin = (turn(0, alpha) @ turn(1, beta)).T @ step[:3, :3]
    d = float(step[1:3, 3] @ step[1:3, 2]) / (along**2 + rest**2)
    found = {"alpha": alpha, "a": step[0, 3] - d * across, "theta": math.atan2(spin[1, 0], spin[0, 0]), "d": d}
    return {name: rounded(value) for name, value in (found | {"beta": beta}).items()}


def _identifier(name: str) -> str:
    """The name of a robot as a legal C name."""
    found = re.sub(r"\W+", "_", name, flags=re.ASCII)
    return found if re.match(r"[A-Za-z_]", found) else f"robot_{found}"
