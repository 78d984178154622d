import math
from collections.abc import Mapping

import casadi as ca

from fmu_didim.dynamics.effects.base import TorqueEffect
from fmu_didim.dynamics.effects.joint import OperatingRange, Parameter, Search, Surroundings, Values
from fmu_didim.dynamics.effects.steps import ramp

contact_positions = (Search(-3.0, 3.0, 31, logarithmic=False), Search(-0.5, 0.5, 31, logarithmic=False))
contact_width = Parameter("wstop", "position", "half the width in which contact is made", (0.005, 0.0005))
"""Both stops share these."""


class ContactStop(TorqueEffect):
    """tau_e = kupper max(0, q - qupper), smoothed within wstop of the contact; kupper in N.m/rad (N/m)."""

    name = "contact_stop"
    title = "Contact with the upper stop"
    equation = "kupper*max(0, q - qupper)"
    class_name = "position-dependent load"
    confounded_with = ("spring", "cubic_spring", "torque_offset", "contact_stop_lower")
    signature = "Residual beyond one position only, whatever the speed."
    experiment = "Paths that end on either side of the position where the contact starts."
    source = "Gilardi and Sharf: Literature survey of contact dynamics modelling, Mechanism and Machine Theory 2002"
    signed = frozenset({"qupper"})
    acts_on_link = True
    stands_for = ("spring", "torque_offset")
    own_parameters = (Parameter("kupper", "stiffness", "stiffness of the contact", least=0.0),)
    own_shapes = (
        Parameter("qupper", "position", "position where the contact starts", (1.0, 0.1), search=contact_positions),
        contact_width,
    )

    def acts_between(self, shapes: Mapping[str, float]) -> tuple[float, float]:
        return shapes.get("qupper", math.inf), math.inf

    def columns(self, at: Surroundings, shapes: Values) -> tuple[ca.SX, ...]:
        return (ramp(at.q - shapes["qupper"], shapes["wstop"]),)

    def stiffness(self, parameters: Values, shapes: Values, within: OperatingRange) -> ca.SX:
        return ca.fabs(parameters["kupper"])
