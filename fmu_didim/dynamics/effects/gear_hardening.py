from fmu_didim.dynamics.effects.first_order import FirstOrder
from fmu_didim.dynamics.effects.joint import Parameter, Search
from fmu_didim.dynamics.effects.structure import LARGEST, StructureEffect

SMALLEST_TWIST = 1e-6
"""A twist in rad (m) below which no gear is twice as stiff as without load."""


class GearHardening(StructureEffect):
    """An elastic gear that is the stiffer the more it is twisted:

        tau_s = K z(x) + K_cubic z(x)^3 + D z'(x) dx/dt,    x = q - q_link

    with K_cubic in N.m/rad3 (N/m3). K, D and z are those of ``joint_elasticity`` or ``backlash``, one of which its
    joint has, too; with play z is the twist beyond it, with ``transmission_error`` x is that of the teeth. K is the
    stiffness without load, K + 3 K_cubic z^2 that at a twist.

    Gears harden: more of their teeth bear, on larger areas. With K_cubic below zero a gear gives way for good beyond
    its largest torque, 2/3 K sqrt(K/(3 |K_cubic|)); discovery calls such a value impossible.
    """

    name = "gear_hardening"
    title = "Stiffness of a gear that hardens"
    equation = "tau_s = K*z + K_cubic*z^3, z = q - q_link, less the play"
    confounded_with = ("backlash",)
    signature = "Residual of an elastic gear where its load is large: its resonance rises with the amplitude."
    experiment = "One motion at several amplitudes or with several payloads, or an encoder on the link."
    source = (
        "Tuttle and Seering: A nonlinear model of a harmonic drive gear transmission, IEEE Transactions on Robotics "
        "and Automation 12, 1996: torque as a cubic function of the twist"
    )
    signed = frozenset({"K_cubic"})
    needs_elastic = True
    is_smooth = True
    first_order = FirstOrder("link position", lambda at: at.load**3)  # less twist, of a gear whose compliance is one
    own_parameters = (
        Parameter(
            "K_cubic", ("N.m/rad3", "N/m3"), "cubic part of the torque of the gear over its twist",
            neutral=0.0, limits=(-LARGEST / SMALLEST_TWIST**2, LARGEST / SMALLEST_TWIST**2), least=0.0,
            # As stiff again as K, from 50 N.m/rad at 0.3 rad to 5e4 N.m/rad at 1e-3 rad; 5e3 N/m at 0.01 m to 5e7 N/m
            # at 1e-5 m.
            search=(Search(5e2, 5e10, 9), Search(5e7, 5e17, 11)),
        ),
    )  # fmt: skip
