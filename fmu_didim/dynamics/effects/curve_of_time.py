import casadi as ca

from fmu_didim.dynamics.effects.curve import Curve, curve_ends, curve_parameters
from fmu_didim.dynamics.effects.joint import Surroundings, Values


class CurveOfTime(Curve):
    """tau_e = c(t), a smooth curve of the time.

    See :class:`fmu_didim.dynamics.effects.curve.Curve`.
    """

    name = "curve_of_time"
    title = "Torque that is a curve of the time"
    equation = "c(t), cubic splines from tfrom to tto"
    confounded_with = ("torque_drift", "thermal_friction_drift", "external_force")
    experiment = "The same motion twice."
    symbol = "t"
    variable = "the time"
    needs = frozenset({"time"})
    signed = frozenset({"tfrom", "tto"})
    own_parameters = curve_parameters("t")
    own_shapes = curve_ends("t", "s", 0.0, 10.0)

    def along(self, at: Surroundings, shapes: Values) -> ca.SX:
        return at.time
