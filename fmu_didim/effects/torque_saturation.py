"""Saturation of the command."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import casadi as ca

from fmu_didim.effects.base import UNITS, JointType, Search
from fmu_didim.effects.pre_check import PreCheck
from fmu_didim.effects.spliced import NO_LIMIT, SplicedEffect
from fmu_didim.signals import Variable


class TorqueSaturation(SplicedEffect):
    """tau = min(max(u, -limit), limit), with the limit in N.m (N); the torque log shows the limited command."""

    name = "torque_saturation"
    title = "Saturation of the command"
    equation = "tau = clip(command, -limit, limit)"
    place = "drive"
    class_name = "saturation"
    confounded_with = ()
    signature = "Flat tops of the measured torque at one level; the model asks for more there, less soon after."
    experiment = "A slower motion, whose torque stays below the limit."
    source = "Astrom and Wittenmark, Computer-Controlled Systems: limits of actuators"
    logged = "after"
    rank = -10
    neutral: ClassVar[Mapping[str, float]] = {"limit": NO_LIMIT}
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {"limit": (1e-6, NO_LIMIT)}
    pre_check = PreCheck("limit", (0.9, 0.95, 0.97, 0.98, 0.99, 0.995, 0.998))

    def parameters(self, joint_type: JointType) -> tuple[Variable, ...]:
        return (Variable("limit", UNITS[joint_type].torque, "parameter", NO_LIMIT, "largest torque of the drive"),)

    def search(self, joint_type: JointType) -> Mapping[str, Search]:
        return {"limit": Search(1.0, 1000.0, 13)}

    def output(self, u: ca.SX, x: ca.SX, values: Mapping[str, ca.SX], step: float) -> ca.SX:
        return ca.fmin(ca.fmax(u, -values["limit"]), values["limit"])
