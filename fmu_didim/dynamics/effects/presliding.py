import casadi as ca

from fmu_didim.dynamics.effects.bristles import BristleFriction, presliding_distance
from fmu_didim.dynamics.effects.joint import OperatingRange, Parameter, Surroundings, Values
from fmu_didim.dynamics.effects.steps import direction, smoothing_velocity


class Presliding(BristleFriction):
    """tau_e = Fd (z/zs - s(dq)), dz/dt = dq - |dq| z/zs, s(dq) = tanh(dq/v0); the state z starts at 0.

    With Fd = Fc the step of Coulomb friction becomes Dahl's: after a reversal friction grows over the distance zs in
    rad (m), whatever the speed. Fd in N.m (N).
    """

    name = "presliding"
    title = "Presliding friction (Dahl)"
    equation = "Fd*(z/zs - tanh(dq/v0)), dz/dt = dq - |dq|*z/zs"
    confounded_with = ("lugre", "stribeck", "coulomb", "quadratic_viscous")
    signature = "Residual after every reversal that decays over a distance, not over a time or with speed."
    experiment = "Many reversals with amplitudes below five times zs, at two speeds."
    source = "Dahl: A solid friction model, Aerospace Corporation 1968"
    # Friction that sticks before it slides leaves steps of the size of its breakaway.
    rivals_external_torque = True
    own_parameters = (Parameter("Fd", "torque", "Coulomb friction that builds up over a distance", least=0.0),)
    own_shapes = (smoothing_velocity, presliding_distance)

    def columns(self, at: Surroundings, shapes: Values) -> tuple[ca.SX, ...]:
        return (at.state[0] / shapes["zs"] - direction(at, shapes),)

    def damping(self, parameters: Values, shapes: Values, within: OperatingRange) -> ca.SX:
        # It takes the step away that Coulomb friction counts.
        return -parameters["Fd"] / shapes["v0"]

    def stiffness(self, parameters: Values, shapes: Values, within: OperatingRange) -> ca.SX:
        return ca.fabs(parameters["Fd"]) / shapes["zs"]
