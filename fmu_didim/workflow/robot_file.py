"""What a robot description says, in tables: frames, masses, base parameters."""

from __future__ import annotations

import math
from pathlib import Path

from fmu_didim.base.errors import InputError
from fmu_didim.dynamics.base_parameters import base_parameters
from fmu_didim.dynamics.robot import RobotDescription, RobotModel, read_robot, write_robot
from fmu_didim.dynamics.robot.formats.urdf import SUFFIX, read_urdf
from fmu_didim.report.sections import Column, Table
from fmu_didim.report.terminal import listing, table_lines, wrapped


def robot_of(path: Path, tip: str = "") -> RobotDescription:
    """The robot of a YAML or URDF file.

    Args:
        tip: the link at which it ends, for a URDF with branches.

    Raises:
        InputError: the file is none of both, or has no such link.
    """
    if not tip:
        return read_robot(path)
    if path.suffix.lower() != SUFFIX:
        raise InputError(
            "Only a URDF has links where a robot may end.", where=str(path), got=f"--tip {tip}",
            next_step="Leave --tip out.",
        )  # fmt: skip
    return read_urdf(path, tip=tip)


def write_as_yaml(robot: RobotDescription, path: Path) -> None:
    """Write it as YAML; raises InputError where the file is there already."""
    if path.exists():
        raise InputError("The file is there already.", where=str(path), next_step="Give another name, or remove it.")
    write_robot(robot, path)


def robot_lines(robot: RobotDescription) -> list[str]:
    """Frames in modified Denavit-Hartenberg convention, masses with their centres, and base parameters, for the
    terminal."""
    base = base_parameters(RobotModel(robot))
    gravity = ", ".join(f"{g:.4g}" for g in robot.gravity)
    head = f"{robot.name}: {len(robot.joints)} joints, gravity ({gravity}) m/s2 in the frame of the base"
    relations = base.relations()
    return [
        *wrapped(head), "",
        *table_lines(_frames(robot)), "",
        *table_lines(_masses(robot)), "",
        *wrapped(f"{base.count} base parameters: {', '.join(base.names)}", hanging="  "),
        *listing("Regrouping", relations),
    ]  # fmt: skip


def _frames(robot: RobotDescription) -> Table:
    joints = robot.joints
    return Table([
        Column("joint", [str(j) for j in range(1, len(joints) + 1)]),
        Column("type", [joint.type for joint in joints], is_text=True),
        Column("alpha [deg]", [f"{math.degrees(joint.alpha):.6g}" for joint in joints]),
        Column("a [m]", [f"{joint.a:.6g}" for joint in joints]),
        Column("theta [deg]", [f"{math.degrees(joint.theta):.6g}" for joint in joints]),
        Column("d [m]", [f"{joint.d:.6g}" for joint in joints]),
        Column("limits", [_limits(joint.limits) for joint in joints], is_text=True),
        Column("name", [joint.name for joint in joints], is_text=True),
    ])  # fmt: skip


def _limits(limits: tuple[float, float] | None) -> str:
    return "" if limits is None else f"{limits[0]:.4g} to {limits[1]:.4g}"


def _masses(robot: RobotDescription) -> Table:
    own = [joint.parameters for joint in robot.joints]
    masses = [values.get("M", 0.0) for values in own]
    centres = [
        ", ".join(f"{values.get(name, 0.0) / mass:.4g}" for name in ("MX", "MY", "MZ")) if mass > 0 else "not given"
        for values, mass in zip(own, masses, strict=True)
    ]
    inertias = [", ".join(f"{values.get(name, 0.0):.4g}" for name in ("XX", "YY", "ZZ")) for values in own]
    return Table([
        Column("link", [str(j) for j in range(1, len(own) + 1)]),
        Column("mass [kg]", [f"{mass:.6g}" for mass in masses]),
        Column("centre of mass [m]", centres, is_text=True),
        Column("XX, YY, ZZ at the frame [kg.m2]", inertias, is_text=True),
    ])  # fmt: skip
