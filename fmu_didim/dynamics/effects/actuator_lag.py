import casadi as ca

from fmu_didim.dynamics.effects.first_order import FirstOrder, torque_rate
from fmu_didim.dynamics.effects.inserted import InsertedEffect
from fmu_didim.dynamics.effects.joint import Parameter, Search, Values

SHORTEST = 1e-12
"""A lag in s below which its exponential is zero in any case."""


class ActuatorLag(InsertedEffect):
    """T dtau/dt + tau = command, with T in s, sampled exactly at the control period h.

    With a = exp(-h/T), x the torque at the beginning of a period and u the command held over it,

        x[k+1] = a x[k] + (1 - a) u[k],    y[k] = u[k] + (x[k] - u[k]) (1 - a) T/h

    where y is the mean of the lagged torque over the period, so that its impulse is exact. T = 0 gives y = u, and
    y is smooth in T there.
    """

    name = "actuator_lag"
    title = "Lag of the current loop"
    equation = "T*dtau/dt + tau = command"
    class_name = "lag"
    confounded_with = ("delay", "log_time_shift")
    signature = "Residual proportional to the rate of change of the torque, the larger the faster the motion."
    experiment = "The same path at twice the speed with positions logged, or a step of the command."
    source = "first-order model of a current loop: Spong, Hutchinson, Vidyasagar, Robot Modeling and Control, ch. 6"
    rank = 40
    first_order = FirstOrder("torque", torque_rate)
    own_parameters = (
        Parameter(
            "T", "s", "time constant of the current loop", neutral=0.0, limits=(0.0, 1.0), search=Search(5e-4, 0.05, 7)
        ),
    )

    def state_count(self) -> int:
        return 1

    def output(self, u: ca.SX, x: ca.SX, values: Values, step: float) -> ca.SX:
        lag = values["T"]
        return u + (x - u) * (1 - _decay(lag, step)) * lag / step

    def following(self, u: ca.SX, x: ca.SX, values: Values, step: float) -> ca.SX:
        decay = _decay(values["T"], step)
        return decay * x + (1 - decay) * u


def _decay(lag: ca.SX, step: float) -> ca.SX:
    return ca.exp(-step / ca.fmax(lag, SHORTEST))
