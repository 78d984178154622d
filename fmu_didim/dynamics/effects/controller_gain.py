import casadi as ca

from fmu_didim.dynamics.effects.inserted import InsertedEffect
from fmu_didim.dynamics.effects.joint import Parameter, Search, Values


class ControllerGain(InsertedEffect):
    """tau = controller_gain * u: all gains of the joint's controller are wrong by one factor.

    The torque log shows the command itself, after it: the plant is driven by what is logged.
    """

    name = "controller_gain"
    title = "Gain of the controller"
    equation = "command = controller_gain*u"
    confounded_with = ("actuator_lag", "delay", "joint_elasticity")
    signature = "A residual at the frequencies where tracking is loose; none in slow motion."
    experiment = "Logged positions: the command against the tracking error."
    source = "Gautier, Janot, Vandanjon: DIDIM, section on errors of the controller's gains"
    shows_at_start = True
    is_stated = True
    logged = "after"
    rank = -20
    own_parameters = (
        Parameter(
            "controller_gain", "1", "true gain per assumed gain", 1.0,
            neutral=1.0, limits=(0.05, 20.0), search=Search(0.5, 2.0, 7),
        ),
    )  # fmt: skip

    def output(self, u: ca.SX, x: ca.SX, values: Values, step: float) -> ca.SX:
        return values["controller_gain"] * u
