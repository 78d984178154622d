"""Bristle deflection: the state of presliding friction."""

from __future__ import annotations

from typing import ClassVar

import casadi as ca

from fmu_didim.data.signals import Variable
from fmu_didim.dynamics.effects.base import TorqueEffect
from fmu_didim.dynamics.effects.joint import (
    NOMINAL_SPEED,
    UNITS,
    JointType,
    OperatingRange,
    Parameter,
    Search,
    Surroundings,
    Values,
)

presliding_distance = Parameter("zs", "position", "presliding distance", (0.001, 0.0001)).searched(
    (Search(1e-4, 300 * 1e-4, 9), Search(1e-5, 300 * 1e-5, 9))
)
"""All effects of a joint share it."""


def deflection_rate(at: Surroundings, distance: ca.SX) -> ca.SX:
    """dz/dt = w - |w| z/zs, w = V tanh(dq/V), of the first state z: Dahl's equation for all but very high speeds.

    Far above the nominal speed V of the joint, where z has long settled at zs sign(dq), the rate |w|/zs grows no
    further; so the integration stays stable whatever the speed.
    """
    limit = NOMINAL_SPEED[at.joint_type]
    speed = limit * ca.tanh(at.dq / limit)
    return speed - ca.fabs(speed) * at.state[0] / distance


def resolved_rate(distance: ca.SX, within: OperatingRange) -> ca.SX:
    """Rate in 1/s that the integration must resolve.

    After a reversal the speed at the distance zs is sqrt(2 a zs): there the deflection follows at sqrt(2 a/zs).
    """
    return ca.sqrt(2 * within.acceleration / distance)


class BristleFriction(TorqueEffect):
    """Friction of bristles that bend by z before they slide; z is zero when the joint was never moved."""

    distance: ClassVar[str] = "zs"

    def states(self, joint_type: JointType) -> tuple[Variable, ...]:
        return (Variable("z", UNITS[joint_type].position, "local", 0.0, "deflection of the bristles"),)

    def rates(self, at: Surroundings, shapes: Values) -> tuple[ca.SX, ...]:
        return (deflection_rate(at, shapes["zs"]),)

    def own_rate(self, shapes: Values, within: OperatingRange) -> ca.SX:
        return resolved_rate(shapes["zs"], within)

    def relaxation(self, shapes: Values, within: OperatingRange) -> ca.SX:
        """|w|/zs at full speed, where the deflection has settled."""
        return within.speed / shapes["zs"]
