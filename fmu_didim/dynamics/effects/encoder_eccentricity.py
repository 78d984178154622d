from collections.abc import Mapping

import casadi as ca

from fmu_didim.dynamics.effects.inserted import InsertedEffect
from fmu_didim.dynamics.effects.joint import Parameter, Search, Values
from fmu_didim.dynamics.effects.motor import Harmonic, Motor, distinct


def amplitude(name: str, text: str) -> Parameter:
    """One of the two amplitudes of the error."""
    return Parameter(name, "position", text, neutral=0.0, limits=(-1.0, 1.0), search=Search(1e-4, 1e-2, 2))


class EncoderEccentricity(InsertedEffect):
    """y = q + eccentricity_cosine cos(N q) + eccentricity_sine sin(N q), amplitudes in rad (m), N in 1/rad (1/m).

    The controller gets y for q. A velocity that it takes from the plant stays that of the joint; one that it
    computes from y has the error of y.
    """

    name = "encoder_eccentricity"
    title = "Eccentricity of the encoder"
    equation = "q_measured = q + eccentricity_cosine*cos(N*q) + eccentricity_sine*sin(N*q)"
    place = "sensor"
    confounded_with = ("torque_ripple",)
    signature = "Residual periodic in position, growing with the square of the velocity."
    experiment = "The same path at two speeds: a ripple of torque does not grow."
    source = "geometry of a code disc whose centre lies beside the axis, to first order"
    is_smooth = True
    own_parameters = (
        amplitude("eccentricity_cosine", "error of the encoder, cosine of N q"),
        amplitude("eccentricity_sine", "error of the encoder, sine of N q"),
    )
    own_shapes = (
        Parameter(
            "eccentricity_number", ("1", "1/m"), "periods of the encoder's error in 2 pi of position", 1.0,
            limits=(1.0, 1e4), search=Search(1.0, 9.0, 9, logarithmic=False, cost=3.0),
        ),
    )  # fmt: skip

    def harmonics(self, motor: Motor) -> Mapping[str, tuple[Harmonic, ...]]:
        return {"eccentricity_number": distinct(motor.mechanical("encoder on the motor"))}

    def output(self, u: ca.SX, x: ca.SX, values: Values, step: float) -> ca.SX:
        angle = values["eccentricity_number"] * u
        cosine, sine = values["eccentricity_cosine"], values["eccentricity_sine"]
        return u + cosine * ca.cos(angle) + sine * ca.sin(angle)
