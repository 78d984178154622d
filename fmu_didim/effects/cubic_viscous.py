"""Friction that grows with the cube of the velocity."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from fmu_didim.effects.base import JointType, OperatingRange, Surroundings, TorqueEffect
from fmu_didim.signals import Variable


class CubicViscous(TorqueEffect):
    """tau_e = Fcube * dq^3, with Fcube in N.m.s3/rad3 (N.s3/m3)."""

    name = "cubic_viscous"
    title = "Cubic viscous friction"
    equation = "Fcube*dq^3"
    class_name = "nonlinear viscous"
    confounded_with = ("quadratic_viscous", "power_viscous")
    signature = "Residual odd in the velocity that is curved upwards at high speed."
    experiment = (
        "Constant speeds on a logarithmic scale in both directions, the fastest more than five times the slowest."
    )
    source = "Olsson, Astrom, Canudas de Wit, Gafvert, Lischinsky: Friction models, Eur. J. of Control 1998"

    def parameters(self, joint_type: JointType) -> tuple[Variable, ...]:
        unit = "N.m.s3/rad3" if joint_type == "revolute" else "N.s3/m3"
        return (Variable("Fcube", unit, "parameter", 0.0, "cubic friction coefficient"),)

    def columns(self, at: Surroundings, shapes: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        return (at.dq**3,)

    def damping(self, parameters: Mapping[str, ca.SX], shapes: Mapping[str, ca.SX], within: OperatingRange) -> ca.SX:
        return 3 * ca.fabs(parameters["Fcube"]) * within.speed**2
