from collections.abc import Mapping

import casadi as ca

from fmu_didim.dynamics.effects.base import TorqueEffect
from fmu_didim.dynamics.effects.joint import OperatingRange, Parameter, Search, Surroundings, Values
from fmu_didim.dynamics.effects.motor import Harmonic, Motor

ripple_frequency = Parameter(
    "nr", ("1", "rad/m"), "ripples in a turn of the joint, or phase per length", (6.0, 300.0),
    search=(
        Search(6, 120, 115, logarithmic=False, cost=3.0),
        Search(20, 3000, 150, logarithmic=False, cost=3.0),
    ),
)  # fmt: skip
"""Effects of a joint share it. Every whole number for a turn from 6 is searched; what is slower looks like gravity."""


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
    own_parameters = (
        Parameter("Rsin", "torque", "sine part of the ripple"),
        Parameter("Rcos", "torque", "cosine part of the ripple"),
    )
    own_shapes = (ripple_frequency,)
    frequency = "nr"

    def harmonics(self, motor: Motor) -> Mapping[str, tuple[Harmonic, ...]]:
        return {"nr": motor.ripples()}

    def columns(self, at: Surroundings, shapes: Values) -> tuple[ca.SX, ...]:
        return (ca.sin(shapes["nr"] * at.q), ca.cos(shapes["nr"] * at.q))

    def stiffness(self, parameters: Values, shapes: Values, within: OperatingRange) -> ca.SX:
        return shapes["nr"] * ca.sqrt(parameters["Rsin"] ** 2 + parameters["Rcos"] ** 2)
