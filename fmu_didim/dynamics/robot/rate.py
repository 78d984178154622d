"""A bound of the fastest rate of a robot's direct model, from which its integration step follows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from fmu_didim.dynamics.effects import NOMINAL_ACCELERATION, NOMINAL_SPEED, OperatingRange
from fmu_didim.dynamics.robot.description import RobotDescription
from fmu_didim.dynamics.robot.dynamics import PlacedEffect, own_parameters


@dataclass(frozen=True)
class Method:
    """How much of each kind of rate counts for the step of an integration method.

    Attributes:
        damped: of friction and dampers; oscillating: of springs, and of what effects must resolve in time;
        relaxing: of own states that only have to stay stable.
    """

    damped: float
    oscillating: float
    relaxing: float


EXPLICIT = Method(1.0, 1.0, 0.1)
"""RK4 at h rate <= 0.2: stable with room to spare at h rate = 2, its limit being 2.78."""
IMPLICIT = Method(1.0, 2.0, 0.0)
"""With h rate = 0.2 of the damping by friction, a linearly implicit step errs by 3e-7 of the velocity of a TX40 where
the torque jumps every 5 ms. What oscillates, a step of second order with h rate = 0.1 misses by 0.04 * 0.1^2 = 4e-4 of
the oscillation in each radian."""
RESOLVING = Method(0.0, 0.2, 0.0)
"""Rates that a linearly implicit step must resolve at any accuracy."""


MOTION_RATE = 2500.0
"""In 1/s, what a linearly implicit step must resolve of the motion itself: with steps of 80 us a SCARA and an EMPS are
less than 1e-6 of their motion wrong."""


def fastest_rate(
    robot: RobotDescription,
    effects: Sequence[PlacedEffect],
    mass: ca.SX,
    parameters: Mapping[str, ca.SX],
    shapes: Mapping[str, ca.SX],
    *,
    method: Method = EXPLICIT,
) -> ca.SX:
    """Bound in 1/s: max of d/2 + sqrt(d^2/4 + k) and of the effects' own rates.

    d and k are the infinity norms of |M^-1| D and |M^-1| K with the bounds of damping and stiffness of all effects;
    the value is that of the fastest root of s^2 + d s + k = 0, or of its magnitude. An effect that acts on several
    joints counts at each of them.

    Args:
        mass: M (n, n); parameters, shapes: by name with the joint number.
        method: that integrates the robot.
    """
    n = len(robot.joints)
    inverse = ca.fabs(ca.ldl_solve(ca.SX.eye(n), *ca.ldl(mass)))
    damping, stiffness, own = [ca.SX(0)] * n, [ca.SX(0)] * n, ca.SX(0)
    for placed in effects:
        effect, j = placed.effect, placed.joint
        within = _operating_range(robot, placed, mass, parameters)
        amplitudes, constants = own_parameters(robot, placed, parameters, shapes)
        for row in range(j, j + effect.reach + 1):
            damping[row] = damping[row] + effect.damping(amplitudes, constants, within)
            stiffness[row] = stiffness[row] + effect.stiffness(amplitudes, constants, within)
        needed = method.oscillating * effect.own_rate(constants, within)
        own = ca.fmax(own, ca.fmax(needed, method.relaxing * effect.relaxation(constants, within)))
    slow, fast = _norm(inverse, damping), _norm(inverse, stiffness)
    slow, fast = method.damped * slow, method.oscillating**2 * fast
    if not fast.is_zero():
        slow = slow / 2 + ca.sqrt(slow**2 / 4 + fast)
    return slow if own.is_zero() else ca.fmax(slow, own)


def _norm(inverse: ca.SX, bounds: Sequence[ca.SX]) -> ca.SX:
    total = ca.SX(0)
    for i in range(len(bounds)):
        row = ca.SX(0)
        for j, bound in enumerate(bounds):
            row = row + inverse[i, j] * ca.fabs(bound)
        total = ca.fmax(total, row)
    return total


def _operating_range(
    robot: RobotDescription, placed: PlacedEffect, mass: ca.SX, parameters: Mapping[str, ca.SX]
) -> OperatingRange:
    j, kind = placed.joint, robot.joints[placed.joint].type
    load = load_bound(robot, j, mass, parameters) if "load" in placed.effect.needs else ca.SX(0)
    return OperatingRange(NOMINAL_SPEED[kind], NOMINAL_ACCELERATION[kind], load)


def load_bound(robot: RobotDescription, j: int, mass: ca.SX, parameters: Mapping[str, ca.SX]) -> ca.SX:
    """Bound of the load of joint j, from 0, on its links: gravity with all of them stretched out, plus the inertia at
    nominal accelerations.

    Args:
        mass: M (n, n); parameters: by name with the joint number.
    """
    gravity = float(np.linalg.norm(robot.gravity))
    load, reach = ca.SX(0), 0.0
    for i in range(j, len(robot.joints)):
        if i > j:
            reach += abs(robot.joints[i].a) + abs(robot.joints[i].d)
        weight = ca.fabs(parameters[f"M{i + 1}"])
        if robot.joints[j].type == "revolute":
            moments = [ca.fabs(parameters[f"{name}{i + 1}"]) for name in ("MX", "MY", "MZ")]
            weight = weight * reach + sum(moments, ca.SX(0))
        load = load + gravity * weight
    for i, joint in enumerate(robot.joints):
        load = load + ca.fabs(mass[j, i]) * NOMINAL_ACCELERATION[joint.type]
    return load
