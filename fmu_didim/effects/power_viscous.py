"""Friction that follows a power of the velocity."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from fmu_didim.effects.base import UNITS, JointType, OperatingRange, Search, Surroundings, TorqueEffect
from fmu_didim.effects.steps import smoothing_velocity
from fmu_didim.signals import Variable


class PowerViscous(TorqueEffect):
    """tau_e = Fp * dq (dq^2 + v0^2)^((alpha - 1)/2), close to Fp sign(dq) |dq|^alpha above the smoothing velocity v0.

    Fp is the friction in N.m (N) at a speed of 1 rad/s (m/s). alpha < 1 is shear thinning; alpha = 1 is viscous.
    """

    name = "power_viscous"
    title = "Friction by a power of the velocity"
    equation = "Fp*sign(dq)*|dq|^alpha"
    class_name = "nonlinear viscous"
    confounded_with = ("quadratic_viscous", "cubic_viscous", "stribeck", "coulomb")
    signature = "Residual odd in the velocity, curved downwards (alpha < 1) or upwards (alpha > 1)."
    experiment = (
        "Constant speeds on a logarithmic scale in both directions, the fastest more than five times the slowest."
    )
    source = "Olsson, Astrom, Canudas de Wit, Gafvert, Lischinsky: Friction models, Eur. J. of Control 1998"

    def parameters(self, joint_type: JointType) -> tuple[Variable, ...]:
        return (Variable("Fp", UNITS[joint_type].torque, "parameter", 0.0, "friction at unit speed"),)

    def shapes(self, joint_type: JointType) -> tuple[Variable, ...]:
        return (
            smoothing_velocity(joint_type),
            Variable("alpha", "1", "parameter", 0.5, "exponent of the velocity"),
        )

    def search(self, joint_type: JointType) -> Mapping[str, Search]:
        return {"alpha": Search(0.6, 2.5, 10, logarithmic=False)}

    def columns(self, at: Surroundings, shapes: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        return (at.dq * (at.dq**2 + shapes["v0"] ** 2) ** ((shapes["alpha"] - 1) / 2),)

    def damping(self, parameters: Mapping[str, ca.SX], shapes: Mapping[str, ca.SX], within: OperatingRange) -> ca.SX:
        # The slope is largest at rest for alpha < 1 and at high speed for alpha > 1.
        power, slow = shapes["alpha"] - 1, shapes["v0"]
        return ca.fabs(parameters["Fp"]) * ca.fmax(
            slow**power, shapes["alpha"] * (within.speed**2 + slow**2) ** (power / 2)
        )
