"""Gear losses that differ between driving and being driven."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from fmu_didim.effects.base import JointType, OperatingRange, Surroundings, TorqueEffect
from fmu_didim.effects.steps import direction, smoothing_velocity
from fmu_didim.signals import Variable


class DirectionalEfficiency(TorqueEffect):
    """tau_e = Fldrive (|load| s + load s^2)/2 + Flback (|load| s - load s^2)/2, s = tanh(dq/v0).

    The first column acts while the motor drives the load (load dq > 0), the second while the load drives the
    motor; each is |load| sign(dq) there. With the efficiency eta of a gear, Fldrive = 1/eta - 1, Flback = 1 - eta.
    """

    name = "directional_efficiency"
    title = "Gear efficiency by direction of power"
    equation = "|load|*tanh(dq/v0)*(Fldrive if load*dq > 0 else Flback)"
    class_name = "load_dependent_friction"
    confounded_with = ("load_dependent_friction",)
    signature = "Residual in proportion to the load, of another size when the motor brakes than when it drives."
    experiment = "The same path with two payloads, lifting and lowering at constant speed."
    source = (
        "Duclusaud, Passault, Padois, Ly: Extended friction models for the physics simulation of servo actuators, 2024"
    )
    needs = frozenset({"load"})

    def parameters(self, joint_type: JointType) -> tuple[Variable, ...]:
        return (
            Variable("Fldrive", "1", "parameter", 0.0, "loss per transmitted torque while the motor drives"),
            Variable("Flback", "1", "parameter", 0.0, "loss per transmitted torque while the load drives"),
        )

    def shapes(self, joint_type: JointType) -> tuple[Variable, ...]:
        return (smoothing_velocity(joint_type),)

    def columns(self, at: Surroundings, shapes: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        step = direction(at, shapes)
        loss, gain = ca.fabs(at.load) * step / 2, at.load * step**2 / 2
        return (loss + gain, loss - gain)

    def damping(self, parameters: Mapping[str, ca.SX], shapes: Mapping[str, ca.SX], within: OperatingRange) -> ca.SX:
        return (ca.fabs(parameters["Fldrive"]) + ca.fabs(parameters["Flback"])) * 0.9 * within.load / shapes["v0"]
