"""MJCF, the format of MuJoCo, written: a robot in the frames of its description.

Body j has the frame of link j at q = 0 in that of body j-1, and a joint about or along its z axis; ``armature`` is the
inertia of the motor, ``damping`` viscous and ``frictionloss`` Coulomb friction. Source: the XML reference of MuJoCo.
"""

from __future__ import annotations

import math
from xml.etree import ElementTree as ET

import numpy as np

from fmu_didim.base.errors import InputError
from fmu_didim.data.signals import Array
from fmu_didim.dynamics.robot.body import body_of, text_of
from fmu_didim.dynamics.robot.description import RobotDescription
from fmu_didim.dynamics.robot.formats.write_urdf import joint_names, not_held, pose_of, text_of_pose

HELD = {"armature": "Ia", "damping": "Fv", "frictionloss": "Fc"}
"""Attribute of a joint -> the parameter that it holds."""


def mjcf_of(robot: RobotDescription) -> ET.ElementTree[ET.Element]:
    """The file of a robot. Raises InputError where a link has no mass."""
    root = ET.Element("mujoco", model=robot.name)
    ET.SubElement(root, "compiler", angle="radian", autolimits="true")
    ET.SubElement(root, "option", gravity=text_of(*robot.gravity))
    parent = ET.SubElement(root, "worldbody")
    for j, (joint, name) in enumerate(zip(robot.joints, joint_names(robot), strict=True), start=1):
        pose, body = pose_of(joint), body_of(joint.parameters).without_rounding
        if not body.mass > 0:
            raise InputError(
                "A link has no mass, and MuJoCo needs one.", where=f"link {j} of robot '{robot.name}'",
                got=f"M = {body.mass:g} kg",
                next_step="Write the values of a result (--result), which become those of links that exist.",
            )  # fmt: skip
        stands = {"pos": text_of_pose(pose[:3, 3]), "quat": text_of_pose(_quaternion(pose[:3, :3]))}
        parent = ET.SubElement(parent, "body", {"name": f"link{j}", **stands})
        tensor = body.at_centre
        full = [tensor[i, k] for i, k in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
        ET.SubElement(
            parent, "inertial", pos=text_of(*body.centre), mass=text_of(body.mass), fullinertia=text_of(*full)
        )
        moves = ET.SubElement(
            parent, "joint", name=name, type="slide" if joint.type == "prismatic" else "hinge", axis="0 0 1"
        )
        for attribute, parameter in HELD.items():
            if joint.parameters.get(parameter):
                moves.set(attribute, text_of(joint.parameters[parameter]))
        if joint.limits is not None:
            moves.set("range", text_of(*joint.limits))
    ET.indent(root)
    return ET.ElementTree(root)


def not_in_mjcf(robot: RobotDescription) -> list[str]:
    """Parameters of a robot, by name with the joint number and their unit, that MJCF has no place for."""
    return not_held(robot, tuple(HELD.values()))


def _quaternion(turned: Array) -> tuple[float, float, float, float]:
    """(w, x, y, z) of a rotation matrix, by the largest of its four squares."""
    m = turned
    squares = np.array([
        1 + m[0, 0] + m[1, 1] + m[2, 2], 1 + m[0, 0] - m[1, 1] - m[2, 2],
        1 - m[0, 0] + m[1, 1] - m[2, 2], 1 - m[0, 0] - m[1, 1] + m[2, 2],
    ])  # fmt: skip
    k = int(np.argmax(squares))
    size = math.sqrt(squares[k])
    a, b, c = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
    d, e, f = m[1, 0] + m[0, 1], m[0, 2] + m[2, 0], m[2, 1] + m[1, 2]
    rows = [(size**2, a, b, c), (a, size**2, d, e), (b, d, size**2, f), (c, e, f, size**2)]
    w, x, y, z = (0.5 * value / size for value in rows[k])
    return w, x, y, z
