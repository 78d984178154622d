from fmu_didim.dynamics.effects.base import MeasurementEffect
from fmu_didim.dynamics.effects.first_order import FirstOrder, torque_rate
from fmu_didim.dynamics.effects.joint import Parameter, Search
from fmu_didim.dynamics.effects.stated_size import StatedSize


class LogTimeShift(MeasurementEffect):
    """tau_log(t) = tau(t - log_shift), with log_shift in s: the log lags behind the clock of the reference.

    Negative values mean that it leads. A log has one clock, so that all joints are shifted alike. The loop itself is
    not touched, so that nothing but the torque moves.
    """

    name = "log_time_shift"
    title = "Time shift of the torque log"
    equation = "tau_log(t) = tau(t - log_shift)"
    class_name = "lag"
    confounded_with = ("actuator_lag", "delay")
    signature = "Residual proportional to the rate of change of the torque on all joints; the loop is not changed."
    experiment = "Logged positions or a step of the command: a lag or delay in the loop changes the motion, too."
    source = "definition of a time stamp; its effect to first order is -log_shift*dtau/dt"
    signed = frozenset({"log_shift"})
    first_order = FirstOrder("torque", lambda at: -torque_rate(at))  # a log that is late shows what was
    stated = StatedSize("a log that is stamped late", "ms", 1e3, joints="all")
    own_parameters = (
        Parameter(
            "log_shift", "s", "lag of the torque log", neutral=0.0, limits=(-1.0, 1.0), search=Search(5e-4, 0.05, 7)
        ),
    )
