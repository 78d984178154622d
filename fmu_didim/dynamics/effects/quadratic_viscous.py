import casadi as ca

from fmu_didim.dynamics.effects.base import TorqueEffect
from fmu_didim.dynamics.effects.joint import OperatingRange, Parameter, Surroundings, Values
from fmu_didim.dynamics.effects.stated_size import of_peak
from fmu_didim.dynamics.effects.steps import CONSTANT_SPEEDS, GROWING


class QuadraticViscous(TorqueEffect):
    """tau_e = Fq * dq |dq|, with Fq in N.m.s2/rad2 (N.s2/m2): drag, churning of the lubricant."""

    name = "quadratic_viscous"
    title = "Quadratic viscous friction"
    equation = "Fq*dq*|dq|"
    class_name = "nonlinear viscous"
    is_shared = True
    confounded_with = ("cubic_viscous", "power_viscous", "stribeck", "presliding")
    signature = "Residual odd in the velocity that is curved upwards at high speed."
    experiment = CONSTANT_SPEEDS
    source = "Olsson, Astrom, Canudas de Wit, Gafvert, Lischinsky: Friction models, Eur. J. of Control 1998"
    stated = of_peak("friction quadratic in the velocity")
    own_parameters = (Parameter("Fq", ("N.m.s2/rad2", "N.s2/m2"), "quadratic friction coefficient", usual=GROWING),)

    def columns(self, at: Surroundings, shapes: Values) -> tuple[ca.SX, ...]:
        return (at.dq * ca.fabs(at.dq),)

    def damping(self, parameters: Values, shapes: Values, within: OperatingRange) -> ca.SX:
        return 2 * ca.fabs(parameters["Fq"]) * within.speed
