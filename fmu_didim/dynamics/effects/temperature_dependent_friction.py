import casadi as ca

from fmu_didim.data.signals import Variable
from fmu_didim.dynamics.effects.base import TorqueEffect
from fmu_didim.dynamics.effects.joint import JointType, OperatingRange, Parameter, Surroundings, Values
from fmu_didim.dynamics.effects.steps import direction, smoothing_velocity

REFERENCE_TEMPERATURE = 293.15
"""[K] At which friction is that of the other effects of the joint: 20 degC, as data sheets have it."""
SPAN = 60.0
"""[K] From there to the temperatures of a gear at work, for which steps of the integration are chosen."""


class TemperatureDependentFriction(TorqueEffect):
    """tau_e = (T - 20 degC) (FvK dq + FcK s(dq)), s(dq) = tanh(dq/v0): friction that follows a measured temperature T.

    FvK in N.m.s/(rad.K) (N.s/(m.K)), FcK in N.m/K (N/K), mostly negative: a lubricant gets thinner. T in K is a line
    along the run, T(t) = temperature + warming (t - t_start), as the log of the run has it. Friction beside it is that
    at 20 degC.
    """

    name = "temperature_dependent_friction"
    title = "Friction by temperature"
    equation = "(T - 20 degC)*(FvK*dq + FcK*tanh(dq/v0))"
    confounded_with = ("thermal_friction_drift",)
    signature = "Residual in the shape of friction whose sign and size follow the temperature from run to run."
    experiment = "The same motion cold and warm, with the temperature of the gear in both logs."
    source = (
        "Bittencourt, Wernholt, Sander-Tavallaey, Brogardh: An extended friction model to capture load and temperature "
        "effects in robot joints, IROS 2010: linear in the temperature, of Coulomb and of viscous friction"
    )
    given_states = frozenset({"temperature", "warming"})
    own_parameters = (
        Parameter("FvK", ("N.m.s/(rad.K)", "N.s/(m.K)"), "change of viscous friction per kelvin"),
        Parameter("FcK", ("N.m/K", "N/K"), "change of Coulomb friction per kelvin"),
    )
    own_shapes = (smoothing_velocity,)

    def states(self, joint_type: JointType) -> tuple[Variable, ...]:
        return (
            Variable("temperature", "K", "local", REFERENCE_TEMPERATURE, "temperature of the gear"),
            Variable("warming", "K/s", "local", 0.0, "rate at which it rises"),
        )

    def rates(self, at: Surroundings, shapes: Values) -> tuple[ca.SX, ...]:
        return (at.state[1], ca.SX(0))

    def columns(self, at: Surroundings, shapes: Values) -> tuple[ca.SX, ...]:
        above = at.state[0] - REFERENCE_TEMPERATURE
        return (above * at.dq, above * direction(at, shapes))

    def damping(self, parameters: Values, shapes: Values, within: OperatingRange) -> ca.SX:
        return SPAN * (ca.fabs(parameters["FvK"]) + ca.fabs(parameters["FcK"]) / shapes["v0"])
