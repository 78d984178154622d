import casadi as ca

from fmu_didim.dynamics.effects.base import TorqueEffect
from fmu_didim.dynamics.effects.joint import Parameter, Surroundings, Values


class TorqueDrift(TorqueEffect):
    """tau_e = drift t, in N.m/s (N/s), with the time t of the loop: drift of the amplifier or of a sensor."""

    name = "torque_drift"
    title = "Drift of the torque offset"
    equation = "drift*t"
    confounded_with = ("thermal_friction_drift", "torque_offset", "torque_settling")
    signature = "Residual whose mean grows from one period of the same path to the next."
    experiment = "Repeat the path many times; rest at the same position before and after."
    source = "torque_offset (Gautier, Janot, Vandanjon: DIDIM, section 2), made a function of time"
    needs = frozenset({"time"})
    own_parameters = (Parameter("drift", ("N.m/s", "N/s"), "drift of the torque offset"),)

    def columns(self, at: Surroundings, shapes: Values) -> tuple[ca.SX, ...]:
        return (at.time,)
