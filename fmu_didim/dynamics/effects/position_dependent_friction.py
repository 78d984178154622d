import math

import casadi as ca

from fmu_didim.dynamics.effects.base import TorqueEffect
from fmu_didim.dynamics.effects.joint import OperatingRange, Parameter, Search, Surroundings, Values
from fmu_didim.dynamics.effects.steps import direction, smoothing_velocity


class PositionDependentFriction(TorqueEffect):
    """tau_e = (Fcos cos(x) + Fsin sin(x)) s(dq), x = 2 pi q/lp, s(dq) = tanh(dq/v0): amplitudes in N.m (N).

    The length lp in rad (m) after which friction repeats is a shape; one turn for a revolute joint.
    """

    name = "position_dependent_friction"
    title = "Position-dependent friction"
    equation = "(Fcos*cos(2*pi*q/lp) + Fsin*sin(2*pi*q/lp))*tanh(dq/v0)"
    confounded_with = ("load_dependent_friction",)
    signature = "Residual in a square wave of the velocity whose height repeats along the joint."
    experiment = "The same path at two speeds and with two payloads."
    source = "Armstrong-Helouvry: Control of machines with friction, 1991"
    own_parameters = (
        Parameter("Fcos", "torque", "cosine part of friction along the joint"),
        Parameter("Fsin", "torque", "sine part of friction along the joint"),
    )
    # One turn is the period of a bent or unbalanced shaft; a slide has none that is known beforehand.
    own_shapes = (
        smoothing_velocity,
        Parameter(
            "lp", "position", "length after which friction repeats", (2 * math.pi, 0.1),
            search=(None, Search(0.01, 1.0, 15, cost=3.0)),
        ),
    )  # fmt: skip

    def columns(self, at: Surroundings, shapes: Values) -> tuple[ca.SX, ...]:
        angle = 2 * math.pi * at.q / shapes["lp"]
        return (ca.cos(angle) * direction(at, shapes), ca.sin(angle) * direction(at, shapes))

    def damping(self, parameters: Values, shapes: Values, within: OperatingRange) -> ca.SX:
        return ca.sqrt(parameters["Fcos"] ** 2 + parameters["Fsin"] ** 2) / shapes["v0"]
