import casadi as ca

from fmu_didim.dynamics.effects.base import TorqueEffect
from fmu_didim.dynamics.effects.joint import OperatingRange, Parameter, Search, Surroundings, Values
from fmu_didim.dynamics.effects.stated_size import of_peak
from fmu_didim.dynamics.effects.steps import direction, smoothing_velocity

stribeck_velocity = Parameter("vs", "velocity", "Stribeck velocity", (0.1, 0.01))
"""Effects of a joint share it."""


class Stribeck(TorqueEffect):
    """tau_e = Fs * s(dq) exp(-(dq/vs)^2), s(dq) = tanh(dq/v0): Fs in N.m (N) is static minus Coulomb friction."""

    name = "stribeck"
    title = "Stribeck friction"
    equation = "Fs*tanh(dq/v0)*exp(-(dq/vs)^2)"
    is_shared = True
    confounded_with = ("coulomb", "presliding", "lugre", "power_viscous", "quadratic_viscous")
    signature = "Residual in a pair of spikes of opposite sign at every reversal, within three times the velocity vs."
    experiment = "Slow constant speeds in both directions, down to a third of vs; reversals at two accelerations."
    source = (
        "Armstrong-Helouvry, Dupont, Canudas de Wit: A survey of models, Automatica 1994; Bittencourt, Wernholt, "
        "Sander-Tavallaey, Brogardh: An extended friction model, IROS 2010"
    )
    stated = of_peak("Stribeck friction")
    own_parameters = (Parameter("Fs", "torque", "static friction above Coulomb friction", least=0.0),)
    own_shapes = (smoothing_velocity, stribeck_velocity.searched((Search(0.02, 1.0, 9), Search(0.001, 0.05, 9))))

    def columns(self, at: Surroundings, shapes: Values) -> tuple[ca.SX, ...]:
        return (direction(at, shapes) * ca.exp(-((at.dq / shapes["vs"]) ** 2)),)

    def damping(self, parameters: Values, shapes: Values, within: OperatingRange) -> ca.SX:
        return ca.fabs(parameters["Fs"]) / shapes["v0"]
