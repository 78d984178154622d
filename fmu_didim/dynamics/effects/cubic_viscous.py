import casadi as ca

from fmu_didim.dynamics.effects.base import TorqueEffect
from fmu_didim.dynamics.effects.joint import OperatingRange, Parameter, Surroundings, Values
from fmu_didim.dynamics.effects.steps import CONSTANT_SPEEDS, GROWING


class CubicViscous(TorqueEffect):
    """tau_e = Fcube * dq^3, with Fcube in N.m.s3/rad3 (N.s3/m3)."""

    name = "cubic_viscous"
    title = "Cubic viscous friction"
    equation = "Fcube*dq^3"
    class_name = "nonlinear viscous"
    is_shared = True
    confounded_with = ("quadratic_viscous", "power_viscous")
    signature = "Residual odd in the velocity that is curved upwards at high speed."
    experiment = CONSTANT_SPEEDS
    source = "Olsson, Astrom, Canudas de Wit, Gafvert, Lischinsky: Friction models, Eur. J. of Control 1998"
    own_parameters = (Parameter("Fcube", ("N.m.s3/rad3", "N.s3/m3"), "cubic friction coefficient", usual=GROWING),)

    def columns(self, at: Surroundings, shapes: Values) -> tuple[ca.SX, ...]:
        return (at.dq**3,)

    def damping(self, parameters: Values, shapes: Values, within: OperatingRange) -> ca.SX:
        return 3 * ca.fabs(parameters["Fcube"]) * within.speed**2
