"""Constant torque offset."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from fmu_didim.effects.base import UNITS, JointType, Surroundings, TorqueEffect
from fmu_didim.signals import Variable


class TorqueOffset(TorqueEffect):
    """tau_e = offset, in N.m (N): bias of the current measurement or of the amplifier."""

    name = "torque_offset"
    title = "Torque offset"
    equation = "offset"
    class_name = "offset"
    confounded_with = ("asymmetric_coulomb", "spring")
    signature = "Residual with the same mean in both directions of motion and at all positions."
    experiment = (
        "Hold the joint at rest at several positions: an offset stays, Coulomb friction of either direction does not."
    )
    source = "Gautier, Janot, Vandanjon: DIDIM, section 2"

    def parameters(self, joint_type: JointType) -> tuple[Variable, ...]:
        return (Variable("offset", UNITS[joint_type].torque, "parameter", 0.0, "torque offset"),)

    def columns(self, at: Surroundings, shapes: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        return (ca.SX(1),)
