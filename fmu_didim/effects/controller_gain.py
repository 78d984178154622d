"""Error of the controller's gain."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import casadi as ca

from fmu_didim.effects.base import JointType, Search
from fmu_didim.effects.spliced import SplicedEffect
from fmu_didim.signals import Variable


class ControllerGain(SplicedEffect):
    """tau = controller_gain * u: all gains of the joint's controller are wrong by one factor.

    The torque log shows the command itself, after it: the plant is driven by what is logged.
    """

    name = "controller_gain"
    title = "Gain of the controller"
    equation = "command = controller_gain*u"
    place = "drive"
    class_name = "controller_gain"
    confounded_with = ("actuator_lag", "joint_elasticity")
    signature = "A residual at the frequencies where tracking is loose; none in slow motion."
    experiment = "Logged positions: the command against the tracking error."
    source = "Gautier, Janot, Vandanjon: DIDIM, section on errors of the controller's gains"
    logged = "after"
    rank = -20
    neutral: ClassVar[Mapping[str, float]] = {"controller_gain": 1.0}
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {"controller_gain": (0.05, 20.0)}

    def parameters(self, joint_type: JointType) -> tuple[Variable, ...]:
        return (Variable("controller_gain", "1", "parameter", 1.0, "true gain per assumed gain"),)

    def search(self, joint_type: JointType) -> Mapping[str, Search]:
        return {"controller_gain": Search(0.5, 2.0, 7)}

    def output(self, u: ca.SX, x: ca.SX, values: Mapping[str, ca.SX], step: float) -> ca.SX:
        return values["controller_gain"] * u
