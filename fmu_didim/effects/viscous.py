"""Viscous friction."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from fmu_didim.effects.base import UNITS, JointType, OperatingRange, Surroundings, TorqueEffect
from fmu_didim.signals import Variable


class Viscous(TorqueEffect):
    """tau_e = Fv * dq, with Fv in N.m.s/rad (revolute) or N.s/m (prismatic)."""

    name = "viscous"
    title = "Viscous friction"
    equation = "Fv*dq"
    class_name = "viscous"
    signature = "Residual in proportion to the velocity."
    experiment = (
        "Constant speeds on a logarithmic scale in both directions, the fastest more than five times the slowest."
    )
    source = "Gautier, Janot, Vandanjon: DIDIM, section 2"
    is_base = True

    def parameters(self, joint_type: JointType) -> tuple[Variable, ...]:
        return (Variable("Fv", UNITS[joint_type].viscous, "parameter", 0.0, "viscous friction coefficient"),)

    def columns(self, at: Surroundings, shapes: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        return (at.dq,)

    def damping(self, parameters: Mapping[str, ca.SX], shapes: Mapping[str, ca.SX], within: OperatingRange) -> ca.SX:
        return ca.fabs(parameters["Fv"])
