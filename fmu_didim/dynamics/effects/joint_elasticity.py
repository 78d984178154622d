from fmu_didim.dynamics.effects.first_order import FirstOrder
from fmu_didim.dynamics.effects.joint import Search
from fmu_didim.dynamics.effects.structure import StructureEffect, gear_damping, gear_stiffness, motor_share


class JointElasticity(StructureEffect):
    """A spring between the motor (position q, which the encoder sees) and the link (position q_link):

        Im ddq + friction(dq) + tau_s = tau,    G(q_link, dq_link, ddq_link) = tau_s
        tau_s = K (q - q_link) + D (dq - dq_link)

    K in N.m/rad (N/m), D in N.m.s/rad (N.s/m), all on the joint's side of the gear. G are the rigid-body torques of the
    links and what acts on them (springs, stops, external forces); friction and all other effects act on the motor.
    The motor's inertia Im is Ia where the description gives one; else it is the part ``motor_share`` of ZZ (M of a
    slide), and the link keeps the rest.
    """

    name = "joint_elasticity"
    title = "Joint elasticity"
    equation = "tau = Im*ddq + friction(dq) + tau_s, tau_s = K*(q - q_link) + D*(dq - dq_link)"
    class_name = "elasticity"
    confounded_with = ("actuator_lag", "controller_gain", "backlash")
    signature = "Residual that grows with the square of the frequency; ringing at the resonance."
    experiment = "A chirp through the resonance, or an encoder on the link."
    source = "Spong: Modeling and control of elastic joint robots, ASME JDSMC 109, 1987"
    signed = frozenset({"D"})
    elastic = True
    first_order = FirstOrder("link position", lambda at: -at.load)  # the twist of a gear whose compliance is one
    own_parameters = (gear_stiffness.searched((Search(50.0, 5e4, 10), Search(5e3, 5e7, 10))), gear_damping)
    own_shapes = (motor_share,)
