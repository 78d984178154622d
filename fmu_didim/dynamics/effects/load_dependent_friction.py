import casadi as ca

from fmu_didim.dynamics.effects.base import TorqueEffect
from fmu_didim.dynamics.effects.joint import OperatingRange, Parameter, Surroundings, Values
from fmu_didim.dynamics.effects.steps import USUAL_LOSS, direction, smoothing_velocity


class LoadDependentFriction(TorqueEffect):
    """tau_e = Fl |load| s(dq), s(dq) = tanh(dq/v0): load is the torque of gravity, inertia and Coriolis terms.

    Fl is a number. The load contains the acceleration, so that the direct model solves for it.
    """

    name = "load_dependent_friction"
    title = "Load-dependent friction"
    equation = "Fl*|load|*tanh(dq/v0)"
    confounded_with = ("directional_efficiency", "position_dependent_friction")
    signature = "Residual in a square wave of the velocity whose height follows gravity and inertia."
    experiment = "The same path with two payloads."
    source = "Hamon, Gautier, Garrec: friction depending on load and velocity, AIM 2010 and ICRA 2011"
    needs = frozenset({"load"})
    own_parameters = (Parameter("Fl", "1", "friction per transmitted torque", least=0.0, usual=USUAL_LOSS),)
    own_shapes = (smoothing_velocity,)

    def columns(self, at: Surroundings, shapes: Values) -> tuple[ca.SX, ...]:
        return (ca.fabs(at.load) * direction(at, shapes),)

    def damping(self, parameters: Values, shapes: Values, within: OperatingRange) -> ca.SX:
        return ca.fabs(parameters["Fl"]) * within.load / shapes["v0"]
