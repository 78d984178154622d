"""Bristle deflection: the state of presliding friction."""

from __future__ import annotations

import casadi as ca

from fmu_didim.effects.base import NOMINAL_SPEED, UNITS, JointType, OperatingRange, Search, Surroundings
from fmu_didim.signals import Variable


def presliding_distance(joint_type: JointType) -> Variable:
    """The shape ``zs``; all effects of a joint share it."""
    value = 0.001 if joint_type == "revolute" else 0.0001
    return Variable("zs", UNITS[joint_type].position, "parameter", value, "presliding distance")


def distance_search(joint_type: JointType) -> Search:
    """Values of ``zs`` to search."""
    lowest = 1e-4 if joint_type == "revolute" else 1e-5
    return Search(lowest, 300 * lowest, 9)


def deflection(joint_type: JointType) -> Variable:
    """The state z, zero when the joint was never moved."""
    return Variable("z", UNITS[joint_type].position, "local", 0.0, "deflection of the bristles")


def deflection_rate(at: Surroundings, distance: ca.SX) -> ca.SX:
    """dz/dt = w - |w| z/zs, w = V tanh(dq/V): Dahl's equation for all but very high speeds.

    Far above the nominal speed V of the joint, where z has long settled at zs sign(dq), the rate |w|/zs grows no
    further; so the integration stays stable whatever the speed.
    """
    limit = NOMINAL_SPEED[at.joint_type]
    speed = limit * ca.tanh(at.dq / limit)
    return speed - ca.fabs(speed) * at.state[0] / distance


def deflection_resolution(distance: ca.SX, within: OperatingRange) -> ca.SX:
    """Rate in 1/s that the integration must resolve: after a reversal the speed at the distance zs is sqrt(2 a zs), and
    there the deflection follows at sqrt(2 a/zs)."""
    return ca.sqrt(2 * within.acceleration / distance)


def deflection_relaxation(distance: ca.SX, within: OperatingRange) -> ca.SX:
    """|w|/zs at full speed, where the deflection has settled."""
    return within.speed / distance
