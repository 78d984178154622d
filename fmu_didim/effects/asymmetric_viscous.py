"""Viscous friction that differs between the two directions."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from fmu_didim.effects.base import UNITS, JointType, OperatingRange, Surroundings, TorqueEffect
from fmu_didim.signals import Variable


class AsymmetricViscous(TorqueEffect):
    """tau_e = Fva * |dq|: viscous friction Fv + Fva forwards and Fv - Fva backwards, in N.m.s/rad (N.s/m)."""

    name = "asymmetric_viscous"
    title = "Asymmetric viscous friction"
    equation = "Fva*|dq|"
    class_name = "asymmetric_viscous"
    confounded_with = ("quadratic_viscous",)
    signature = "Residual even in the velocity that grows with speed and is zero at rest."
    experiment = (
        "Constant speeds on a logarithmic scale in both directions, the fastest more than five times the slowest."
    )
    source = "Janot, Gautier, Brunot: Data set and reference models of EMPS, 2019"

    def parameters(self, joint_type: JointType) -> tuple[Variable, ...]:
        return (
            Variable(
                "Fva",
                UNITS[joint_type].viscous,
                "parameter",
                0.0,
                "half the difference of viscous friction between the directions",
            ),
        )

    def columns(self, at: Surroundings, shapes: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        return (ca.fabs(at.dq),)

    def damping(self, parameters: Mapping[str, ca.SX], shapes: Mapping[str, ca.SX], within: OperatingRange) -> ca.SX:
        return ca.fabs(parameters["Fva"])
