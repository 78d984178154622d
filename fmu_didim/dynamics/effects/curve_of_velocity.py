import casadi as ca

from fmu_didim.dynamics.effects.curve import Curve, curve_ends, curve_parameters
from fmu_didim.dynamics.effects.joint import OperatingRange, Surroundings, Values


class CurveOfVelocity(Curve):
    """tau_e = c(dq), a smooth curve of the velocity of the joint.

    See :class:`fmu_didim.dynamics.effects.curve.Curve`.
    """

    name = "curve_of_velocity"
    title = "Torque that is a curve of the velocity"
    equation = "c(dq), cubic splines from vfrom to vto"
    confounded_with = ("stribeck", "quadratic_viscous", "cubic_viscous", "power_viscous", "asymmetric_viscous")
    experiment = "Constant speeds in both directions."
    symbol = "v"
    variable = "the velocity of the joint"
    signed = frozenset({"vfrom", "vto"})
    own_parameters = curve_parameters("v")
    own_shapes = curve_ends("v", "velocity", -1.0, 1.0)

    def along(self, at: Surroundings, shapes: Values) -> ca.SX:
        return at.dq

    def damping(self, parameters: Values, shapes: Values, within: OperatingRange) -> ca.SX:
        return self.steepest(parameters, shapes)
