import casadi as ca

from fmu_didim.dynamics.effects.curve import Curve, curve_ends, curve_parameters
from fmu_didim.dynamics.effects.joint import OperatingRange, Surroundings, Values


class CurveOfPosition(Curve):
    """tau_e = c(q), a smooth curve of the position of the joint.

    See :class:`fmu_didim.dynamics.effects.curve.Curve`.
    """

    name = "curve_of_position"
    title = "Torque that is a curve of the position"
    equation = "c(q), cubic splines from xfrom to xto"
    confounded_with = ("spring", "cubic_spring", "gravity_compensator", "contact_stop", "contact_stop_lower")
    experiment = "The whole range of positions, at several speeds."
    symbol = "x"
    variable = "the position of the joint"
    acts_on_link = True
    signed = frozenset({"xfrom", "xto"})
    own_parameters = curve_parameters("x")
    own_shapes = curve_ends("x", "position", -1.0, 1.0)

    def along(self, at: Surroundings, shapes: Values) -> ca.SX:
        return at.q

    def stiffness(self, parameters: Values, shapes: Values, within: OperatingRange) -> ca.SX:
        return self.steepest(parameters, shapes)
