import casadi as ca

from fmu_didim.dynamics.effects.base import TorqueEffect
from fmu_didim.dynamics.effects.joint import OperatingRange, Parameter, Surroundings, Values
from fmu_didim.dynamics.effects.steps import CONSTANT_SPEEDS


class AsymmetricViscous(TorqueEffect):
    """tau_e = Fva * |dq|: viscous friction Fv + Fva forwards and Fv - Fva backwards, in N.m.s/rad (N.s/m)."""

    name = "asymmetric_viscous"
    title = "Asymmetric viscous friction"
    equation = "Fva*|dq|"
    confounded_with = ("quadratic_viscous",)
    signature = "Residual even in the velocity that grows with speed and is zero at rest."
    experiment = CONSTANT_SPEEDS
    source = "Janot, Gautier, Brunot: Data set and reference models of EMPS, 2019"
    own_parameters = (Parameter("Fva", "viscous", "half the difference of viscous friction between the directions"),)

    def columns(self, at: Surroundings, shapes: Values) -> tuple[ca.SX, ...]:
        return (ca.fabs(at.dq),)

    def damping(self, parameters: Values, shapes: Values, within: OperatingRange) -> ca.SX:
        return ca.fabs(parameters["Fva"])
