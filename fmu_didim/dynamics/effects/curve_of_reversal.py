import casadi as ca
import numpy as np

from fmu_didim.data.signals import Variable
from fmu_didim.dynamics.effects.bristles import deflection_rate, resolved_rate
from fmu_didim.dynamics.effects.curve import Curve, curve_ends, curve_parameters
from fmu_didim.dynamics.effects.joint import UNITS, JointType, OperatingRange, Surroundings, Values
from fmu_didim.dynamics.effects.steps import direction, smoothing_velocity

REACH = 4.0
"""[1] Lengths R that the curve reaches: after them the state is within 2 % of where it settles."""
LENGTH = 0.1
"""[1] Of the range of the joint, R: a motion of two fifths of its range shows the whole curve."""


class CurveOfReversal(Curve):
    """tau_e = s(dq) c(x), a smooth curve of the distance x since the last reversal, s(dq) = tanh(dq/v0).

        x = -R ln((1 - s z/R)/2),    dz/dt = dq - |dq| z/R,    R = rto/4

    z is Dahl's state of a bristle of the length R, so that x is the distance since a reversal that a motion of some R
    came before, and less is forgotten of what came before a shorter one; it starts at R ln 2.

    See :class:`fmu_didim.dynamics.effects.curve.Curve`.
    """

    name = "curve_of_reversal"
    title = "Torque that is a curve of the distance since a reversal"
    equation = "tanh(dq/v0)*c(distance since the last reversal), cubic splines from rfrom to rto"
    confounded_with = ("presliding", "lugre", "backlash")
    experiment = "Reversals at several places, far apart, at two speeds."
    symbol = "r"
    variable = "the distance since the last reversal"
    signed = frozenset({"rfrom"})
    own_parameters = curve_parameters("r")
    own_shapes = (smoothing_velocity, *curve_ends("r", "position", 0.0, 0.4))

    def states(self, joint_type: JointType) -> tuple[Variable, ...]:
        return (Variable("zr", UNITS[joint_type].position, "local", 0.0, "what remembers the last reversal"),)

    def rates(self, at: Surroundings, shapes: Values) -> tuple[ca.SX, ...]:
        return (deflection_rate(at, shapes["rto"] / REACH),)

    def along(self, at: Surroundings, shapes: Values) -> ca.SX:
        length = shapes["rto"] / REACH
        share = (1 - direction(at, shapes) * at.state[0] / length) / 2
        return -length * ca.log(ca.fmax(share, np.exp(-REACH)))

    def columns(self, at: Surroundings, shapes: Values) -> tuple[ca.SX, ...]:
        return tuple(direction(at, shapes) * column for column in super().columns(at, shapes))

    def ends_on(self, at: Surroundings) -> tuple[float, float]:
        return 0.0, REACH * LENGTH * float(np.ptp(np.asarray(at.q)))

    def damping(self, parameters: Values, shapes: Values, within: OperatingRange) -> ca.SX:
        return self.largest(parameters) / shapes["v0"]

    def stiffness(self, parameters: Values, shapes: Values, within: OperatingRange) -> ca.SX:
        return self.steepest(parameters, shapes)

    def own_rate(self, shapes: Values, within: OperatingRange) -> ca.SX:
        return resolved_rate(shapes["rto"] / REACH, within)

    def relaxation(self, shapes: Values, within: OperatingRange) -> ca.SX:
        return within.speed * REACH / shapes["rto"]
