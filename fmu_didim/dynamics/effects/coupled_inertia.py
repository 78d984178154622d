from fmu_didim.dynamics.effects.base import TorqueEffect
from fmu_didim.dynamics.effects.joint import Column, Parameter, Surroundings, Values


class CoupledInertia(TorqueEffect):
    """tau_e = Iam ddq_k on joint j, and Iam ddq_j on the next joint k = j + 1; Iam in kg.m2 (kg), of either sign.

    Listed at joint j of the pair. A motor of inertia J at the joint that turns by q_k + r q_j, as in a wrist whose
    motors drive through each other, has the energy J (dq_k + r dq_j)^2 / 2: it adds J to Ia_k, r^2 J to Ia_j and r J to
    the torques of both joints by the acceleration of the other one. The first two cannot be told from the inertia of
    the motors' own joints; the third is this effect, so that with Ia of both joints the regressor has full rank.
    The inertias [Ia_j Iam; Iam Ia_k] of motors are positive semidefinite: Iam^2 <= Ia_j Ia_k.
    """

    name = "coupled_inertia"
    title = "Motor inertia coupled between two joints"
    equation = "joint j: Iam*ddq_k; joint k = j+1: Iam*ddq_j"
    signature = "Residual of two neighbouring joints, each in proportion to the acceleration of the other one."
    experiment = "Move each of the two joints alone, fast, and both in the same and in opposite directions."
    source = (
        "Gautier, Vandanjon, Janot: Dynamic identification of a 6 dof robot without joint position data, ICRA "
        "2011 (TX40, joints 5 and 6)"
    )
    needs = frozenset({"other joints"})
    reach = 1
    couples_motors = True
    own_parameters = (Parameter("Iam", "inertia", "inertia of motors by the acceleration of the other joint"),)

    def columns(self, at: Surroundings, shapes: Values) -> tuple[Column, ...]:
        i, j = at.joint, at.joint + 1
        return ({i: at.all_ddq[j], j: at.all_ddq[i]},)
