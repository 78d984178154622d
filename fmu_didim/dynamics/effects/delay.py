import casadi as ca

from fmu_didim.dynamics.effects.first_order import FirstOrder, torque_rate
from fmu_didim.dynamics.effects.inserted import InsertedEffect
from fmu_didim.dynamics.effects.joint import Parameter, Search, Values

LONGEST = 8
"""Longest delay in control periods."""


class Delay(InsertedEffect):
    """tau(t) = command(t - delay), with the delay in s, from 0 to 8 control periods h.

    For n = delay/h periods the mean over a period of the delayed, held command is

        y[k] = sum_i w_i u[k - i],    w_i = max(0, 1 - |n - i|),    i = 0..8

    Whole periods shift the command exactly; a fraction acts with its exact impulse. Longer delays act as 8 h.
    """

    name = "delay"
    title = "Delay of the command"
    equation = "tau(t) = command(t - delay)"
    class_name = "lag"
    confounded_with = ("actuator_lag", "log_time_shift")
    signature = "Residual proportional to the rate of change of the torque, the larger the faster the motion."
    experiment = "A step of the command, or the same path at twice the speed with positions logged."
    source = "held command of a sampled loop: Astrom and Wittenmark, Computer-Controlled Systems, section 2.3"
    rank = 30
    first_order = FirstOrder("torque", torque_rate)
    own_parameters = (
        Parameter("delay", "s", "delay of the command", neutral=0.0, limits=(0.0, 1.0), search=Search(5e-4, 0.032, 7)),
    )

    def state_count(self) -> int:
        return LONGEST

    def output(self, u: ca.SX, x: ca.SX, values: Values, step: float) -> ca.SX:
        periods = values["delay"] / step
        # c_i is how much of the command i + 1 periods ago has replaced that of i periods ago.
        passed = [ca.SX(1), *(ca.fmin(ca.fmax(periods - i, 0), 1) for i in range(LONGEST)), ca.SX(0)]
        result = (passed[0] - passed[1]) * u
        for i in range(LONGEST):
            result = result + (passed[i + 1] - passed[i + 2]) * x[i]
        return result

    def following(self, u: ca.SX, x: ca.SX, values: Values, step: float) -> ca.SX:
        return ca.vertcat(u, x[:-1])
