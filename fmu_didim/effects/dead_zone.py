"""Dead zone of the drive."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import casadi as ca

from fmu_didim.effects.base import UNITS, JointType, Search
from fmu_didim.effects.first_order import FirstOrder, torque_sign
from fmu_didim.effects.spliced import NO_LIMIT, SplicedEffect
from fmu_didim.signals import Variable

ROUNDING = 0.05
"""Radius of the rounded corners, as a fraction of the width."""


class DeadZone(SplicedEffect):
    """tau = u - clip(u, -d, d), with the half width d = dead_zone in N.m (N) and slightly rounded corners:

    clip(u, -d, d) ~ (sqrt((u + d)^2 + e^2) - sqrt((u - d)^2 + e^2)) / 2,    e = 0.05 d
    """

    name = "dead_zone"
    title = "Dead zone of the drive"
    equation = "tau = sign(command)*max(0, |command| - dead_zone)"
    place = "drive"
    class_name = "dead_zone"
    confounded_with = ("contact_stop", "spring", "drive_gain")
    signature = "Steps of the residual where the torque, not the velocity, changes its sign."
    experiment = "Motions whose torque changes its sign at many velocities."
    source = "Tao and Kokotovic, Adaptive Control of Systems with Actuator and Sensor Nonlinearities, 1996, ch. 2"
    rank = 20
    neutral: ClassVar[Mapping[str, float]] = {"dead_zone": 0.0}
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {"dead_zone": (0.0, NO_LIMIT)}
    first_order = FirstOrder("torque", torque_sign)

    def parameters(self, joint_type: JointType) -> tuple[Variable, ...]:
        unit = UNITS[joint_type].torque
        return (Variable("dead_zone", unit, "parameter", 0.0, "half width of the drive's dead zone"),)

    def search(self, joint_type: JointType) -> Mapping[str, Search]:
        return {"dead_zone": Search(0.03, 10.0, 6)}

    def output(self, u: ca.SX, x: ca.SX, values: Mapping[str, ca.SX], step: float) -> ca.SX:
        width = values["dead_zone"]
        square = (ROUNDING * width) ** 2 + 1e-24  # so that the root has a slope without a dead zone, too
        return u - (ca.sqrt((u + width) ** 2 + square) - ca.sqrt((u - width) ** 2 + square)) / 2
