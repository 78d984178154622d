"""Recursive Newton-Euler inverse dynamics in CasADi.

Source: Khalil and Dombre, *Modeling, Identification and Control of Robots*, section 9.5, with the
inertia and the first moments taken about the origin of the link frame, so that the torque is linear
in all inertial parameters.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca
import numpy as np

from fmu_didim.effects import JointMotion
from fmu_didim.robot.description import RobotDescription


def inverse_dynamics(
    robot: RobotDescription,
    q: ca.SX,
    dq: ca.SX,
    ddq: ca.SX,
    parameters: Mapping[str, ca.SX],
    shapes: Mapping[str, ca.SX],
) -> ca.SX:
    """Joint torques tau = M(q) ddq + N(q, dq), shape (n,).

    Args:
        robot: geometry and effects.
        q, dq, ddq: (n,) joint positions, velocities, accelerations (rad or m, ...).
        parameters: standard parameters by name (``ZZ1``, ``Fv1``, ...).
        shapes: shape parameters by name (``v0_1``, ...).
    """
    rotations, offsets = _geometry(robot, q)
    axis = ca.SX([0.0, 0.0, 1.0])
    omega, domega = ca.SX(3, 1), ca.SX(3, 1)
    # Gravity enters as an acceleration of the base.
    acceleration = -ca.SX(robot.gravity)
    spread = ca.SX(3, 3)
    forces: list[ca.SX] = []
    moments: list[ca.SX] = []
    for j, joint in enumerate(robot.joints):
        back = rotations[j].T
        carried = back @ omega
        spin = axis * dq[j] if joint.type == "revolute" else ca.SX(3, 1)
        acceleration = back @ (acceleration + spread @ offsets[j])
        domega = back @ domega
        omega = carried + spin
        if joint.type == "revolute":
            domega = domega + axis * ddq[j] + ca.cross(carried, spin)
        else:
            acceleration = acceleration + axis * ddq[j] + 2 * ca.cross(carried, axis * dq[j])
        spread = ca.skew(domega) + ca.skew(omega) @ ca.skew(omega)
        inertia, first, mass = _inertial(parameters, j + 1)
        forces.append(mass * acceleration + spread @ first)
        moments.append(inertia @ domega + ca.cross(omega, inertia @ omega) + ca.cross(first, acceleration))
    return _balance(robot, rotations, offsets, forces, moments, _motions(q, dq, ddq), parameters, shapes)


def _motions(q: ca.SX, dq: ca.SX, ddq: ca.SX) -> list[JointMotion]:
    return [JointMotion(q[j], dq[j], ddq[j]) for j in range(q.numel())]


def _geometry(robot: RobotDescription, q: ca.SX) -> tuple[list[ca.SX], list[ca.SX]]:
    """Rotation of frame j in frame j-1, and position of its origin, for each joint."""
    rotations, offsets = [], []
    for j, joint in enumerate(robot.joints):
        theta = joint.theta + q[j] if joint.type == "revolute" else ca.SX(joint.theta)
        d = joint.d + q[j] if joint.type == "prismatic" else ca.SX(joint.d)
        ct, st = (_exact(ca.cos(theta)), _exact(ca.sin(theta)))
        ca_, sa = _exact(ca.SX(np.cos(joint.alpha))), _exact(ca.SX(np.sin(joint.alpha)))
        rotations.append(
            ca.vertcat(ca.horzcat(ct, -st, 0), ca.horzcat(ca_ * st, ca_ * ct, -sa), ca.horzcat(sa * st, sa * ct, ca_))
        )
        offsets.append(ca.vertcat(joint.a, -d * sa, d * ca_))
    return rotations, offsets


def _exact(value: ca.SX) -> ca.SX:
    """Constants within rounding of -1, 0 or 1 made exact, so that zero terms vanish from the code."""
    if value.is_constant():
        number = float(value)
        if abs(number - round(number)) < 1e-14:
            return ca.SX(round(number))
    return value


def _inertial(parameters: Mapping[str, ca.SX], j: int) -> tuple[ca.SX, ca.SX, ca.SX]:
    p = {name: parameters[f"{name}{j}"] for name in ("XX", "XY", "XZ", "YY", "YZ", "ZZ", "MX", "MY", "MZ", "M")}
    inertia = ca.vertcat(
        ca.horzcat(p["XX"], p["XY"], p["XZ"]),
        ca.horzcat(p["XY"], p["YY"], p["YZ"]),
        ca.horzcat(p["XZ"], p["YZ"], p["ZZ"]),
    )
    return inertia, ca.vertcat(p["MX"], p["MY"], p["MZ"]), p["M"]


def _balance(
    robot: RobotDescription,
    rotations: Sequence[ca.SX],
    offsets: Sequence[ca.SX],
    forces: list[ca.SX],
    moments: list[ca.SX],
    motions: Sequence[JointMotion],
    parameters: Mapping[str, ca.SX],
    shapes: Mapping[str, ca.SX],
) -> ca.SX:
    """Backward recursion: force and moment at each joint, projected on its axis, plus the effects."""
    force, moment = ca.SX(3, 1), ca.SX(3, 1)
    torques: list[ca.SX] = []
    for j in reversed(range(len(robot.joints))):
        joint = robot.joints[j]
        force = forces[j] + force
        moment = moments[j] + moment
        torque = moment[2] if joint.type == "revolute" else force[2]
        own_shapes = {v.name: shapes[f"{v.name}_{j + 1}"] for v in joint.shapes()}
        for effect in joint.effect_objects():
            columns = effect.columns(motions[j], own_shapes)
            names = [v.name for v in effect.parameters(joint.type)]
            for name, column in zip(names, columns, strict=True):
                torque = torque + parameters[f"{name}{j + 1}"] * column
        torques.append(torque)
        force = rotations[j] @ force
        moment = rotations[j] @ moment + ca.cross(offsets[j], force)
    return ca.vertcat(*reversed(torques))
