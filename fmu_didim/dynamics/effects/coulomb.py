import casadi as ca

from fmu_didim.dynamics.effects.base import TorqueEffect
from fmu_didim.dynamics.effects.joint import OperatingRange, Parameter, Search, Surroundings, Values
from fmu_didim.dynamics.effects.steps import direction, smoothing_velocity


class Coulomb(TorqueEffect):
    """tau_e = Fc * s(dq), s(dq) = tanh(dq/v0), with Fc in N.m (N); the smoothing velocity v0 in rad/s (m/s) is a shape.

    The slope Fc/v0 at rest is a stiffness of the direct model: Fc/(v0 J) is a rate in 1/s that the
    integration must resolve.
    """

    name = "coulomb"
    title = "Coulomb friction"
    equation = "Fc*tanh(dq/v0)"
    confounded_with = ("stribeck", "presliding", "power_viscous")
    signature = "Residual that jumps when the velocity changes its sign."
    experiment = "Constant speeds in both directions; slow ones tell the smoothing from Stribeck friction."
    source = "Gautier, Janot, Vandanjon: DIDIM, section 2; smoothing as in BIRDy (Leboutet et al. 2021)"
    is_base = True
    sets_ticks = True
    own_parameters = (Parameter("Fc", "torque", "Coulomb friction"),)
    own_shapes = (smoothing_velocity.searched((Search(0.002, 0.2, 9), Search(0.0002, 0.02, 9))),)

    def columns(self, at: Surroundings, shapes: Values) -> tuple[ca.SX, ...]:
        return (direction(at, shapes),)

    def damping(self, parameters: Values, shapes: Values, within: OperatingRange) -> ca.SX:
        return ca.fabs(parameters["Fc"]) / shapes["v0"]
