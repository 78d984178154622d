import casadi as ca

from fmu_didim.dynamics.effects.base import TorqueEffect
from fmu_didim.dynamics.effects.joint import OperatingRange, Parameter, Surroundings, Values
from fmu_didim.dynamics.effects.steps import USUAL_LOSS, direction, smoothing_velocity


class DirectionalEfficiency(TorqueEffect):
    """tau_e = Fldrive (|load| s + load s^2)/2 + Flback (|load| s - load s^2)/2, s = tanh(dq/v0).

    The first column acts while the motor drives the load (load dq > 0), the second while the load drives the
    motor; each is |load| sign(dq) there. With the efficiency eta of a gear, Fldrive = 1/eta - 1, Flback = 1 - eta. A
    cable that wraps by an angle phi, with friction mu, needs exp(mu phi) times its load, and exp(-mu phi) times it
    while the load drives (Euler and Eytelwein): Fldrive = exp(mu phi) - 1, Flback = 1 - exp(-mu phi).
    """

    name = "directional_efficiency"
    title = "Gear efficiency by direction of power"
    equation = "|load|*tanh(dq/v0)*(Fldrive if load*dq > 0 else Flback)"
    class_name = "load_dependent_friction"
    confounded_with = ("load_dependent_friction",)
    signature = "Residual in proportion to the load, of another size when the motor brakes than when it drives."
    experiment = "The same path with two payloads, lifting and lowering at constant speed."
    source = (
        "Duclusaud, Passault, Padois, Ly: Extended friction models for the physics simulation of servo actuators, 2024"
    )
    needs = frozenset({"load"})
    own_parameters = (
        Parameter("Fldrive", "1", "loss per transmitted torque while the motor drives", least=0.0, usual=USUAL_LOSS),
        Parameter("Flback", "1", "loss per transmitted torque while the load drives", least=0.0, usual=USUAL_LOSS),
    )
    own_shapes = (smoothing_velocity,)

    def columns(self, at: Surroundings, shapes: Values) -> tuple[ca.SX, ...]:
        step = direction(at, shapes)
        loss, gain = ca.fabs(at.load) * step / 2, at.load * step**2 / 2
        return (loss + gain, loss - gain)

    def damping(self, parameters: Values, shapes: Values, within: OperatingRange) -> ca.SX:
        return (ca.fabs(parameters["Fldrive"]) + ca.fabs(parameters["Flback"])) * 0.9 * within.load / shapes["v0"]
