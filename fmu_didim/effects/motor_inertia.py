"""Inertia of the motor's rotor."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from fmu_didim.effects.base import UNITS, JointType, Surroundings, TorqueEffect
from fmu_didim.signals import Variable


class MotorInertia(TorqueEffect):
    """tau_e = Ia * ddq, with Ia in kg.m2 (kg) on the joint's side of the gear."""

    name = "motor_inertia"
    title = "Motor inertia"
    equation = "Ia*ddq"
    class_name = "motor_inertia"
    signature = "Residual in proportion to the acceleration of the joint, whatever the other joints do."
    experiment = "Move the joint alone and together with the others, so that its inertia about the axis changes."
    source = "Khalil and Dombre, Modeling, Identification and Control of Robots, chapter 9"
    is_base = True

    def parameters(self, joint_type: JointType) -> tuple[Variable, ...]:
        return (Variable("Ia", UNITS[joint_type].inertia, "parameter", 0.0, "motor inertia at the joint"),)

    def supersedes(self, values: Mapping[str, float]) -> frozenset[str]:
        # The motor's inertia is known by its own name.
        return frozenset({"motor_share"} if values.get("Ia", 0.0) != 0 else ())

    def columns(self, at: Surroundings, shapes: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        return (at.ddq,)
