import casadi as ca

from fmu_didim.dynamics.effects.base import PreCheck
from fmu_didim.dynamics.effects.inserted import NO_LIMIT, InsertedEffect
from fmu_didim.dynamics.effects.joint import Parameter, Search, Values


class TorqueSaturation(InsertedEffect):
    """tau = min(max(u, -limit), limit), with the limit in N.m (N); the torque log shows the limited command."""

    name = "torque_saturation"
    title = "Saturation of the command"
    equation = "tau = clip(command, -limit, limit)"
    class_name = "saturation"
    signature = "Flat tops of the measured torque at one level; the model needs more there, less soon after."
    experiment = "A slower motion, whose torque stays below the limit."
    source = "Astrom and Wittenmark, Computer-Controlled Systems: limits of actuators"
    logged = "after"
    rank = -10
    shows_at_start = True
    pre_check = PreCheck("limit", (0.9, 0.95, 0.97, 0.98, 0.99, 0.995, 0.998, 1.0))
    own_parameters = (
        Parameter(
            "limit", "torque", "largest torque of the drive", NO_LIMIT,
            neutral=NO_LIMIT, limits=(1e-6, NO_LIMIT), search=Search(1.0, 1000.0, 13),
        ),
    )  # fmt: skip

    def output(self, u: ca.SX, x: ca.SX, values: Values, step: float) -> ca.SX:
        return ca.fmin(ca.fmax(u, -values["limit"]), values["limit"])
