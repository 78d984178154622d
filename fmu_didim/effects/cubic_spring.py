"""Spring whose stiffness grows with the position."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from fmu_didim.effects.base import JointType, OperatingRange, Surroundings, TorqueEffect
from fmu_didim.signals import Variable


class CubicSpring(TorqueEffect):
    """tau_e = kcube q^3, with kcube in N.m/rad3 (N/m3)."""

    name = "cubic_spring"
    title = "Hardening spring"
    equation = "kcube*q^3"
    class_name = "position-dependent load"
    confounded_with = ("spring", "contact_stop", "contact_stop_lower")
    signature = "Residual that grows towards both ends of the range and does not depend on speed."
    experiment = "A wide range of positions, or the same path with another payload or orientation of the base."
    source = "Nayfeh and Mook: Nonlinear oscillations, 1979 (Duffing's spring)"
    acts_on_link = True

    def parameters(self, joint_type: JointType) -> tuple[Variable, ...]:
        unit = "N.m/rad3" if joint_type == "revolute" else "N/m3"
        return (Variable("kcube", unit, "parameter", 0.0, "cubic stiffness"),)

    def columns(self, at: Surroundings, shapes: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        return (at.q**3,)

    def stiffness(self, parameters: Mapping[str, ca.SX], shapes: Mapping[str, ca.SX], within: OperatingRange) -> ca.SX:
        # At one rad or m from the middle.
        return 3 * ca.fabs(parameters["kcube"])
