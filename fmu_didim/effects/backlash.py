"""Backlash of the gear."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

from fmu_didim.effects.base import UNITS, JointType, Search
from fmu_didim.effects.first_order import FirstOrder, play
from fmu_didim.effects.structure import GEAR_LIMITS, StructureEffect, gear_damping, gear_stiffness, motor_share
from fmu_didim.signals import Variable


class Backlash(StructureEffect):
    """Play of width ``gap`` between motor and link, with a stiff spring K and a damper D while they are in contact:

        tau_s = K z(q - q_link) + D z'(q - q_link) (dq - dq_link)
        z(x) = x - clip(x, -gap/2, gap/2), corners rounded over 5 % of gap/2

    with gap in rad (m); all else as for the elasticity of a joint, whose K and D it shares. The joint starts in the
    middle of the play.
    """

    name = "backlash"
    title = "Backlash"
    equation = "tau = Im*ddq + friction(dq) + tau_s, tau_s = K*dead_zone(q - q_link, gap/2) while in contact"
    class_name = "backlash"
    confounded_with = ("joint_elasticity",)
    signature = "Residual where the transmitted torque changes its sign: the load vanishes, then there is an impact."
    experiment = "Motions whose transmitted torque changes its sign at different velocities, or an encoder on the link."
    source = "Nordin and Gutman: Controlling mechanical systems with backlash, a survey, Automatica 38, 2002"
    signed = frozenset({"D", "gap"})
    neutral: ClassVar[Mapping[str, float]] = {"gap": 0.0, "K": math.inf, "D": 0.0}
    limits = GEAR_LIMITS
    elastic = True
    first_order = FirstOrder("link position", play)

    def parameters(self, joint_type: JointType) -> tuple[Variable, ...]:
        return (Variable("gap", UNITS[joint_type].position, "parameter", 0.0, "play between motor and link"),)

    def shapes(self, joint_type: JointType) -> tuple[Variable, ...]:
        return (gear_stiffness(joint_type), gear_damping(joint_type), motor_share(joint_type))

    def search(self, joint_type: JointType) -> Mapping[str, Search]:
        turning = joint_type == "revolute"
        low, stiffness, damping = (2e-4, 500.0, 2.0) if turning else (2e-5, 5e4, 200.0)
        return {
            "gap": Search(low, 200 * low, 5),
            "K": Search(stiffness, 100 * stiffness, 4),
            "D": Search(damping, 50 * damping, 3),
            "motor_share": Search(0.1, 0.5, 3, logarithmic=False),
        }
