import casadi as ca

from fmu_didim.dynamics.effects.base import TorqueEffect
from fmu_didim.dynamics.effects.joint import Column, OperatingRange, Parameter, Surroundings, Values
from fmu_didim.dynamics.effects.steps import smoothing_velocity


class WristFriction(TorqueEffect):
    """tau_e = Fvw (dq_j + dq_k) + Fcw s(dq_j + dq_k) on joint j and on the next joint k = j + 1.

    Listed at joint j of the pair; s(v) = tanh(v/v0) with the v0 of joint j.
    """

    name = "wrist_friction"
    title = "Friction of a coupled wrist motor"
    equation = "Fvw*(dq_j + dq_k) + Fcw*tanh((dq_j + dq_k)/v0) on joints j and k = j+1"
    class_name = "wrist coupling"
    confounded_with = ("coupling_friction",)
    signature = "Residual of two neighbouring joints that follows the sum of their velocities."
    experiment = "Move each of the two joints alone, then both in the same and in opposite directions."
    source = (
        "Gautier, Vandanjon, Janot: Dynamic identification of a 6 dof robot without joint position data, ICRA "
        "2011 (TX40)"
    )
    needs = frozenset({"other joints"})
    reach = 1
    couples_motors = True
    own_parameters = (
        Parameter("Fvw", "viscous", "viscous friction of the motor of both joints", least=0.0),
        Parameter("Fcw", "torque", "Coulomb friction of the motor of both joints", least=0.0),
    )
    own_shapes = (smoothing_velocity,)

    def columns(self, at: Surroundings, shapes: Values) -> tuple[Column, ...]:
        i, j = at.joint, at.joint + 1
        speed = at.all_dq[i] + at.all_dq[j]
        step = ca.tanh(speed / shapes["v0"])
        return ({i: speed, j: speed}, {i: step, j: step})

    def damping(self, parameters: Values, shapes: Values, within: OperatingRange) -> ca.SX:
        # Twice: each row feels the velocities of both joints.
        return 2 * (ca.fabs(parameters["Fvw"]) + ca.fabs(parameters["Fcw"]) / shapes["v0"])
