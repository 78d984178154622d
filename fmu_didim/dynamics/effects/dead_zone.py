import casadi as ca

from fmu_didim.dynamics.effects.first_order import FirstOrder, torque_sign
from fmu_didim.dynamics.effects.inserted import NO_LIMIT, InsertedEffect
from fmu_didim.dynamics.effects.joint import Parameter, Search, Values
from fmu_didim.dynamics.effects.stated_size import of_peak

ROUNDING = 0.05
"""Radius of the rounded corners, as a fraction of the width."""


class DeadZone(InsertedEffect):
    """tau = u - clip(u, -d, d), with the half width d = dead_zone in N.m (N) and slightly rounded corners:

    clip(u, -d, d) ~ (sqrt((u + d)^2 + e^2) - sqrt((u - d)^2 + e^2)) / 2,    e = 0.05 d
    """

    name = "dead_zone"
    title = "Dead zone of the drive"
    equation = "tau = sign(command)*max(0, |command| - dead_zone)"
    confounded_with = ("contact_stop", "spring", "drive_gain")
    signature = "Steps of the residual where the torque, not the velocity, changes its sign."
    experiment = "Motions whose torque changes its sign at many velocities."
    source = "Tao and Kokotovic, Adaptive Control of Systems with Actuator and Sensor Nonlinearities, 1996, ch. 2"
    rank = 20
    first_order = FirstOrder("torque", torque_sign)
    stated = of_peak("a dead zone of the drive")
    own_parameters = (
        Parameter(
            "dead_zone", "torque", "half width of the drive's dead zone",
            neutral=0.0, limits=(0.0, NO_LIMIT), search=Search(0.03, 10.0, 6),
        ),
    )  # fmt: skip

    def output(self, u: ca.SX, x: ca.SX, values: Values, step: float) -> ca.SX:
        width = values["dead_zone"]
        square = (ROUNDING * width) ** 2 + 1e-24  # so that the root has a slope without a dead zone, too
        return u - (ca.sqrt((u + width) ** 2 + square) - ca.sqrt((u - width) ** 2 + square)) / 2
