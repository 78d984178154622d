import casadi as ca

from fmu_didim.dynamics.effects.curve import Curve, curve_ends, curve_parameters
from fmu_didim.dynamics.effects.joint import Surroundings, Values


class CurveOfNeighbour(Curve):
    """tau_e = c(q_m), a smooth curve of the position of the next joint, m = j + 1, or of the one before the last joint.

    See :class:`fmu_didim.dynamics.effects.curve.Curve`; the range is in rad or m, as of the joint itself.
    """

    name = "curve_of_neighbour"
    title = "Torque that is a curve of the neighbour's position"
    equation = "c(q of the next joint, of the last but one at the last), cubic splines from nfrom to nto"
    confounded_with = ("payload_change",)
    experiment = "The neighbour over its whole range while this joint stays."
    symbol = "n"
    variable = "the position of the neighbour"
    needs = frozenset({"other joints"})
    signed = frozenset({"nfrom", "nto"})
    own_parameters = curve_parameters("n")
    own_shapes = curve_ends("n", "position", -1.0, 1.0)

    def along(self, at: Surroundings, shapes: Values) -> ca.SX:
        is_last = at.joint + 1 == at.all_q.shape[0]
        return at.all_q[at.joint - 1 if is_last else at.joint + 1]
