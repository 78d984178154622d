from collections.abc import Mapping

import casadi as ca

from fmu_didim.dynamics.effects.base import TorqueEffect
from fmu_didim.dynamics.effects.joint import OperatingRange, Parameter, Surroundings, Values
from fmu_didim.dynamics.effects.motor import Harmonic, Motor
from fmu_didim.dynamics.effects.torque_ripple import ripple_frequency


class CurrentRipple(TorqueEffect):
    """tau_e = load (Ksin sin(nr q) + Kcos cos(nr q)); Ksin and Kcos are numbers, nr as for ``torque_ripple``.

    Errors of commutation give such a ripple; the transmitted torque stands for the current.
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
    own_parameters = (
        Parameter("Ksin", "1", "sine part of the ripple per torque"),
        Parameter("Kcos", "1", "cosine part of the ripple per torque"),
    )
    own_shapes = (ripple_frequency,)
    frequency = "nr"

    def harmonics(self, motor: Motor) -> Mapping[str, tuple[Harmonic, ...]]:
        return {"nr": motor.ripples()}

    def columns(self, at: Surroundings, shapes: Values) -> tuple[ca.SX, ...]:
        return (at.load * ca.sin(shapes["nr"] * at.q), at.load * ca.cos(shapes["nr"] * at.q))

    def stiffness(self, parameters: Values, shapes: Values, within: OperatingRange) -> ca.SX:
        size = ca.sqrt(parameters["Ksin"] ** 2 + parameters["Kcos"] ** 2)
        return shapes["nr"] * size * within.load
