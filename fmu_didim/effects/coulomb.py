"""Coulomb friction, smoothed at zero velocity."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from fmu_didim.effects.base import UNITS, JointType, OperatingRange, Search, Surroundings, TorqueEffect
from fmu_didim.effects.steps import direction, smoothing_velocity
from fmu_didim.signals import Variable


class Coulomb(TorqueEffect):
    """tau_e = Fc * s(dq), s(dq) = tanh(dq/v0), with Fc in N.m (N); the smoothing velocity v0 in rad/s (m/s) is a shape.

    The slope Fc/v0 at rest is a stiffness of the direct model: Fc/(v0 J) is a rate in 1/s that the
    integration must resolve.
    """

    name = "coulomb"
    title = "Coulomb friction"
    equation = "Fc*tanh(dq/v0)"
    class_name = "coulomb"
    confounded_with = ("stribeck", "presliding", "power_viscous")
    signature = "Residual that jumps when the velocity changes its sign."
    experiment = "Constant speeds in both directions; slow ones tell the smoothing from Stribeck friction."
    source = "Gautier, Janot, Vandanjon: DIDIM, section 2; smoothing as in BIRDy (Leboutet et al. 2021)"
    is_base = True
    sets_ticks = True

    def parameters(self, joint_type: JointType) -> tuple[Variable, ...]:
        return (Variable("Fc", UNITS[joint_type].torque, "parameter", 0.0, "Coulomb friction"),)

    def shapes(self, joint_type: JointType) -> tuple[Variable, ...]:
        return (smoothing_velocity(joint_type),)

    def search(self, joint_type: JointType) -> Mapping[str, Search]:
        lowest = 0.002 if joint_type == "revolute" else 0.0002
        return {"v0": Search(lowest, 100 * lowest, 9)}

    def columns(self, at: Surroundings, shapes: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        return (direction(at, shapes),)

    def damping(self, parameters: Mapping[str, ca.SX], shapes: Mapping[str, ca.SX], within: OperatingRange) -> ca.SX:
        return ca.fabs(parameters["Fc"]) / shapes["v0"]
