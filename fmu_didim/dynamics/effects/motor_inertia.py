from collections.abc import Mapping

import casadi as ca

from fmu_didim.dynamics.effects.base import TorqueEffect
from fmu_didim.dynamics.effects.joint import Parameter, Surroundings, Values


class MotorInertia(TorqueEffect):
    """tau_e = Ia * ddq, with Ia in kg.m2 (kg) on the joint's side of the gear."""

    name = "motor_inertia"
    title = "Motor inertia"
    equation = "Ia*ddq"
    signature = "Residual in proportion to the acceleration of the joint, whatever the other joints do."
    experiment = "Move the joint alone and together with the others, so that its inertia about the axis changes."
    source = "Khalil and Dombre, Modeling, Identification and Control of Robots, chapter 9"
    is_base = True
    own_parameters = (Parameter("Ia", "inertia", "motor inertia at the joint"),)

    def supersedes(self, values: Mapping[str, float]) -> frozenset[str]:
        # The motor's inertia is known by its own name.
        return frozenset({"motor_share"} if values.get("Ia", 0.0) != 0 else ())

    def columns(self, at: Surroundings, shapes: Values) -> tuple[ca.SX, ...]:
        return (at.ddq,)
