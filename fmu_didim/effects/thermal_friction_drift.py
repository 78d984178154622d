"""Friction that changes while the drive warms up."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from fmu_didim.effects.base import UNITS, JointType, OperatingRange, Search, Surroundings, TorqueEffect
from fmu_didim.effects.steps import direction, smoothing_velocity
from fmu_didim.signals import Variable


class ThermalFrictionDrift(TorqueEffect):
    """tau_e = (1 - exp(-t/Theat)) (Fvt dq + Fct s(dq)), s(dq) = tanh(dq/v0): change of friction from cold to warm.

    Fvt in N.m.s/rad (N.s/m), Fct in N.m (N), both negative where friction falls; t is the time of the loop, Theat the
    time constant of warming in s.
    """

    name = "thermal_friction_drift"
    title = "Drift of friction by warming"
    equation = "(1 - exp(-t/Theat))*(Fvt*dq + Fct*tanh(dq/v0))"
    class_name = "thermal_friction_drift"
    confounded_with = ("torque_drift",)
    signature = "Residual in the shape of friction that differs between the first and the last period of the same path."
    experiment = "Repeat the path many times from cold, and once more after a pause."
    source = (
        "Simoni, Beschi, Legnani, Visioli: Friction modeling with temperature effects for industrial robot "
        "manipulators, IROS 2015"
    )
    needs = frozenset({"time"})

    def parameters(self, joint_type: JointType) -> tuple[Variable, ...]:
        return (
            Variable("Fvt", UNITS[joint_type].viscous, "parameter", 0.0, "change of viscous friction when warm"),
            Variable("Fct", UNITS[joint_type].torque, "parameter", 0.0, "change of Coulomb friction when warm"),
        )

    def shapes(self, joint_type: JointType) -> tuple[Variable, ...]:
        return (
            smoothing_velocity(joint_type),
            Variable("Theat", "s", "parameter", 20.0, "time constant of warming"),
        )

    def search(self, joint_type: JointType) -> Mapping[str, Search]:
        return {"Theat": Search(1.0, 300.0, 8)}

    def columns(self, at: Surroundings, shapes: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        warm = 1 - ca.exp(-at.time / shapes["Theat"])
        return (warm * at.dq, warm * direction(at, shapes))

    def damping(self, parameters: Mapping[str, ca.SX], shapes: Mapping[str, ca.SX], within: OperatingRange) -> ca.SX:
        # Where friction falls, as it mostly does, cold friction is the stiffer one.
        return ca.fmax(parameters["Fvt"], 0) + ca.fmax(parameters["Fct"], 0) / shapes["v0"]
