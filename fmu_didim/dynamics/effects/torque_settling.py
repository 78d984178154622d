import casadi as ca

from fmu_didim.dynamics.effects.base import TorqueEffect
from fmu_didim.dynamics.effects.joint import OperatingRange, Parameter, Search, Surroundings, Values


class TorqueSettling(TorqueEffect):
    """tau_e = settled (1 - exp(-t/Tsettle)): an offset of an amplifier or a sensor that comes to rest as it warms.

    settled in N.m (N), the time t of the loop and the time constant in s.
    """

    name = "torque_settling"
    title = "Offset of the torque that settles"
    equation = "settled*(1 - exp(-t/Tsettle))"
    class_name = "torque_drift"
    confounded_with = ("torque_drift", "external_force", "thermal_friction_drift")
    signature = "Residual whose mean grows from one period of the same path to the next, less each time."
    experiment = "Repeat the path until nothing changes any more, and once more after a pause."
    source = "torque_drift, with the exponential warming of the friction of Simoni et al., IROS 2015"
    needs = frozenset({"time"})
    own_parameters = (Parameter("settled", "torque", "offset that is reached in the end"),)
    own_shapes = (Parameter("Tsettle", "s", "time constant of settling", 20.0, search=Search(1.0, 100.0, 8)),)

    def columns(self, at: Surroundings, shapes: Values) -> tuple[ca.SX, ...]:
        return (1 - ca.exp(-at.time / shapes["Tsettle"]),)

    def own_rate(self, shapes: Values, within: OperatingRange) -> ca.SX:
        return 1 / shapes["Tsettle"]
