import casadi as ca

from fmu_didim.dynamics.effects.base import TorqueEffect
from fmu_didim.dynamics.effects.joint import OperatingRange, Parameter, Surroundings, Values
from fmu_didim.dynamics.effects.steps import direction, smoothing_velocity


class AsymmetricCoulomb(TorqueEffect):
    """tau_e = Fca * s(dq)^2, s(dq) = tanh(dq/v0): friction Fc + Fca forwards and Fc - Fca backwards.

    Fca = (Fc+ - Fc-)/2 in N.m (N). While the joint moves this is a torque offset; only at rest it vanishes.
    """

    name = "asymmetric_coulomb"
    title = "Asymmetric Coulomb friction"
    equation = "Fca*tanh(dq/v0)^2"
    class_name = "offset"
    confounded_with = ("torque_offset",)
    signature = "Residual with the same mean in both directions of motion."
    experiment = "Hold the joint at rest at several positions: this friction vanishes there, an offset stays."
    source = "Janot, Gautier, Brunot: Data set and reference models of EMPS, 2019"
    own_parameters = (Parameter("Fca", "torque", "half the difference of Coulomb friction between the directions"),)
    own_shapes = (smoothing_velocity,)

    def columns(self, at: Surroundings, shapes: Values) -> tuple[ca.SX, ...]:
        return (direction(at, shapes) ** 2,)

    def damping(self, parameters: Values, shapes: Values, within: OperatingRange) -> ca.SX:
        # The largest slope of tanh^2 is 4/(3 sqrt 3).
        return 0.77 * ca.fabs(parameters["Fca"]) / shapes["v0"]
