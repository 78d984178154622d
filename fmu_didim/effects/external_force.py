"""Torque from outside during part of the run."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from fmu_didim.effects.base import UNITS, JointType, OperatingRange, Search, Surroundings, TorqueEffect
from fmu_didim.effects.steps import rise
from fmu_didim.signals import Variable


class ExternalForce(TorqueEffect):
    """tau_e = Fext (r(t; t_on) - r(t; t_off)), a step up at t_on and down at t_off, each about w_edge wide.

    r(t; t1) = (1 + tanh((t - t1)/w_edge))/2 with the time t of the loop in s. Fext in N.m (N) is the torque that
    the drive must supply against the outside.
    """

    name = "external_force"
    title = "External force for a while"
    equation = "Fext*(t_on < t < t_off)"
    class_name = "external_force"
    confounded_with = ("payload_change",)
    signature = "Residual within one interval of time that does not come back when the path is repeated."
    experiment = "Repeat the path."
    source = "De Luca, Mattone: Sensorless robot collision detection and hybrid force/motion control, ICRA 2005"
    needs = frozenset({"time"})
    signed = frozenset({"t_on", "t_off"})
    acts_on_link = True
    is_external = True

    def parameters(self, joint_type: JointType) -> tuple[Variable, ...]:
        return (Variable("Fext", UNITS[joint_type].torque, "parameter", 0.0, "torque against the outside"),)

    def shapes(self, joint_type: JointType) -> tuple[Variable, ...]:
        return (
            Variable("t_on", "s", "parameter", 1.0, "beginning of the force"),
            Variable("t_off", "s", "parameter", 2.0, "end of the force"),
            Variable("w_edge", "s", "parameter", 0.02, "width of the edges"),
        )

    def search(self, joint_type: JointType) -> Mapping[str, Search]:
        times = Search(0.0, 60.0, 121, logarithmic=False)
        return {"t_on": times, "t_off": times}

    def allows(self, shapes: Mapping[str, float]) -> bool:
        return shapes["t_off"] > shapes["t_on"]

    def columns(self, at: Surroundings, shapes: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        width = shapes["w_edge"]
        return (rise(at.time, shapes["t_on"], width) - rise(at.time, shapes["t_off"], width),)

    def own_rate(self, shapes: Mapping[str, ca.SX], within: OperatingRange) -> ca.SX:
        return 1 / shapes["w_edge"]
