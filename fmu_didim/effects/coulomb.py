"""Coulomb friction, smoothed at zero velocity."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from fmu_didim.effects.base import UNITS, JointMotion, JointType, TorqueEffect
from fmu_didim.signals import Variable


class Coulomb(TorqueEffect):
    """tau_e = Fc * tanh(dq / v0), with Fc in N.m (N); the smoothing velocity v0 in rad/s (m/s) is a shape.

    The slope Fc/v0 at rest is a stiffness of the direct model: Fc/(v0 J) is a rate in 1/s that the
    integration must resolve.
    """

    name = "coulomb"
    equation = "Fc*tanh(dq/v0)"
    confounded_with = ("stribeck", "presliding")
    source = "Gautier, Janot, Vandanjon: DIDIM, section 2; smoothing as in BIRDy (Leboutet et al. 2021)"

    def parameters(self, joint_type: JointType) -> tuple[Variable, ...]:
        return (Variable("Fc", UNITS[joint_type].torque, "parameter", 0.0, "Coulomb friction"),)

    def shapes(self, joint_type: JointType) -> tuple[Variable, ...]:
        value = 0.01 if joint_type == "revolute" else 0.001
        return (
            Variable("v0", UNITS[joint_type].velocity, "parameter", value, "smoothing velocity of Coulomb friction"),
        )

    def columns(self, motion: JointMotion, shapes: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        return (ca.tanh(motion.dq / shapes["v0"]),)

    def damping(self, parameters: Mapping[str, ca.SX], shapes: Mapping[str, ca.SX]) -> ca.SX:
        return ca.fabs(parameters["Fc"]) / shapes["v0"]
