"""LuGre friction, in place of Coulomb and Stribeck friction."""

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
from fmu_didim.signals import Variable


class LuGre(TorqueEffect):
    """tau_e = (Fz + Fzs exp(-(dq/vs)^2)) (z + Tz dz/dt)/zs, dz/dt = dq - |dq| z/zs; the state z starts at 0.

    In the model's own terms sigma_0 = (Fz + Fzs)/zs at rest, sigma_1 = sigma_0 Tz, and sliding friction is
    g(dq) = Fz + Fzs exp(-(dq/vs)^2). The state is scaled by g, which makes the torque linear in Fz and Fzs. With
    Coulomb friction at the same joint, that one takes the part which has no memory.
    """

    name = "lugre"
    title = "LuGre friction"
    equation = "(Fz + Fzs*exp(-(dq/vs)^2))*(z + Tz*dz/dt)/zs, dz/dt = dq - |dq|*z/zs"
    class_name = "presliding"
    confounded_with = ("presliding", "stribeck", "coulomb")
    signature = "Residual after every reversal: it builds up over a distance, then falls with speed."
    experiment = "Many reversals with amplitudes below five times zs at two speeds, and slow constant speeds."
    source = (
        "Canudas de Wit, Olsson, Astrom, Lischinsky: A new model for control of systems with friction, IEEE TAC 1995"
    )
    is_composed = True
    distance = "zs"

    def parameters(self, joint_type: JointType) -> tuple[Variable, ...]:
        return (
            Variable(
                "Fz", UNITS[joint_type].torque, "parameter", 0.0, "Coulomb friction that builds up over a distance"
            ),
            Variable("Fzs", UNITS[joint_type].torque, "parameter", 0.0, "static friction above that, likewise"),
        )

    def shapes(self, joint_type: JointType) -> tuple[Variable, ...]:
        value = 0.1 if joint_type == "revolute" else 0.01
        return (
            presliding_distance(joint_type),
            Variable("vs", UNITS[joint_type].velocity, "parameter", value, "Stribeck velocity"),
            Variable("Tz", "s", "parameter", 1e-4, "damping over stiffness of the bristles"),
        )

    def search(self, joint_type: JointType) -> Mapping[str, Search]:
        lowest = 0.02 if joint_type == "revolute" else 0.001
        return {"zs": distance_search(joint_type), "vs": Search(lowest, 50 * lowest, 5)}

    def states(self, joint_type: JointType) -> tuple[Variable, ...]:
        return (deflection(joint_type),)

    def columns(self, at: Surroundings, shapes: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        build_up = (at.state[0] + shapes["Tz"] * deflection_rate(at, shapes["zs"])) / shapes["zs"]
        return (build_up, build_up * ca.exp(-((at.dq / shapes["vs"]) ** 2)))

    def rates(self, at: Surroundings, shapes: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        return (deflection_rate(at, shapes["zs"]),)

    def damping(self, parameters: Mapping[str, ca.SX], shapes: Mapping[str, ca.SX], within: OperatingRange) -> ca.SX:
        return shapes["Tz"] * self.stiffness(parameters, shapes, within)

    def stiffness(self, parameters: Mapping[str, ca.SX], shapes: Mapping[str, ca.SX], within: OperatingRange) -> ca.SX:
        return (ca.fabs(parameters["Fz"]) + ca.fabs(parameters["Fzs"])) / shapes["zs"]

    def own_rate(self, shapes: Mapping[str, ca.SX], within: OperatingRange) -> ca.SX:
        return deflection_resolution(shapes["zs"], within)

    def relaxation(self, shapes: Mapping[str, ca.SX], within: OperatingRange) -> ca.SX:
        return deflection_relaxation(shapes["zs"], within)
