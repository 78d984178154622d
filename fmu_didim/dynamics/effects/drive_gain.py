import casadi as ca

from fmu_didim.dynamics.effects.first_order import FirstOrder
from fmu_didim.dynamics.effects.inserted import InsertedEffect
from fmu_didim.dynamics.effects.joint import Parameter, Search, Values
from fmu_didim.dynamics.effects.stated_size import StatedSize


class DriveGain(InsertedEffect):
    """tau = drive_gain * u: a wrong torque constant or gear ratio; the torque log shows u.

    On a joint without coupling to others it scales all parameters of the row alike and cannot be seen.
    """

    name = "drive_gain"
    title = "Gain of the drive"
    equation = "tau = drive_gain*command"
    confounded_with = ("dead_zone", "payload_change")
    signature = "All torques of the joint scaled; visible only in what coupled joints share."
    experiment = "A known payload, or the same motion with and without it."
    source = "Gautier and Briot, New method for global identification of the joint drive gains, IROS 2011"
    rank = 10
    first_order = FirstOrder("torque", lambda at: -at.logged)  # a drive that gives more has to be asked for less
    stated = StatedSize("a gain of the drive that is off", "%", 100.0, is_scale=True)
    own_parameters = (
        Parameter(
            "drive_gain", "1", "torque per torque asked for", 1.0,
            neutral=1.0, limits=(0.05, 20.0), search=Search(0.8, 1.25, 5),
        ),
    )  # fmt: skip

    def output(self, u: ca.SX, x: ca.SX, values: Values, step: float) -> ca.SX:
        return values["drive_gain"] * u
