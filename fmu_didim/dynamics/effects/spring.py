import casadi as ca

from fmu_didim.dynamics.effects.base import TorqueEffect
from fmu_didim.dynamics.effects.joint import OperatingRange, Parameter, Surroundings, Values
from fmu_didim.dynamics.effects.stated_size import of_peak


class Spring(TorqueEffect):
    """tau_e = k q, with k in N.m/rad (N/m). A rest position q0 adds the constant -k q0: a ``torque_offset``."""

    name = "spring"
    title = "Spring or cable stiffness"
    equation = "k*q"
    class_name = "position-dependent load"
    confounded_with = ("cubic_spring", "gravity_compensator", "torque_offset", "contact_stop", "contact_stop_lower")
    signature = "Residual that grows with the position and does not depend on speed; gravity absorbs most of it."
    experiment = "A wide range of positions, or the same path with another payload or orientation of the base."
    source = "Khalil and Dombre, Modeling, Identification and Control of Robots"
    acts_on_link = True
    rest = "torque_offset"
    stated = of_peak("a spring")
    own_parameters = (Parameter("k", "stiffness", "stiffness", least=0.0),)

    def columns(self, at: Surroundings, shapes: Values) -> tuple[ca.SX, ...]:
        return (at.q,)

    def stiffness(self, parameters: Values, shapes: Values, within: OperatingRange) -> ca.SX:
        return ca.fabs(parameters["k"])
