"""Friction that grows with the square of the velocity."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from fmu_didim.effects.base import JointType, OperatingRange, Surroundings, TorqueEffect
from fmu_didim.signals import Variable


class QuadraticViscous(TorqueEffect):
    """tau_e = Fq * dq |dq|, with Fq in N.m.s2/rad2 (N.s2/m2): drag, churning of the lubricant."""

    name = "quadratic_viscous"
    title = "Quadratic viscous friction"
    equation = "Fq*dq*|dq|"
    class_name = "nonlinear viscous"
    confounded_with = ("cubic_viscous", "power_viscous", "stribeck", "presliding")
    signature = "Residual odd in the velocity that is curved upwards at high speed."
    experiment = (
        "Constant speeds on a logarithmic scale in both directions, the fastest more than five times the slowest."
    )
    source = "Olsson, Astrom, Canudas de Wit, Gafvert, Lischinsky: Friction models, Eur. J. of Control 1998"

    def parameters(self, joint_type: JointType) -> tuple[Variable, ...]:
        unit = "N.m.s2/rad2" if joint_type == "revolute" else "N.s2/m2"
        return (Variable("Fq", unit, "parameter", 0.0, "quadratic friction coefficient"),)

    def columns(self, at: Surroundings, shapes: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        return (at.dq * ca.fabs(at.dq),)

    def damping(self, parameters: Mapping[str, ca.SX], shapes: Mapping[str, ca.SX], within: OperatingRange) -> ca.SX:
        return 2 * ca.fabs(parameters["Fq"]) * within.speed
