"""What a physical effect in the torque balance of a joint is.

An effect contributes to the inverse dynamic model the torque

    tau_e(q, dq, ddq) = sum_i c_i(q, dq, ddq; shapes) * parameter_i

linear in its parameters, with columns c_i that may depend on shape parameters (constants such as
the smoothing velocity of Coulomb friction). A new effect is one file with one final class, and
one row in ``fmu_didim.effects.EFFECTS``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import casadi as ca

from fmu_didim.signals import Variable

JointType = Literal["revolute", "prismatic"]


@dataclass(frozen=True)
class JointUnits:
    """FMI unit strings of one joint type."""

    position: str
    velocity: str
    acceleration: str
    torque: str
    viscous: str
    inertia: str


UNITS: Mapping[str, JointUnits] = {
    "revolute": JointUnits("rad", "rad/s", "rad/s2", "N.m", "N.m.s/rad", "kg.m2"),
    "prismatic": JointUnits("m", "m/s", "m/s2", "N", "N.s/m", "kg"),
}


@dataclass(frozen=True)
class JointMotion:
    """Symbolic motion of one joint: position, velocity and acceleration, CasADi scalars."""

    q: ca.SX
    dq: ca.SX
    ddq: ca.SX


class TorqueEffect(ABC):
    """One effect acting in the torque balance of a single joint.

    Class attributes:
        name: identifier used in a robot description.
        equation: the torque it adds to the inverse model.
        confounded_with: effects that data can hardly tell apart from it.
        source: where the equation comes from.
    """

    name: str
    equation: str
    confounded_with: tuple[str, ...] = ()
    source: str = ""

    @abstractmethod
    def parameters(self, joint_type: JointType) -> tuple[Variable, ...]:
        """The parameters that enter linearly, names without the joint number."""

    def shapes(self, joint_type: JointType) -> tuple[Variable, ...]:
        """The shape parameters with their default values."""
        return ()

    @abstractmethod
    def columns(self, motion: JointMotion, shapes: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        """The regressor columns c_i, in the order of the parameters."""

    def damping(self, parameters: Mapping[str, ca.SX], shapes: Mapping[str, ca.SX]) -> ca.SX:
        """A bound of |d tau_e / d dq|: it sets the integration step of the direct model."""
        return ca.SX(0)
