"""Stribeck friction."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from fmu_didim.effects.base import UNITS, JointType, OperatingRange, Search, Surroundings, TorqueEffect
from fmu_didim.effects.steps import direction, smoothing_velocity
from fmu_didim.signals import Variable


class Stribeck(TorqueEffect):
    """tau_e = Fs * s(dq) exp(-(dq/vs)^2), s(dq) = tanh(dq/v0): Fs in N.m (N) is static minus Coulomb friction."""

    name = "stribeck"
    title = "Stribeck friction"
    equation = "Fs*tanh(dq/v0)*exp(-(dq/vs)^2)"
    class_name = "stribeck"
    confounded_with = ("coulomb", "presliding", "lugre", "power_viscous", "quadratic_viscous")
    signature = "Residual in a pair of spikes of opposite sign at every reversal, within three times the velocity vs."
    experiment = "Slow constant speeds in both directions, down to a third of vs; reversals at two accelerations."
    source = (
        "Armstrong-Helouvry, Dupont, Canudas de Wit: A survey of models, Automatica 1994; Bittencourt, Wernholt, "
        "Sander-Tavallaey, Brogardh: An extended friction model, IROS 2010"
    )

    def parameters(self, joint_type: JointType) -> tuple[Variable, ...]:
        return (Variable("Fs", UNITS[joint_type].torque, "parameter", 0.0, "static friction above Coulomb friction"),)

    def shapes(self, joint_type: JointType) -> tuple[Variable, ...]:
        value = 0.1 if joint_type == "revolute" else 0.01
        return (
            smoothing_velocity(joint_type),
            Variable("vs", UNITS[joint_type].velocity, "parameter", value, "Stribeck velocity"),
        )

    def search(self, joint_type: JointType) -> Mapping[str, Search]:
        lowest = 0.02 if joint_type == "revolute" else 0.001
        return {"vs": Search(lowest, 50 * lowest, 9)}

    def columns(self, at: Surroundings, shapes: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        return (direction(at, shapes) * ca.exp(-((at.dq / shapes["vs"]) ** 2)),)

    def damping(self, parameters: Mapping[str, ca.SX], shapes: Mapping[str, ca.SX], within: OperatingRange) -> ca.SX:
        return ca.fabs(parameters["Fs"]) / shapes["v0"]
