import casadi as ca

from fmu_didim.dynamics.effects.curve import Curve, curve_ends, curve_parameters
from fmu_didim.dynamics.effects.joint import Surroundings, Values


class CurveOfLoad(Curve):
    """tau_e = c(load), a smooth curve of the torque that the joint transmits.

    See :class:`fmu_didim.dynamics.effects.curve.Curve`.
    """

    name = "curve_of_load"
    title = "Torque that is a curve of the transmitted torque"
    equation = "c(load), cubic splines from lfrom to lto"
    confounded_with = ("drive_gain", "directional_efficiency", "load_dependent_friction")
    experiment = "The same motion with and without a load."
    symbol = "l"
    variable = "the torque that the joint transmits"
    needs = frozenset({"load"})
    signed = frozenset({"lfrom", "lto"})
    own_parameters = curve_parameters("l")
    own_shapes = curve_ends("l", "torque", -10.0, 10.0)

    def along(self, at: Surroundings, shapes: Values) -> ca.SX:
        return at.load
