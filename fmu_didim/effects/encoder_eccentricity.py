"""Eccentricity of the encoder."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import casadi as ca

from fmu_didim.effects.base import UNITS, JointType, Search
from fmu_didim.effects.spliced import SplicedEffect
from fmu_didim.signals import Variable


class EncoderEccentricity(SplicedEffect):
    """y = q + eccentricity_cosine cos(N q) + eccentricity_sine sin(N q), amplitudes in rad (m), N in 1/rad (1/m).

    The controller gets y for q. A velocity that it takes from the plant stays that of the joint; one that it
    computes from y has the error of y.
    """

    name = "encoder_eccentricity"
    title = "Eccentricity of the encoder"
    equation = "q_measured = q + eccentricity_cosine*cos(N*q) + eccentricity_sine*sin(N*q)"
    place = "sensor"
    class_name = "encoder_eccentricity"
    confounded_with = ("torque_ripple",)
    signature = "Residual periodic in position, growing with the square of the velocity."
    experiment = "The same path at two speeds: a ripple of torque does not grow."
    source = "geometry of a code disc whose centre lies beside the axis, to first order"
    is_smooth = True
    neutral: ClassVar[Mapping[str, float]] = {"eccentricity_cosine": 0.0, "eccentricity_sine": 0.0}
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {
        "eccentricity_cosine": (-1.0, 1.0),
        "eccentricity_sine": (-1.0, 1.0),
        "eccentricity_number": (1.0, 1e4),
    }

    def parameters(self, joint_type: JointType) -> tuple[Variable, ...]:
        unit = UNITS[joint_type].position
        return (
            Variable("eccentricity_cosine", unit, "parameter", 0.0, "error of the encoder, cosine of N q"),
            Variable("eccentricity_sine", unit, "parameter", 0.0, "error of the encoder, sine of N q"),
        )

    def shapes(self, joint_type: JointType) -> tuple[Variable, ...]:
        unit = "1" if joint_type == "revolute" else "1/m"
        text = "periods of the encoder's error in 2 pi of position"
        return (Variable("eccentricity_number", unit, "parameter", 1.0, text),)

    def search(self, joint_type: JointType) -> Mapping[str, Search]:
        return {
            "eccentricity_cosine": Search(1e-4, 1e-2, 2),
            "eccentricity_sine": Search(1e-4, 1e-2, 2),
            "eccentricity_number": Search(1.0, 9.0, 9, logarithmic=False, cost=3.0),
        }

    def output(self, u: ca.SX, x: ca.SX, values: Mapping[str, ca.SX], step: float) -> ca.SX:
        angle = values["eccentricity_number"] * u
        cosine, sine = values["eccentricity_cosine"], values["eccentricity_sine"]
        return u + cosine * ca.cos(angle) + sine * ca.sin(angle)
