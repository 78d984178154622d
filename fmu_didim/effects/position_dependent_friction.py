"""Coulomb friction that changes along the joint."""

from __future__ import annotations

import math
from collections.abc import Mapping

import casadi as ca

from fmu_didim.effects.base import UNITS, JointType, OperatingRange, Search, Surroundings, TorqueEffect
from fmu_didim.effects.steps import direction, smoothing_velocity
from fmu_didim.signals import Variable


class PositionDependentFriction(TorqueEffect):
    """tau_e = (Fcos cos(x) + Fsin sin(x)) s(dq), x = 2 pi q/lp, s(dq) = tanh(dq/v0): amplitudes in N.m (N).

    The length lp in rad (m) after which friction repeats is a shape; one turn for a revolute joint.
    """

    name = "position_dependent_friction"
    title = "Position-dependent friction"
    equation = "(Fcos*cos(2*pi*q/lp) + Fsin*sin(2*pi*q/lp))*tanh(dq/v0)"
    class_name = "position_dependent_friction"
    confounded_with = ("load_dependent_friction",)
    signature = "Residual in a square wave of the velocity whose height repeats along the joint."
    experiment = "The same path at two speeds and with two payloads."
    source = "Armstrong-Helouvry: Control of machines with friction, 1991"

    def parameters(self, joint_type: JointType) -> tuple[Variable, ...]:
        return (
            Variable("Fcos", UNITS[joint_type].torque, "parameter", 0.0, "cosine part of friction along the joint"),
            Variable("Fsin", UNITS[joint_type].torque, "parameter", 0.0, "sine part of friction along the joint"),
        )

    def shapes(self, joint_type: JointType) -> tuple[Variable, ...]:
        value = 2 * math.pi if joint_type == "revolute" else 0.1
        return (
            smoothing_velocity(joint_type),
            Variable("lp", UNITS[joint_type].position, "parameter", value, "length after which friction repeats"),
        )

    def search(self, joint_type: JointType) -> Mapping[str, Search]:
        # One turn is the period of a bent or unbalanced shaft; a slide has none that is known beforehand.
        return {} if joint_type == "revolute" else {"lp": Search(0.01, 1.0, 15, cost=3.0)}

    def columns(self, at: Surroundings, shapes: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        angle = 2 * math.pi * at.q / shapes["lp"]
        return (ca.cos(angle) * direction(at, shapes), ca.sin(angle) * direction(at, shapes))

    def damping(self, parameters: Mapping[str, ca.SX], shapes: Mapping[str, ca.SX], within: OperatingRange) -> ca.SX:
        return ca.sqrt(parameters["Fcos"] ** 2 + parameters["Fsin"] ** 2) / shapes["v0"]
