"""Torque ripple that follows the torque, as by errors of commutation."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from fmu_didim.effects.base import JointType, OperatingRange, Search, Surroundings, TorqueEffect
from fmu_didim.effects.torque_ripple import ripple_frequency, ripple_search
from fmu_didim.signals import Variable


class CurrentRipple(TorqueEffect):
    """tau_e = load (Ksin sin(nr q) + Kcos cos(nr q)); Ksin and Kcos are numbers, nr as for ``torque_ripple``.

    The transmitted torque stands for the current.
    """

    name = "current_ripple"
    title = "Torque ripple in proportion to the torque"
    equation = "load*(Ksin*sin(nr*q) + Kcos*cos(nr*q))"
    class_name = "ripple"
    confounded_with = ("torque_ripple",)
    signature = "Residual that repeats along the joint at a short distance and grows with the torque."
    experiment = "The same path with two payloads: cogging keeps its size, current ripple follows the torque."
    source = (
        "Holtz and Springob: Identification and compensation of torque ripple in high-precision permanent magnet "
        "motor drives, IEEE TIE 1996"
    )
    needs = frozenset({"load"})

    def parameters(self, joint_type: JointType) -> tuple[Variable, ...]:
        return (
            Variable("Ksin", "1", "parameter", 0.0, "sine part of the ripple per torque"),
            Variable("Kcos", "1", "parameter", 0.0, "cosine part of the ripple per torque"),
        )

    def shapes(self, joint_type: JointType) -> tuple[Variable, ...]:
        return (ripple_frequency(joint_type),)

    def search(self, joint_type: JointType) -> Mapping[str, Search]:
        return {"nr": ripple_search(joint_type)}

    def columns(self, at: Surroundings, shapes: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        return (at.load * ca.sin(shapes["nr"] * at.q), at.load * ca.cos(shapes["nr"] * at.q))

    def stiffness(self, parameters: Mapping[str, ca.SX], shapes: Mapping[str, ca.SX], within: OperatingRange) -> ca.SX:
        size = ca.sqrt(parameters["Ksin"] ** 2 + parameters["Kcos"] ** 2)
        return shapes["nr"] * size * within.load
