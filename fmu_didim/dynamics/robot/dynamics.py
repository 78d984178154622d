"""Recursive Newton-Euler inverse dynamics in CasADi, for the lengths and the gravity of a robot, or with these as
arguments: the equations of robots that differ in them alone are formed once.

Source: Khalil and Dombre, *Modeling, Identification and Control of Robots*, section 9.5, with the
inertia and the first moments taken about the origin of the link frame, so that the torque is linear
in all inertial parameters.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from fmu_didim.base.symbolic import jacobian
from fmu_didim.data.signals import Array
from fmu_didim.dynamics.effects import PAYLOAD, Surroundings, TorqueEffect, start_name
from fmu_didim.dynamics.robot.description import RobotDescription

ROUNDING = 1e-14
"""[1 or m] By which sines and cosines of right angles, and lengths made of them, miss a whole number."""

LENGTHS = ("a", "d")


@dataclass(frozen=True)
class FreeGeometry:
    """What of a robot is an argument of its equations; nothing by default.

    Attributes:
        lengths: (number of the joint, from 0, ``a`` or ``d``) -> its symbol; gravity: (3,) symbols.
    """

    lengths: Mapping[tuple[int, str], ca.SX] = field(default_factory=dict)
    gravity: ca.SX | None = None

    @staticmethod
    def of_lengths(robot: RobotDescription) -> FreeGeometry:
        """All lengths that are not zero: those add no terms to the equations."""
        places = [(j, name) for j, joint in enumerate(robot.joints) for name in LENGTHS if getattr(joint, name)]
        return FreeGeometry({(j, name): ca.SX.sym(f"{name}{j + 1}") for j, name in places})

    @staticmethod
    def of_gravity() -> FreeGeometry:
        """Gravity along all axes of the base."""
        return FreeGeometry(gravity=ca.SX.sym("gravity", 3))

    @property
    def symbols(self) -> list[ca.SX]:
        """The argument (m,), if there is one."""
        symbols = [*self.lengths.values(), *([] if self.gravity is None else [self.gravity])]
        return [ca.vertcat(*symbols)] if symbols else []

    def values(self, robot: RobotDescription) -> list[Array]:
        """Its values (m,) for a robot."""
        found = [float(getattr(robot.joints[j], name)) for j, name in self.lengths]
        return [np.array(found if self.gravity is None else [*found, *robot.gravity])] if self.symbols else []


def free_geometry(robot: RobotDescription, other: RobotDescription) -> FreeGeometry | None:
    """What must be an argument so that the equations of a robot are those of another one, too; None where they differ
    in more than lengths that are not zero, or than gravity."""
    lengths = {name for joint in robot.joints for name in LENGTHS if getattr(joint, name)}
    if len(robot.joints) != len(other.joints):
        return None
    for own, others in zip(robot.joints, other.joints, strict=True):
        lengthened = own.model_copy(update={k: getattr(others, k) for k in lengths if getattr(own, k)})
        if lengthened != others:
            return None
    same_gravity, same_lengths = robot.gravity == other.gravity, robot.joints == other.joints
    if same_gravity:
        return FreeGeometry.of_lengths(robot)
    # The axes about which a base is tilted depend on gravity.
    is_tilted = any(v.name.startswith("tilt_") for v in robot.shape_parameters())
    return FreeGeometry.of_gravity() if same_lengths and not is_tilted else None


NOTHING = FreeGeometry()


def rigid_body_torque(
    robot: RobotDescription,
    q: ca.SX,
    dq: ca.SX,
    ddq: ca.SX,
    parameters: Mapping[str, ca.SX],
    *,
    gravity: ca.SX | None = None,
    geometry: FreeGeometry = NOTHING,
) -> ca.SX:
    """Torques of the links alone, gravity, inertia and Coriolis terms, shape (n,).

    Args:
        robot: geometry.
        q, dq, ddq: (n,) joint positions, velocities, accelerations (rad or m, ...).
        parameters: inertial parameters by name (``ZZ1``, ``M1``, ...).
        gravity: (3,) in m/s2; that of the description by default.
        geometry: what of the robot is a symbol.
    """
    rotations, offsets = link_geometry(robot, q, geometry)
    axis = ca.SX([0.0, 0.0, 1.0])
    omega, domega = ca.SX(3, 1), ca.SX(3, 1)
    # Gravity enters as an acceleration of the base.
    acceleration = -(ca.SX(robot.gravity) if gravity is None else gravity)
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
    return _balance(robot, rotations, offsets, forces, moments)


def link_geometry(
    robot: RobotDescription, q: ca.SX, geometry: FreeGeometry = NOTHING
) -> tuple[list[ca.SX], list[ca.SX]]:
    """Rotation of frame j in frame j-1, and position of its origin, for each joint."""
    rotations, offsets, lengths = [], [], geometry.lengths
    for j, joint in enumerate(robot.joints):
        theta = joint.theta + q[j] if joint.type == "revolute" else ca.SX(joint.theta)
        d = lengths.get((j, "d"), ca.SX(joint.d)) + (q[j] if joint.type == "prismatic" else 0)
        ct, st = (_exact(ca.cos(theta)), _exact(ca.sin(theta)))
        before = ca.SX(ca.DM(_exact_numbers(joint.before)))
        before[0, 3] = lengths.get((j, "a"), before[0, 3])
        spin = ca.vertcat(ca.horzcat(ct, -st, 0), ca.horzcat(st, ct, 0), ca.horzcat(0, 0, 1))
        rotations.append(before[:3, :3] @ spin)
        offsets.append(before[:3, 3] + d * before[:3, 2])
    return rotations, offsets


def _exact(value: ca.SX) -> ca.SX:
    """A constant within rounding of -1, 0 or 1 made exact, so that zero terms vanish from the code."""
    return ca.SX(float(_exact_numbers(np.array(float(value))))) if value.is_constant() else value


def _exact_numbers(values: Array) -> Array:
    """Numbers within rounding of a whole one made exact."""
    whole = np.round(values)
    return np.where(np.abs(values - whole) < ROUNDING, whole + 0.0, values)


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
) -> ca.SX:
    """Backward recursion: force and moment at each joint, projected on its axis."""
    force, moment = ca.SX(3, 1), ca.SX(3, 1)
    torques: list[ca.SX] = []
    for j in reversed(range(len(robot.joints))):
        force = forces[j] + force
        moment = moments[j] + moment
        torques.append(moment[2] if robot.joints[j].type == "revolute" else force[2])
        force = rotations[j] @ force
        moment = rotations[j] @ moment + ca.cross(offsets[j], force)
    return ca.vertcat(*reversed(torques))


@dataclass(frozen=True)
class PlacedEffect:
    """A torque effect at its joint.

    Attributes:
        effect: what acts; joint: number of its joint, from 0; states: places of its states in z.
    """

    effect: TorqueEffect
    joint: int
    states: slice

    def surroundings(
        self,
        robot: RobotDescription,
        motion: tuple[ca.SX, ca.SX, ca.SX],
        time: ca.SX,
        z: ca.SX,
        load: ca.SX,
        link: Mapping[str, ca.SX],
    ) -> Surroundings:
        """Surroundings of the effect; z are the states of all effects."""
        own = tuple(z[i] for i in range(self.states.start, self.states.stop))
        kind = robot.joints[self.joint].type
        return Surroundings(self.joint, kind, *motion, load=load, time=time, state=own, link=link)


def placed_effects(robot: RobotDescription) -> list[PlacedEffect]:
    """All effects of a robot, joint by joint, with the places of their states."""
    result, begin = [], 0
    for j, joint in enumerate(robot.joints):
        for effect in joint.effect_objects():
            end = begin + len(effect.states(joint.type))
            result.append(PlacedEffect(effect, j, slice(begin, end)))
            begin = end
    return result


def given_starts(robot: RobotDescription, placed: PlacedEffect) -> Iterator[tuple[int, str]]:
    """The measured states of an effect: place in z, and name of the parameter of the plant that is the start of it."""
    for i, state in enumerate(placed.effect.states(robot.joints[placed.joint].type), start=placed.states.start):
        if state.name in placed.effect.given_states:
            yield i, start_name(state.name, placed.joint + 1)


def own_parameters(
    robot: RobotDescription, placed: PlacedEffect, parameters: Mapping[str, ca.SX], shapes: Mapping[str, ca.SX]
) -> tuple[dict[str, ca.SX], dict[str, ca.SX]]:
    """Amplitudes and shapes of an effect, named without the joint number."""
    joint, number = robot.joints[placed.joint], placed.joint + 1
    return (
        {v.name: parameters[f"{v.name}{number}"] for v in placed.effect.parameters(joint.type)},
        {v.name: shapes[f"{v.name}_{number}"] for v in placed.effect.shapes(joint.type)},
    )


def add_effect(
    torque: list[ca.SX],
    placed: PlacedEffect,
    at: Surroundings,
    amplitudes: Mapping[str, ca.SX],
    shapes: Mapping[str, ca.SX],
) -> None:
    """Add the torque of an effect to the rows (n) that it acts on."""
    columns = placed.effect.columns(at, shapes)
    for amplitude, column in zip(amplitudes.values(), columns, strict=True):
        rows = column if isinstance(column, Mapping) else {placed.joint: column}
        for row, entry in rows.items():
            torque[row] = torque[row] + amplitude * entry


def link_columns(
    rigid: ca.SX, joint: int, parameters: Mapping[str, ca.SX], names: Sequence[str] = PAYLOAD
) -> dict[str, ca.SX]:
    """Columns (n,) of the rigid-body regressor for some inertial parameters of a link, joint from 0."""
    return {name: jacobian(rigid, parameters[f"{name}{joint + 1}"]) for name in names}
