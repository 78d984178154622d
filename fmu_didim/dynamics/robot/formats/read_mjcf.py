"""MJCF, the format of MuJoCo, read: what MuJoCo makes of a file, brought to modified Denavit-Hartenberg frames.

MuJoCo's own compiler knows defaults, classes, included files, and the inertia of bodies that only have a shape. Of its
model are taken the tree of bodies with their inertias, hinges and slides, ``armature`` as the inertia of the motor,
``damping`` as viscous and ``frictionloss`` as Coulomb friction, ranges, and gravity. A body with several joints is a
chain of links, of which the last one has its mass. Source: the XML reference of MuJoCo.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np

from fmu_didim.base.errors import InputError, loading
from fmu_didim.base.files import is_file
from fmu_didim.data.signals import Array
from fmu_didim.dynamics.robot.body import Body, inverse
from fmu_didim.dynamics.robot.description import RobotDescription
from fmu_didim.dynamics.robot.formats.urdf import CUT, UrdfJoint, described, serial_of

SUFFIX = ".xml"
TYPES = {0: "floating", 1: "ball", 2: "prismatic", 3: "revolute"}
"""mjtJoint -> type of a joint; of the first two no serial robot has one."""
WORLD = "world"
COUPLINGS = {0: "connects two bodies", 1: "welds two bodies", 2: "couples joints", 3: "couples tendons"}
"""mjtEq -> what a constraint does, in words."""


def read_mjcf(path: Path | str, *, tip: str = "") -> RobotDescription:
    """The description of the serial robot of an MJCF file, its values those of the file.

    Args:
        tip: the body at which the robot ends, where it has branches; joints that do not lead there do not move, and
            what they carry belongs to the body that carries them.

    Raises:
        InputError: MuJoCo is not installed or does not take the file, or its robot has branches, a loop, or joints
            that are coupled, have springs, float, or do not begin at zero.
    """
    path = Path(path)
    model = _compiled(path)
    bodies, joints = {WORLD: Body()}, list[UrdfJoint]()
    for body in range(1, model.nbody):
        _add(model, body, bodies, joints)
    serial = serial_of(bodies, joints, tip, path, ET.Element("mujoco"))
    _check(model, [joint.name for joint, _ in serial.chain], path)
    return described(serial, _name(model) or path.stem, path, model.opt.gravity)


def _compiled(path: Path) -> Any:
    """MuJoCo's model of the file."""
    absent = InputError(
        "A robot in MJCF is read by MuJoCo, which is not installed.", where=str(path),
        next_step="pip install fmu_didim[mjcf], or give the robot as a URDF.",
    )  # fmt: skip
    with loading("mujoco", absent=absent):
        import mujoco
    if not is_file(path):
        raise InputError("The file does not exist.", where=str(path), next_step="Check the path.")
    try:
        return mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise InputError(
            "MuJoCo does not take the file.", where=str(path), got=str(error).strip(),
            next_step="Correct it; meshes that it names must lie where it says.",
        ) from error  # fmt: skip


def _name(model: Any) -> str:
    """Of the model, which MuJoCo keeps before all other names."""
    return bytes(model.names).split(b"\0", 1)[0].decode("utf-8", "replace")


def _body_name(model: Any, body: int) -> str:
    return (model.body(body).name or f"body{body}") if body else WORLD


def _joint_name(model: Any, joint: int) -> str:
    return model.joint(joint).name or f"joint{joint}"


def _add(model: Any, body: int, bodies: dict[str, Body], joints: list[UrdfJoint]) -> None:
    """The links and joints of one body."""
    name, before = (_body_name(model, i) for i in (body, int(model.body_parentid[body])))
    pose = _pose(model.body_pos[body], model.body_quat[body])
    for joint in range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body]):
        anchor = _pose(model.jnt_pos[joint], np.array([1.0, 0, 0, 0]))
        link = f"{name}: {_joint_name(model, joint)}"
        joints.append(_joint(model, joint, before, link, pose @ anchor))
        bodies[link], before, pose = Body(), link, inverse(anchor)
    joints.append(UrdfJoint(f"fixed {name}", "fixed", before, name, pose, np.array([0.0, 0, 1]), None, {}))
    at_centre = Body(float(model.body_mass[body]), np.zeros(3), np.diag(model.body_inertia[body]))
    bodies[name] = at_centre.seen_from(inverse(_pose(model.body_ipos[body], model.body_iquat[body])))


def _joint(model: Any, joint: int, before: str, link: str, pose: Array) -> UrdfJoint:
    at = int(model.jnt_dofadr[joint])
    held = {"Ia": model.dof_armature, "Fv": model.dof_damping, "Fc": model.dof_frictionloss}
    values = {name: float(np.ravel(table[at])[0]) for name, table in held.items()}
    limits = (float(model.jnt_range[joint][0]), float(model.jnt_range[joint][1]))
    return UrdfJoint(
        _joint_name(model, joint), TYPES[int(model.jnt_type[joint])], before, link, pose,
        np.array(model.jnt_axis[joint]), limits if model.jnt_limited[joint] and limits[0] < limits[1] else None,
        {name: value for name, value in values.items() if value},
    )  # fmt: skip


def _check(model: Any, names: list[str], path: Path) -> None:
    """Raise InputError for what joints of the chain have and no description that is read holds."""
    for joint, what in _unheld(model):
        name = _joint_name(model, joint)
        if name in names:
            raise InputError(
                f"A joint {what}, which is not read from MJCF.", where=f"{path}: joint {name}",
                next_step=f"{CUT}, or take it out of the file and state it in the description that is written.",
            )  # fmt: skip


def _unheld(model: Any) -> Iterator[tuple[int, str]]:
    """Joints and what they have."""
    for joint in range(model.njnt):
        moves = int(model.jnt_type[joint]) in (2, 3)
        if float(np.ravel(model.jnt_stiffness[joint])[0]):
            yield joint, "has a spring"
        if moves and model.qpos0[model.jnt_qposadr[joint]]:
            yield joint, f"begins at {model.qpos0[model.jnt_qposadr[joint]]:g} (ref)"
    for k in range(model.neq):
        kind = int(model.eq_type[k])
        if not model.eq_active0[k] or kind not in COUPLINGS:
            continue
        for one in (int(model.eq_obj1id[k]), int(model.eq_obj2id[k])):
            if kind == 2 and one >= 0:
                yield one, f"is in a constraint that {COUPLINGS[kind]}"
            if kind in (0, 1) and one > 0:
                joints = range(model.body_jntadr[one], model.body_jntadr[one] + model.body_jntnum[one])
                yield from ((joint, f"moves a body of a constraint that {COUPLINGS[kind]}") for joint in joints)


def _pose(position: Array, quaternion: Array) -> Array:
    """(4, 4) of a frame at a position (3,), turned by a unit quaternion (4,) w, x, y, z."""
    w, x, y, z = np.asarray(quaternion, dtype=float) / np.linalg.norm(quaternion)
    result = np.eye(4)
    result[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    result[:3, 3] = position
    return result
