import casadi as ca

from fmu_didim.dynamics.effects.base import TorqueEffect
from fmu_didim.dynamics.effects.joint import OperatingRange, Parameter, Search, Surroundings, Values
from fmu_didim.dynamics.effects.steps import CONSTANT_SPEEDS, GROWING, smoothing_velocity


class PowerViscous(TorqueEffect):
    """tau_e = Fp * dq (dq^2 + v0^2)^((alpha - 1)/2), close to Fp sign(dq) |dq|^alpha above the smoothing velocity v0.

    Fp is the friction in N.m (N) at a speed of 1 rad/s (m/s). alpha < 1 is shear thinning; alpha = 1 is viscous.
    """

    name = "power_viscous"
    title = "Friction by a power of the velocity"
    equation = "Fp*sign(dq)*|dq|^alpha"
    class_name = "nonlinear viscous"
    is_shared = True
    confounded_with = ("quadratic_viscous", "cubic_viscous", "stribeck", "coulomb")
    signature = "Residual odd in the velocity, curved downwards (alpha < 1) or upwards (alpha > 1)."
    experiment = CONSTANT_SPEEDS
    source = "Olsson, Astrom, Canudas de Wit, Gafvert, Lischinsky: Friction models, Eur. J. of Control 1998"
    own_parameters = (Parameter("Fp", "torque", "friction at unit speed", usual=GROWING),)
    own_shapes = (
        smoothing_velocity,
        Parameter("alpha", "1", "exponent of the velocity", 0.5, search=Search(0.4, 2.5, 15, logarithmic=False)),
    )

    def columns(self, at: Surroundings, shapes: Values) -> tuple[ca.SX, ...]:
        return (at.dq * (at.dq**2 + shapes["v0"] ** 2) ** ((shapes["alpha"] - 1) / 2),)

    def damping(self, parameters: Values, shapes: Values, within: OperatingRange) -> ca.SX:
        # The slope is largest at rest for alpha < 1 and at high speed for alpha > 1.
        power, slow = shapes["alpha"] - 1, shapes["v0"]
        return ca.fabs(parameters["Fp"]) * ca.fmax(
            slow**power, shapes["alpha"] * (within.speed**2 + slow**2) ** (power / 2)
        )
