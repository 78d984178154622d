import casadi as ca

from fmu_didim.dynamics.effects.base import TorqueEffect
from fmu_didim.dynamics.effects.joint import Column, OperatingRange, Parameter, Surroundings, Values
from fmu_didim.dynamics.effects.steps import smoothing_velocity


class CouplingFriction(TorqueEffect):
    """tau_e on joint j: Fvm dq_k + Fcm s(dq_k); on the next joint k = j + 1: Fvm dq_j + Fcm s(dq_j).

    Listed at joint j of the pair; s(dq) = tanh(dq/v0) with the v0 of joint j. The motor whose friction follows both
    velocities at once is ``wrist_friction``.
    """

    name = "coupling_friction"
    title = "Coupling friction between two joints"
    equation = "joint j: Fvm*dq_k + Fcm*tanh(dq_k/v0); joint k = j+1: Fvm*dq_j + Fcm*tanh(dq_j/v0)"
    class_name = "wrist coupling"
    confounded_with = ("wrist_friction",)
    signature = "Residual of one joint that follows the velocity of its neighbour."
    experiment = "Move each of the two joints alone, then both in the same and in opposite directions."
    source = (
        "Leboutet, Roux, Janot, Guadarrama-Olvera, Cheng: Inertial parameter identification in robotics: a "
        "survey, 2021 (BIRDy, TX40)"
    )
    needs = frozenset({"other joints"})
    reach = 1
    couples_motors = True
    own_parameters = (
        Parameter("Fvm", "viscous", "viscous friction by the velocity of the other joint"),
        Parameter("Fcm", "torque", "Coulomb friction by the velocity of the other joint"),
    )
    own_shapes = (smoothing_velocity,)

    def columns(self, at: Surroundings, shapes: Values) -> tuple[Column, ...]:
        i, j = at.joint, at.joint + 1
        own, other = at.all_dq[i], at.all_dq[j]
        return ({i: other, j: own}, {i: ca.tanh(other / shapes["v0"]), j: ca.tanh(own / shapes["v0"])})

    def damping(self, parameters: Values, shapes: Values, within: OperatingRange) -> ca.SX:
        return ca.fabs(parameters["Fvm"]) + ca.fabs(parameters["Fcm"]) / shapes["v0"]
