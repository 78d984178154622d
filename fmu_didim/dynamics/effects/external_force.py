from collections.abc import Mapping

import casadi as ca

from fmu_didim.dynamics.effects.base import TorqueEffect
from fmu_didim.dynamics.effects.joint import OperatingRange, Parameter, Surroundings, Values
from fmu_didim.dynamics.effects.steps import instants, rise


class ExternalForce(TorqueEffect):
    """tau_e = Fext (r(t; t_on) - r(t; t_off)), a step up at t_on and down at t_off, each about w_edge wide.

    r(t; t1) = (1 + tanh((t - t1)/w_edge))/2 with the time t of the loop in s. Fext in N.m (N) is the torque that
    the drive must supply against the outside.
    """

    name = "external_force"
    title = "External force for a while"
    equation = "Fext*(t_on < t < t_off)"
    confounded_with = ("payload_change",)
    signature = "Residual within one interval of time that does not come back when the path is repeated."
    experiment = "Repeat the path."
    source = "De Luca, Mattone: Sensorless robot collision detection and hybrid force/motion control, ICRA 2005"
    needs = frozenset({"time"})
    signed = frozenset({"t_on", "t_off"})
    acts_on_link = True
    is_external = True
    own_parameters = (Parameter("Fext", "torque", "torque against the outside"),)
    own_shapes = (
        Parameter("t_on", "s", "beginning of the force", 1.0, search=instants),
        Parameter("t_off", "s", "end of the force", 2.0, search=instants),
        Parameter("w_edge", "s", "width of the edges", 0.02),
    )

    def allows(self, shapes: Mapping[str, float]) -> bool:
        return shapes["t_off"] > shapes["t_on"]

    def acts(self, shapes: Mapping[str, float]) -> tuple[float, float]:
        return shapes["t_on"], shapes["t_off"]

    def columns(self, at: Surroundings, shapes: Values) -> tuple[ca.SX, ...]:
        width = shapes["w_edge"]
        return (rise(at.time, shapes["t_on"], width) - rise(at.time, shapes["t_off"], width),)

    def own_rate(self, shapes: Values, within: OperatingRange) -> ca.SX:
        return 1 / shapes["w_edge"]
