import casadi as ca

from fmu_didim.dynamics.effects.base import TorqueEffect
from fmu_didim.dynamics.effects.joint import OperatingRange, Parameter, Surroundings, Values
from fmu_didim.dynamics.effects.steps import CONSTANT_SPEEDS


class Viscous(TorqueEffect):
    """tau_e = Fv * dq, with Fv in N.m.s/rad (revolute) or N.s/m (prismatic)."""

    name = "viscous"
    title = "Viscous friction"
    equation = "Fv*dq"
    signature = "Residual in proportion to the velocity."
    experiment = CONSTANT_SPEEDS
    source = "Gautier, Janot, Vandanjon: DIDIM, section 2"
    is_base = True
    own_parameters = (Parameter("Fv", "viscous", "viscous friction coefficient"),)

    def columns(self, at: Surroundings, shapes: Values) -> tuple[ca.SX, ...]:
        return (at.dq,)

    def damping(self, parameters: Values, shapes: Values, within: OperatingRange) -> ca.SX:
        return ca.fabs(parameters["Fv"])
