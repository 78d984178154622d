import math
from collections.abc import Mapping

import casadi as ca

from fmu_didim.dynamics.effects.base import TorqueEffect
from fmu_didim.dynamics.effects.contact_stop import contact_positions, contact_width
from fmu_didim.dynamics.effects.joint import OperatingRange, Parameter, Surroundings, Values
from fmu_didim.dynamics.effects.steps import ramp


class ContactStopLower(TorqueEffect):
    """tau_e = -klower max(0, qlower - q), smoothed within wstop of the contact; klower in N.m/rad (N/m)."""

    name = "contact_stop_lower"
    title = "Contact with the lower stop"
    equation = "-klower*max(0, qlower - q)"
    class_name = "position-dependent load"
    confounded_with = ("spring", "cubic_spring", "torque_offset", "contact_stop")
    signature = "Residual below one position only, whatever the speed."
    experiment = "Paths that end on either side of the position where the contact starts."
    source = "Gilardi and Sharf: Literature survey of contact dynamics modelling, Mechanism and Machine Theory 2002"
    signed = frozenset({"qlower"})
    acts_on_link = True
    stands_for = ("spring", "torque_offset")
    own_parameters = (Parameter("klower", "stiffness", "stiffness of the contact", least=0.0),)
    own_shapes = (
        Parameter("qlower", "position", "position where the contact starts", (-1.0, -0.1), search=contact_positions),
        contact_width,
    )

    def acts_between(self, shapes: Mapping[str, float]) -> tuple[float, float]:
        return -math.inf, shapes.get("qlower", -math.inf)

    def columns(self, at: Surroundings, shapes: Values) -> tuple[ca.SX, ...]:
        return (-ramp(shapes["qlower"] - at.q, shapes["wstop"]),)

    def stiffness(self, parameters: Values, shapes: Values, within: OperatingRange) -> ca.SX:
        return ca.fabs(parameters["klower"])
