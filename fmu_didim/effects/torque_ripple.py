"""Cogging and torque ripple of the motor."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from fmu_didim.effects.base import UNITS, JointType, OperatingRange, Search, Surroundings, TorqueEffect
from fmu_didim.signals import Variable


def ripple_frequency(joint_type: JointType) -> Variable:
    """The shape ``nr``; all effects of a joint share it."""
    unit, value = ("1", 6.0) if joint_type == "revolute" else ("rad/m", 300.0)
    return Variable("nr", unit, "parameter", value, "ripples in a turn of the joint, or phase per length")


def ripple_search(joint_type: JointType) -> Search:
    """Values of ``nr`` to search: every whole number for a turn from 6; what is slower looks like gravity."""
    if joint_type == "revolute":
        return Search(6, 120, 115, logarithmic=False, cost=3.0)
    return Search(20, 3000, 150, logarithmic=False, cost=3.0)


class TorqueRipple(TorqueEffect):
    """tau_e = Rsin sin(nr q) + Rcos cos(nr q), with the spatial frequency nr in 1 (rad/m for a slide).

    Amplitudes in N.m (N). nr is the number of ripples in a turn of the joint: gear ratio times poles or slots.
    """

    name = "torque_ripple"
    title = "Torque ripple (cogging)"
    equation = "Rsin*sin(nr*q) + Rcos*cos(nr*q)"
    class_name = "ripple"
    confounded_with = ("current_ripple",)
    signature = "Residual that repeats along the joint at a short distance, at the same places at any speed."
    experiment = (
        "The same path at two speeds and with two payloads: cogging keeps its size, current ripple follows the torque."
    )
    source = "Gieras: Permanent magnet motor technology, chapter on cogging torque"

    def parameters(self, joint_type: JointType) -> tuple[Variable, ...]:
        return (
            Variable("Rsin", UNITS[joint_type].torque, "parameter", 0.0, "sine part of the ripple"),
            Variable("Rcos", UNITS[joint_type].torque, "parameter", 0.0, "cosine part of the ripple"),
        )

    def shapes(self, joint_type: JointType) -> tuple[Variable, ...]:
        return (ripple_frequency(joint_type),)

    def search(self, joint_type: JointType) -> Mapping[str, Search]:
        return {"nr": ripple_search(joint_type)}

    def columns(self, at: Surroundings, shapes: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        return (ca.sin(shapes["nr"] * at.q), ca.cos(shapes["nr"] * at.q))

    def stiffness(self, parameters: Mapping[str, ca.SX], shapes: Mapping[str, ca.SX], within: OperatingRange) -> ca.SX:
        return shapes["nr"] * ca.sqrt(parameters["Rsin"] ** 2 + parameters["Rcos"] ** 2)
