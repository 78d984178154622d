import casadi as ca

from fmu_didim.dynamics.effects.base import PreCheck
from fmu_didim.dynamics.effects.inserted import NO_LIMIT, VelocityEffect
from fmu_didim.dynamics.effects.joint import Parameter, Search, Values


class VoltageLimit(VelocityEffect):
    """What the voltage of a drive leaves of its torque beside the back electromotive force of the moving motor:

        -stall (1 + dq / no_load_speed) <= tau <= stall (1 - dq / no_load_speed)

    with stall in N.m (N) and no_load_speed in rad/s (m/s), seen at the joint. What drives the motion is limited to
    stall (1 - |dq| / no_load_speed); what brakes it, as of a generator, to stall (1 + |dq| / no_load_speed). Beyond the
    no-load speed the drive brakes whatever is commanded. The torque log shows the limited command. Without a no-load
    speed it is the constant limit of torque_saturation.
    """

    name = "voltage_limit"
    title = "Torque limit that falls with the speed"
    equation = "-stall*(1 + dq/no_load_speed) <= tau <= stall*(1 - dq/no_load_speed)"
    class_name = "saturation"
    confounded_with = ("torque_saturation",)
    signature = "Tops of the measured torque along a line that falls with the speed; soon after the model needs less."
    experiment = "Motions that reach the limit at another speed: a start from rest against a load and a fast stroke."
    source = "Siciliano et al., Robotics: Modelling, Planning and Control, 2009, sec. 5.2: electric drives"
    logged = "after"
    rank = -10
    shows_at_start = True
    pre_check = PreCheck(
        "stall",
        (0.95, 0.97, 0.98, 0.99, 0.995, 0.998),
        speed="no_load_speed",
        speeds=Search(1.05, 8.0, 16),
        flattest=10.0,
    )
    own_parameters = (
        Parameter(
            "stall", "torque", "largest torque at rest", NO_LIMIT,
            neutral=NO_LIMIT, limits=(1e-6, NO_LIMIT), search=Search(1.0, 1000.0, 13),
        ),
        Parameter(
            "no_load_speed", "velocity", "speed at which no torque is left", NO_LIMIT,
            neutral=NO_LIMIT, limits=(1e-6, NO_LIMIT), search=Search(0.1, 100.0, 13),
        ),
    )  # fmt: skip

    def changed(self, u: ca.SX, dq: ca.SX, values: Values) -> ca.SX:
        left = dq / values["no_load_speed"]
        return ca.fmin(ca.fmax(u, -values["stall"] * (1 + left)), values["stall"] * (1 - left))
