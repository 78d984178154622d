"""Constant torque offset."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from fmu_didim.effects.base import UNITS, JointMotion, JointType, TorqueEffect
from fmu_didim.signals import Variable


class TorqueOffset(TorqueEffect):
    """tau_e = offset, in N.m (N): bias of the current measurement or of the amplifier."""

    name = "torque_offset"
    equation = "offset"
    confounded_with = ("asymmetric_coulomb",)
    source = "Gautier, Janot, Vandanjon: DIDIM, section 2"

    def parameters(self, joint_type: JointType) -> tuple[Variable, ...]:
        return (Variable("offset", UNITS[joint_type].torque, "parameter", 0.0, "torque offset"),)

    def columns(self, motion: JointMotion, shapes: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        return (ca.SX(1),)
