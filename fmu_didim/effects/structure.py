"""Effects that change the structure of the plant: its equations, not only a torque in them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from fmu_didim.effects.base import UNITS, JointType, Place, Search
from fmu_didim.effects.nonlinear import NonlinearEffect
from fmu_didim.signals import Variable


class StructureEffect(NonlinearEffect):
    """One effect in the structure of a robot. All its parameters enter nonlinearly, as shapes of the robot do."""

    place: ClassVar[Place] = "structure"
    shows_on_neighbours: ClassVar[bool] = True
    known_at_start: ClassVar[bool] = True


LARGEST = 1e12
"""A stiffness or damping, SI units, that no gear reaches."""
GEAR_LIMITS: Mapping[str, tuple[float, float]] = {
    "K": (1e-6, LARGEST),
    "D": (0.0, LARGEST),
    "gap": (0.0, 10.0),
    "motor_share": (1e-3, 0.999),
}


def gear_stiffness(joint_type: JointType) -> Variable:
    """The stiffness ``K`` between motor and link; effects of a joint share it."""
    value = 1e4 if joint_type == "revolute" else 1e6
    return Variable("K", UNITS[joint_type].stiffness, "parameter", value, "stiffness between motor and link")


def gear_damping(joint_type: JointType) -> Variable:
    """The damping ``D`` between motor and link; effects of a joint share it."""
    return Variable("D", UNITS[joint_type].viscous, "parameter", 0.0, "damping between motor and link")


def motor_share(joint_type: JointType) -> Variable:
    """The shape ``motor_share``; effects of a joint share it."""
    text = "part of the link's inertia that is the motor's, where the joint has no Ia"
    return Variable("motor_share", "1", "parameter", 0.3, text)


def stiffness_search(joint_type: JointType) -> Search:
    """Values of ``K`` to search."""
    return Search(50.0, 5e4, 10) if joint_type == "revolute" else Search(5e3, 5e7, 10)
