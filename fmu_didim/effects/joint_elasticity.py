"""Elasticity between motor and link."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

from fmu_didim.effects.base import JointType, Search
from fmu_didim.effects.first_order import FirstOrder, twist
from fmu_didim.effects.structure import (
    GEAR_LIMITS,
    StructureEffect,
    gear_damping,
    gear_stiffness,
    motor_share,
    stiffness_search,
)
from fmu_didim.signals import Variable


class JointElasticity(StructureEffect):
    """A spring between the motor (position q, which the encoder sees) and the link (position q_link):

        Im ddq + friction(dq) + tau_s = tau,    G(q_link, dq_link, ddq_link) = tau_s
        tau_s = K (q - q_link) + D (dq - dq_link)

    K in N.m/rad (N/m), D in N.m.s/rad (N.s/m), all on the joint's side of the gear. G are the rigid-body torques of the
    links and what acts on them (springs, stops, external forces); friction and all other effects act on the motor.
    The motor's inertia Im is Ia where the description gives one; else it is the part ``motor_share`` of ZZ (M of a
    slide), and the link keeps the rest.
    """

    name = "joint_elasticity"
    title = "Joint elasticity"
    equation = "tau = Im*ddq + friction(dq) + tau_s, tau_s = K*(q - q_link) + D*(dq - dq_link)"
    class_name = "elasticity"
    confounded_with = ("actuator_lag", "controller_gain", "backlash")
    signature = "Residual that grows with the square of the frequency; ringing at the resonance."
    experiment = "A chirp through the resonance, or an encoder on the link."
    source = "Spong: Modeling and control of elastic joint robots, ASME JDSMC 109, 1987"
    signed = frozenset({"D"})
    neutral: ClassVar[Mapping[str, float]] = {"K": math.inf, "D": 0.0}
    limits = GEAR_LIMITS
    elastic = True
    first_order = FirstOrder("link position", twist)

    def parameters(self, joint_type: JointType) -> tuple[Variable, ...]:
        return (gear_stiffness(joint_type), gear_damping(joint_type))

    def shapes(self, joint_type: JointType) -> tuple[Variable, ...]:
        return (motor_share(joint_type),)

    def search(self, joint_type: JointType) -> Mapping[str, Search]:
        return {"K": stiffness_search(joint_type), "motor_share": Search(0.1, 0.5, 3, logarithmic=False)}
