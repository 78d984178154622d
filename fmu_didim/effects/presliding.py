"""Presliding friction (Dahl), in addition to Coulomb friction."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from fmu_didim.effects.base import UNITS, JointType, OperatingRange, Search, Surroundings, TorqueEffect
from fmu_didim.effects.bristles import (
    deflection,
    deflection_rate,
    deflection_relaxation,
    deflection_resolution,
    distance_search,
    presliding_distance,
)
from fmu_didim.effects.steps import direction, smoothing_velocity
from fmu_didim.signals import Variable


class Presliding(TorqueEffect):
    """tau_e = Fd (z/zs - s(dq)), dz/dt = dq - |dq| z/zs, s(dq) = tanh(dq/v0); the state z starts at 0.

    With Fd = Fc the step of Coulomb friction becomes Dahl's: after a reversal friction grows over the distance zs in
    rad (m), whatever the speed. Fd in N.m (N).
    """

    name = "presliding"
    title = "Presliding friction (Dahl)"
    equation = "Fd*(z/zs - tanh(dq/v0)), dz/dt = dq - |dq|*z/zs"
    class_name = "presliding"
    confounded_with = ("lugre", "stribeck", "coulomb", "quadratic_viscous")
    signature = "Residual after every reversal that decays over a distance, not over a time or with speed."
    experiment = "Many reversals with amplitudes below five times zs, at two speeds."
    source = "Dahl: A solid friction model, Aerospace Corporation 1968"
    # Friction that sticks before it slides leaves steps of the size of its breakaway.
    rivals_external_torque = True
    distance = "zs"

    def parameters(self, joint_type: JointType) -> tuple[Variable, ...]:
        return (
            Variable(
                "Fd", UNITS[joint_type].torque, "parameter", 0.0, "Coulomb friction that builds up over a distance"
            ),
        )

    def shapes(self, joint_type: JointType) -> tuple[Variable, ...]:
        return (smoothing_velocity(joint_type), presliding_distance(joint_type))

    def search(self, joint_type: JointType) -> Mapping[str, Search]:
        return {"zs": distance_search(joint_type)}

    def states(self, joint_type: JointType) -> tuple[Variable, ...]:
        return (deflection(joint_type),)

    def columns(self, at: Surroundings, shapes: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        return (at.state[0] / shapes["zs"] - direction(at, shapes),)

    def rates(self, at: Surroundings, shapes: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        return (deflection_rate(at, shapes["zs"]),)

    def damping(self, parameters: Mapping[str, ca.SX], shapes: Mapping[str, ca.SX], within: OperatingRange) -> ca.SX:
        # It takes the step away that Coulomb friction counts.
        return -parameters["Fd"] / shapes["v0"]

    def stiffness(self, parameters: Mapping[str, ca.SX], shapes: Mapping[str, ca.SX], within: OperatingRange) -> ca.SX:
        return ca.fabs(parameters["Fd"]) / shapes["zs"]

    def own_rate(self, shapes: Mapping[str, ca.SX], within: OperatingRange) -> ca.SX:
        return deflection_resolution(shapes["zs"], within)

    def relaxation(self, shapes: Mapping[str, ca.SX], within: OperatingRange) -> ca.SX:
        return deflection_relaxation(shapes["zs"], within)
