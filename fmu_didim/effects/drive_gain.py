"""Error of the drive's gain."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import casadi as ca

from fmu_didim.effects.base import JointType, Search
from fmu_didim.effects.first_order import FirstOrder, torque_less
from fmu_didim.effects.spliced import SplicedEffect
from fmu_didim.signals import Variable


class DriveGain(SplicedEffect):
    """tau = drive_gain * u: a wrong torque constant or gear ratio; the torque log shows u.

    On a joint without coupling to others it scales all parameters of the row alike and cannot be seen.
    """

    name = "drive_gain"
    title = "Gain of the drive"
    equation = "tau = drive_gain*command"
    place = "drive"
    class_name = "drive_gain"
    confounded_with = ("dead_zone", "payload_change")
    signature = "All torques of the joint scaled; visible only in what coupled joints share."
    experiment = "A known payload, or the same motion with and without it."
    source = "Gautier and Briot, New method for global identification of the joint drive gains, IROS 2011"
    rank = 10
    neutral: ClassVar[Mapping[str, float]] = {"drive_gain": 1.0}
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {"drive_gain": (0.05, 20.0)}
    first_order = FirstOrder("torque", torque_less)

    def parameters(self, joint_type: JointType) -> tuple[Variable, ...]:
        return (Variable("drive_gain", "1", "parameter", 1.0, "torque per torque asked for"),)

    def search(self, joint_type: JointType) -> Mapping[str, Search]:
        return {"drive_gain": Search(0.8, 1.25, 5)}

    def output(self, u: ca.SX, x: ca.SX, values: Mapping[str, ca.SX], step: float) -> ca.SX:
        return values["drive_gain"] * u
