"""Elastic contact at the upper end of the range."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from fmu_didim.effects.base import UNITS, JointType, OperatingRange, Search, Surroundings, TorqueEffect
from fmu_didim.effects.steps import ramp
from fmu_didim.signals import Variable


class ContactStop(TorqueEffect):
    """tau_e = kupper max(0, q - qupper), smoothed within wstop of the contact; kupper in N.m/rad (N/m)."""

    name = "contact_stop"
    title = "Contact with the upper stop"
    equation = "kupper*max(0, q - qupper)"
    class_name = "position-dependent load"
    confounded_with = ("spring", "cubic_spring", "contact_stop_lower")
    signature = "Residual beyond one position only, whatever the speed."
    experiment = "Paths that end on either side of the position where the contact begins."
    source = "Gilardi and Sharf: Literature survey of contact dynamics modelling, Mechanism and Machine Theory 2002"
    signed = frozenset({"qupper"})
    acts_on_link = True

    def parameters(self, joint_type: JointType) -> tuple[Variable, ...]:
        return (Variable("kupper", UNITS[joint_type].stiffness, "parameter", 0.0, "stiffness of the contact"),)

    def shapes(self, joint_type: JointType) -> tuple[Variable, ...]:
        unit, scale = UNITS[joint_type].position, 1.0 if joint_type == "revolute" else 0.1
        return (
            Variable("qupper", unit, "parameter", 1.0 * scale, "position where the contact begins"),
            Variable("wstop", unit, "parameter", 0.005 * scale, "half the width in which contact is made"),
        )

    def search(self, joint_type: JointType) -> Mapping[str, Search]:
        reach = 3.0 if joint_type == "revolute" else 0.5
        return {"qupper": Search(-reach, reach, 31, logarithmic=False)}

    def columns(self, at: Surroundings, shapes: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        return (ramp(at.q - shapes["qupper"], shapes["wstop"]),)

    def stiffness(self, parameters: Mapping[str, ca.SX], shapes: Mapping[str, ca.SX], within: OperatingRange) -> ca.SX:
        return ca.fabs(parameters["kupper"])
