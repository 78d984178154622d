"""Effects that change the structure of the plant: its equations, not only a torque in them."""

from __future__ import annotations

import math
from typing import ClassVar

from fmu_didim.dynamics.effects.base import NonlinearEffect, Place
from fmu_didim.dynamics.effects.joint import Parameter, Search

LARGEST = 1e12
"""A stiffness or damping, SI units, that no gear reaches."""


class StructureEffect(NonlinearEffect):
    """One effect in the structure of a robot. All its parameters enter nonlinearly, as shapes of the robot do."""

    place: ClassVar[Place] = "structure"
    shows_on_neighbours: ClassVar[bool] = True
    known_at_start: ClassVar[bool] = True


gear_stiffness = Parameter(
    "K", "stiffness", "stiffness between motor and link", (1e4, 1e6), neutral=math.inf, limits=(1e-6, LARGEST)
)
gear_damping = Parameter("D", "viscous", "damping between motor and link", neutral=0.0, limits=(0.0, LARGEST))
motor_share = Parameter(
    "motor_share", "1", "part of the link's inertia that is the motor's, where the joint has no Ia", 0.3,
    limits=(1e-3, 0.999), search=Search(0.1, 0.5, 3, logarithmic=False),
)  # fmt: skip
"""Effects of a joint share these three."""
