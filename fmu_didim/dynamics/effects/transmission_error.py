from collections.abc import Mapping

from fmu_didim.dynamics.effects.joint import Parameter, Search
from fmu_didim.dynamics.effects.motor import Harmonic, Motor, distinct
from fmu_didim.dynamics.effects.structure import StructureEffect


def amplitude(name: str, text: str) -> Parameter:
    """One of the two amplitudes of the error."""
    return Parameter(name, "position", text, neutral=0.0, limits=(-0.1, 0.1), search=Search(1e-5, 1e-3, 2))


class TransmissionError(StructureEffect):
    """The teeth of an elastic gear turn the link by e(q) more than the motor, periodic in the position q of the motor:

        tau_s = K z(q + e - q_link) + D z'(q + e - q_link) ((1 + e') dq - dq_link)
        e(q) = gear_cosine cos(N q) + gear_sine sin(N q),    e' = de/dq

    amplitudes in rad (m), N in 1 (1/m), q on the joint's side of the gear. The link feels tau_s; no power is lost in
    teeth, so that the motor feels (1 + e') tau_s. N is the gear ratio times the errors in a turn of the motor: a
    harmonic drive has two. K, D and z are those of ``joint_elasticity`` or ``backlash``, one of which its joint has,
    too. A link starts where its motor does.
    """

    name = "transmission_error"
    title = "Error of position of a gear"
    equation = "q_link = q + gear_cosine*cos(N*q) + gear_sine*sin(N*q), less the twist of the gear"
    confounded_with = ("torque_ripple", "current_ripple", "encoder_eccentricity")
    signature = (
        "Residual that repeats along the joint at a short distance and grows where its frequency meets a resonance."
    )
    experiment = (
        "One motion at several constant speeds: the error grows near the resonance of the gear, a ripple does not."
    )
    source = (
        "Tuttle and Seering: A nonlinear model of a harmonic drive gear transmission, IEEE Transactions on Robotics "
        "and Automation 12, 1996: the kinematic error, and the torque at the motor with its derivative"
    )
    signed = frozenset({"gear_cosine", "gear_sine"})
    needs_elastic = True
    frequency = "gear_number"
    is_smooth = True
    own_parameters = (
        amplitude("gear_cosine", "error of the gear, cosine of N q"),
        amplitude("gear_sine", "error of the gear, sine of N q"),
    )
    own_shapes = (
        Parameter(
            "gear_number", ("1", "1/m"), "periods of the gear's error in 2 pi of position", 100.0, limits=(1.0, 1e5),
            search=(
                Search(20.0, 340.0, 321, logarithmic=False, cost=3.0),
                Search(20.0, 3000.0, 150, logarithmic=False, cost=3.0),
            ),
        ),
    )  # fmt: skip

    def harmonics(self, motor: Motor) -> Mapping[str, tuple[Harmonic, ...]]:
        return {"gear_number": distinct(motor.mechanical("gear"))}
