from fmu_didim.dynamics.effects.first_order import FirstOrder, play
from fmu_didim.dynamics.effects.joint import Parameter, Search
from fmu_didim.dynamics.effects.structure import StructureEffect, gear_damping, gear_stiffness, motor_share


class Backlash(StructureEffect):
    """Play of width ``gap`` between motor and link, with a stiff spring K and a damper D while they are in contact:

        tau_s = K z(q - q_link) + D z'(q - q_link) (dq - dq_link)
        z(x) = x - clip(x, -gap/2, gap/2), corners rounded over 5 % of gap/2

    with gap in rad (m); all else as for the elasticity of a joint, whose K and D it shares. The joint starts in the
    middle of the play.
    """

    name = "backlash"
    title = "Backlash"
    equation = "tau = Im*ddq + friction(dq) + tau_s, tau_s = K*dead_zone(q - q_link, gap/2) while in contact"
    confounded_with = ("joint_elasticity",)
    signature = "Residual where the transmitted torque changes its sign: the load vanishes, then there is an impact."
    experiment = "Motions whose transmitted torque changes its sign at different velocities, or an encoder on the link."
    source = "Nordin and Gutman: Controlling mechanical systems with backlash, a survey, Automatica 38, 2002"
    signed = frozenset({"D", "gap"})
    elastic = True
    has_minima = True
    rivals_external_torque = True
    first_order = FirstOrder("link position", play)
    own_parameters = (
        Parameter(
            "gap", "position", "play between motor and link",
            neutral=0.0, limits=(0.0, 10.0), search=(Search(2e-4, 0.04, 5), Search(2e-5, 0.004, 5)),
        ),
    )  # fmt: skip
    own_shapes = (
        gear_stiffness.searched((Search(500.0, 5e4, 4), Search(5e4, 5e6, 4))),
        gear_damping.searched((Search(2.0, 100.0, 3), Search(200.0, 1e4, 3))),
        motor_share,
    )
