import casadi as ca

from fmu_didim.dynamics.effects.base import TorqueEffect
from fmu_didim.dynamics.effects.joint import OperatingRange, Parameter, Surroundings, Values


class CubicSpring(TorqueEffect):
    """tau_e = kcube q^3, with kcube in N.m/rad3 (N/m3): what a spring that hardens has beside its linear part."""

    name = "cubic_spring"
    title = "Hardening spring"
    equation = "kcube*q^3"
    class_name = "position-dependent load"
    confounded_with = ("spring", "torque_offset", "contact_stop", "contact_stop_lower")
    bends = "spring"
    signature = "Residual that grows towards both ends of the range and does not depend on speed."
    experiment = "A wide range of positions, or the same path with another payload or orientation of the base."
    source = "Nayfeh and Mook: Nonlinear oscillations, 1979 (Duffing's spring)"
    acts_on_link = True
    own_parameters = (Parameter("kcube", ("N.m/rad3", "N/m3"), "cubic stiffness"),)

    def columns(self, at: Surroundings, shapes: Values) -> tuple[ca.SX, ...]:
        return (at.q**3,)

    def stiffness(self, parameters: Values, shapes: Values, within: OperatingRange) -> ca.SX:
        # At one rad or m from the middle.
        return 3 * ca.fabs(parameters["kcube"])
