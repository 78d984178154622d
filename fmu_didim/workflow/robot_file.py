"""What a robot description says, in tables and a picture: frames, masses, reach, base parameters."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from scipy.optimize import minimize

from fmu_didim.base.errors import InputError
from fmu_didim.data.signals import Array
from fmu_didim.dynamics.base_parameters import base_parameters
from fmu_didim.dynamics.robot import RobotDescription, RobotModel, write_robot
from fmu_didim.dynamics.robot.description import looks_standard
from fmu_didim.dynamics.robot.ellipsoid import ellipsoid_of
from fmu_didim.dynamics.robot.formats.write_urdf import pose_of
from fmu_didim.report.drawing.skeleton import joint_points
from fmu_didim.report.sections import Column, Table
from fmu_didim.report.terminal import listing, table_lines, wrapped

POSTURES = 4096
"""[postures] From the farthest of which the reach is improved."""
ROUNDING = 1e-12
"""[m, kg.m2] Below which a centre of mass or an inertia is shown as zero."""
WITHOUT_LIMITS = {"revolute": (-math.pi, math.pi), "prismatic": (-0.5, 0.5)}
"""[rad, m] Range of a joint on the page whose limits are not known."""


def write_as_yaml(robot: RobotDescription, path: Path) -> None:
    """Write it as YAML; raises InputError where the file is there already."""
    _refuse_if_there(path)
    write_robot(robot, path)


def _refuse_if_there(path: Path) -> None:
    if path.exists():
        raise InputError("The file is there already.", where=str(path), next_step="Give another name, or remove it.")


def robot_lines(robot: RobotDescription) -> list[str]:
    """Frames in modified Denavit-Hartenberg convention, masses with their centres, reach, base parameters and ripples
    of the motors that are stated, for the terminal."""
    base = base_parameters(RobotModel(robot))
    head, *more = _heads(robot)
    return [
        *wrapped(f"{robot.name}: {head}"), *(line for text in more for line in wrapped(text)), "",
        *table_lines(_frames(robot)), "",
        *table_lines(_places(robot)), "",
        *table_lines(_masses(robot)), "",
        *wrapped(f"{base.count} base parameters: {', '.join(base.names)}", hanging="  "),
        *listing("Regrouping", base.relations()), *listing("Motors", _motors(robot)),
    ]  # fmt: skip


def write_picture(robot: RobotDescription, path: Path) -> Path:
    """Write a page with the robot drawn: skeleton, axes and ellipsoids of its links, and its tables; raises InputError
    where the file is there already, or is no page."""
    from fmu_didim.report.robot_page import RobotPage, write_robot_page

    if path.suffix.lower() not in (".html", ".htm"):
        raise InputError(
            "The picture is written as a page.", where=str(path), valid="a name that ends in .html",
            next_step="Give such a name.",
        )  # fmt: skip
    _refuse_if_there(path)
    base, joints, remarks = base_parameters(RobotModel(robot)), [], []
    for number, joint in enumerate(robot.joints, start=1):
        found = ellipsoid_of(joint.parameters)
        drawn = None
        if isinstance(found, str):
            remarks.append(f"Link {number} is drawn without an ellipsoid: {found}.")
        else:
            drawn = {key: getattr(found, key).tolist() for key in ("centre", "axes", "radii")}
        low, high = joint.limits or WITHOUT_LIMITS[joint.type]
        joints.append(
            {
                "name": joint.name, "type": joint.type, "alpha": joint.alpha, "a": joint.a, "theta": joint.theta,
                "d": joint.d, "beta": joint.beta, "low": low, "high": high, "limits": joint.limits is not None,
                "ellipsoid": drawn,
            }
        )  # fmt: skip
    made_of = dict(relation.split(" = ", 1) for relation in base.relations())
    tables = {
        "Frames": _frames(robot), "With all joints at zero": _places(robot), "Masses": _masses(robot),
        "Base parameters": Table([
            Column("name", base.names, is_text=True), Column("unit", base.units, is_text=True),
            Column("regrouping", [made_of.get(name, "") for name in base.names], is_text=True),
        ]),
    }  # fmt: skip
    return write_robot_page(RobotPage(robot.name, _heads(robot), robot.gravity, joints, tables, remarks), path)


def _heads(robot: RobotDescription) -> list[str]:
    gravity = ", ".join(f"{g:.4g}" for g in robot.gravity)
    heads = [f"{len(robot.joints)} joints, gravity ({gravity}) m/s2 in the frame of the base", _reach_text(robot)]
    return [*heads, _frames_text(robot)]


def _frames_text(robot: RobotDescription) -> str:
    """In which frames numbers and names of parameters are, and whether the table looks like one of the other ones."""
    if robot.original_frames == "standard":
        return (
            "Frames: read in the classical (standard) convention and brought to modified Denavit-Hartenberg; what "
            "follows, and all parameters by name (MX2, ZZ3), are in modified frames, not in those of the file"
        )
    text = "Frames: modified Denavit-Hartenberg (Khalil and Kleinfinger), alpha and a before the axis of their joint"
    if looks_standard(robot):
        text += (
            ". The first row has alpha or a and the last one has none, as in tables of the classical convention: if "
            "this is one, write frames: standard"
        )
    return text


def _motors(robot: RobotDescription) -> list[str]:
    """Where the ripples of the motors that are stated lie."""
    shared = robot.coupled_joints()
    return [
        f"joint {j} shares its motors with a neighbour: motor: is not used" if j - 1 in shared
        else f"joint {j}, ripples at {', '.join(f'{h.frequency:g} ({h.name})' for h in joint.motor.ripples())}"
        for j, joint in enumerate(robot.joints, start=1) if joint.motor is not None
    ]  # fmt: skip


def _reach_text(robot: RobotDescription) -> str:
    free = [j for j, joint in enumerate(robot.joints, start=1) if joint.type == "prismatic" and joint.limits is None]
    if free:
        return f"Reach: not known, joint {free[0]} slides without limits"
    return f"Reach: {reach(robot):.4g} m from the first frame to the last one, without a tool"


def reach(robot: RobotDescription, *, seed: int = 0) -> float:
    """Largest distance in m of the origin of the last frame from that of the first one, over all positions of the
    joints: the farthest of many that are drawn, improved by coordinate steps."""
    ends = np.array([joint.limits or WITHOUT_LIMITS[joint.type] for joint in robot.joints])

    def distance(q: Array) -> Array:
        points = joint_points(robot.joints, q)
        return np.asarray(np.linalg.norm(points[:, -2] - points[:, 1], axis=1))

    drawn = np.random.default_rng(seed).uniform(ends[:, 0], ends[:, 1], (POSTURES, len(ends)))
    best = drawn[int(np.argmax(distance(drawn)))]
    found = minimize(
        lambda q: -float(distance(q[None])[0]), best, method="L-BFGS-B", bounds=ends, options={"ftol": 1e-12}
    )
    return -float(found.fun)


def _frames(robot: RobotDescription) -> Table:
    joints, has_beta = robot.joints, any(joint.beta for joint in robot.joints)
    return Table([
        Column("joint", [str(j) for j in range(1, len(joints) + 1)]),
        Column("type", [joint.type for joint in joints], is_text=True),
        Column("alpha [deg]", [f"{math.degrees(joint.alpha):.6g}" for joint in joints]),
        *([Column("beta [deg]", [f"{math.degrees(joint.beta):.6g}" for joint in joints])] if has_beta else []),
        Column("a [m]", [f"{joint.a:.6g}" for joint in joints]),
        Column("theta [deg]", [f"{math.degrees(joint.theta):.6g}" for joint in joints]),
        Column("d [m]", [f"{joint.d:.6g}" for joint in joints]),
        Column("limits", [_limits(joint.limits) for joint in joints], is_text=True),
        Column("name", [joint.name for joint in joints], is_text=True),
    ])  # fmt: skip


def _places(robot: RobotDescription) -> Table:
    """Where the axes of the joints are with all joints at zero, which a wrong convention shows."""
    poses = [np.eye(4)]
    for joint in robot.joints:
        poses.append(poses[-1] @ pose_of(joint))
    return Table([
        Column("frame at zero", [str(j) for j in range(1, len(poses))]),
        Column("origin [m], in frame 0", [_shown_vector(pose[:3, 3]) for pose in poses[1:]], is_text=True),
        Column("axis of its joint (z)", [_shown_vector(pose[:3, 2]) for pose in poses[1:]], is_text=True),
        Column("x", [_shown_vector(pose[:3, 0]) for pose in poses[1:]], is_text=True),
    ])  # fmt: skip


def _limits(limits: tuple[float, float] | None) -> str:
    return "" if limits is None else f"{limits[0]:.4g} to {limits[1]:.4g}"


def _masses(robot: RobotDescription) -> Table:
    own = [joint.parameters for joint in robot.joints]
    masses = [values.get("M", 0.0) for values in own]
    centres = [
        _shown_vector([values.get(name, 0.0) / mass for name in ("MX", "MY", "MZ")]) if mass > 0 else "not given"
        for values, mass in zip(own, masses, strict=True)
    ]
    inertias = [_shown_vector([values.get(name, 0.0) for name in ("XX", "YY", "ZZ")]) for values in own]
    return Table([
        Column("link", [str(j) for j in range(1, len(own) + 1)]),
        Column("mass [kg]", [f"{mass:.6g}" for mass in masses]),
        Column("centre of mass [m]", centres, is_text=True),
        Column("XX, YY, ZZ at the frame [kg.m2]", inertias, is_text=True),
    ])  # fmt: skip


def _shown_vector(values: Iterable[float]) -> str:
    return ", ".join(_shown(float(value)) for value in values)


def _shown(value: float) -> str:
    """With four digits; what the conversion of a file leaves of a zero is one."""
    return f"{value if abs(value) > ROUNDING else 0.0:.4g}"
