import math

import casadi as ca

from fmu_didim.dynamics.effects.base import TorqueEffect
from fmu_didim.dynamics.effects.joint import OperatingRange, Parameter, Search, Surroundings, Values
from fmu_didim.dynamics.effects.stated_size import StatedSize
from fmu_didim.dynamics.effects.steps import direction, smoothing_velocity


class ThermalFrictionDrift(TorqueEffect):
    """tau_e = (1 - exp(-t/Theat)) (Fvt dq + Fct s(dq)), s(dq) = tanh(dq/v0): change of friction from cold to warm.

    Fvt in N.m.s/rad (N.s/m), Fct in N.m (N), both negative where friction falls; t is the time of the loop, Theat the
    time constant of warming in s.
    """

    name = "thermal_friction_drift"
    title = "Drift of friction by warming"
    equation = "(1 - exp(-t/Theat))*(Fvt*dq + Fct*tanh(dq/v0))"
    confounded_with = ("torque_drift",)
    signature = "Residual in the shape of friction that differs between the first and the last period of the same path."
    experiment = "Repeat the path many times from cold, and once more after a pause."
    source = (
        "Simoni, Beschi, Legnani, Visioli: Friction modeling with temperature effects for industrial robot "
        "manipulators, IROS 2015"
    )
    needs = frozenset({"time"})
    stated = StatedSize(
        "friction that drifts over the run", "%", 100.0 * (1 - math.exp(-1.0)), largest=100.0,
        shares={"Fvt": "Fv", "Fct": "Fc"}, in_log={"Theat": 1.0},
    )  # fmt: skip
    own_parameters = (
        Parameter("Fvt", "viscous", "change of viscous friction when warm"),
        Parameter("Fct", "torque", "change of Coulomb friction when warm"),
    )
    own_shapes = (
        smoothing_velocity,
        Parameter("Theat", "s", "time constant of warming", 20.0, search=Search(1.0, 300.0, 8)),
    )

    def columns(self, at: Surroundings, shapes: Values) -> tuple[ca.SX, ...]:
        warm = 1 - ca.exp(-at.time / shapes["Theat"])
        return (warm * at.dq, warm * direction(at, shapes))

    def damping(self, parameters: Values, shapes: Values, within: OperatingRange) -> ca.SX:
        # Where friction falls, as it mostly does, cold friction is the stiffer one.
        return ca.fmax(parameters["Fvt"], 0) + ca.fmax(parameters["Fct"], 0) / shapes["v0"]
