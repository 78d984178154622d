"""What a physical effect is: its parameters, its equations, where it acts and what it is mistaken for.

:class:`Effect` is the root of all effects, wherever they act. :class:`TorqueEffect` acts in the torque balance
of a joint: it adds to the inverse dynamic model the torque

    tau_e = sum_i c_i(q, dq, ddq, load, t, z; shapes) * parameter_i,    dz/dt = rates(...; shapes)

linear in its amplitudes, with columns c_i that may depend on shape parameters (constants such as the smoothing
velocity of Coulomb friction), on the whole motion of the robot, on the transmitted torque, on time and on own
states z. A new effect is one file with one final class, and one row in ``fmu_didim.effects.EFFECTS``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar, Literal, TypeAlias

import casadi as ca

from fmu_didim.signals import Variable

JointType = Literal["revolute", "prismatic"]
Place = Literal["torque balance", "drive", "sensor", "structure", "measurement"]
Need = Literal["load", "time", "other joints"]
Column: TypeAlias = ca.SX | Mapping[int, ca.SX]
"""A column of the regressor: the entry in the row of the effect's own joint, or entries by joint, from 0."""


@dataclass(frozen=True)
class JointUnits:
    """FMI unit strings of one joint type."""

    position: str
    velocity: str
    acceleration: str
    torque: str
    viscous: str
    inertia: str
    stiffness: str


UNITS: Mapping[str, JointUnits] = {
    "revolute": JointUnits("rad", "rad/s", "rad/s2", "N.m", "N.m.s/rad", "kg.m2", "N.m/rad"),
    "prismatic": JointUnits("m", "m/s", "m/s2", "N", "N.s/m", "kg", "N/m"),
}
NOMINAL_SPEED: Mapping[str, float] = {"revolute": 5.0, "prismatic": 0.5}
"""A high speed of a joint, rad/s or m/s; integration steps are chosen for it."""
NOMINAL_ACCELERATION: Mapping[str, float] = {"revolute": 10.0, "prismatic": 5.0}
"""An ordinary acceleration of a joint, rad/s2 or m/s2; integration steps are chosen for it."""


LINK_PARAMETERS: tuple[Variable, ...] = tuple(
    Variable(name, unit, "parameter", 0.0, text)
    for name, unit, text in (
        ("XX", "kg.m2", "inertia about the x axis of the link frame"),
        ("XY", "kg.m2", "product of inertia"),
        ("XZ", "kg.m2", "product of inertia"),
        ("YY", "kg.m2", "inertia about the y axis of the link frame"),
        ("YZ", "kg.m2", "product of inertia"),
        ("ZZ", "kg.m2", "inertia about the z axis of the link frame"),
        ("MX", "kg.m", "first moment along x"),
        ("MY", "kg.m", "first moment along y"),
        ("MZ", "kg.m", "first moment along z"),
        ("M", "kg", "mass of the link"),
    )
)
"""The ten inertial parameters of a link, about the origin of its frame."""
PAYLOAD: tuple[str, ...] = ("M", "MX", "MY", "MZ")
"""Those of them whose columns an effect can use."""


@dataclass(frozen=True)
class Search:
    """How a shape parameter is searched for: a grid of values.

    Attributes:
        lowest, highest: first and last value; count: number of values.
        logarithmic: whether their ratios are equal, else their differences.
        cost: parameters that the search counts as when models are compared; 3 for a frequency.
    """

    lowest: float
    highest: float
    count: int
    logarithmic: bool = True
    cost: float = 1.0


@dataclass(frozen=True)
class Surroundings:
    """What a torque effect of one joint can see; CasADi expressions.

    Attributes:
        joint: number of its joint, from 0; joint_type: that joint's type.
        all_q, all_dq, all_ddq: (n,) motion of all joints.
        load: torque that the joint transmits: gravity, inertia and Coriolis terms of the links, no effects.
        time: time of the loop in s.
        state: own states, in the order of :meth:`TorqueEffect.states`.
        link: torque (n,) of all joints for one unit of each of PAYLOAD of the link of this joint.
    """

    joint: int
    joint_type: JointType
    all_q: ca.SX
    all_dq: ca.SX
    all_ddq: ca.SX
    load: ca.SX = field(default_factory=lambda: ca.SX(0))
    time: ca.SX = field(default_factory=lambda: ca.SX(0))
    state: tuple[ca.SX, ...] = ()
    link: Mapping[str, ca.SX] = field(default_factory=dict)

    @property
    def q(self) -> ca.SX:
        """Position of the joint."""
        return self.all_q[self.joint]

    @property
    def dq(self) -> ca.SX:
        """Velocity of the joint."""
        return self.all_dq[self.joint]

    @property
    def ddq(self) -> ca.SX:
        """Acceleration of the joint."""
        return self.all_ddq[self.joint]


@dataclass(frozen=True)
class OperatingRange:
    """The motion for which integration steps are chosen.

    Attributes:
        speed, acceleration: nominal magnitudes of the joint; load: bound of the transmitted torque.
    """

    speed: float
    acceleration: float
    load: ca.SX


class Effect(ABC):
    """One physical effect at one joint.

    Class attributes:
        name: identifier used in a robot description and in results.
        title: its name in words, for a user.
        equation: what it does, in one line.
        place: where it acts.
        class_name: class of effects that ordinary data cannot tell apart; the own name if it has none.
        confounded_with: names of effects that data can hardly tell apart from it.
        signature: one sentence: where the residual of a model without it shows.
        experiment: what would split it from those it is confounded with.
        source: where the equation comes from.
        signed: names of the shape parameters that may be zero or negative; all others are positive.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    equation: ClassVar[str]
    place: ClassVar[Place]
    class_name: ClassVar[str]
    confounded_with: ClassVar[tuple[str, ...]] = ()
    signature: ClassVar[str]
    experiment: ClassVar[str]
    source: ClassVar[str]
    signed: ClassVar[frozenset[str]] = frozenset()

    @abstractmethod
    def parameters(self, joint_type: JointType) -> tuple[Variable, ...]:
        """The amplitudes, names without the joint number; zero means that the effect is absent."""

    def shapes(self, joint_type: JointType) -> tuple[Variable, ...]:
        """The shape parameters with their default values; effects of a joint share those that are equal."""
        return ()

    def search(self, joint_type: JointType) -> Mapping[str, Search]:
        """The shape parameters that are searched for when it is unknown whether the effect is there."""
        return {}


class TorqueEffect(Effect):
    """One effect in the torque balance.

    Class attributes:
        needs: what :class:`Surroundings` beyond the motion of its own joint the columns depend on.
        reach: number of joints after its own that it acts on or looks at.
    """

    place: ClassVar[Place] = "torque balance"
    needs: ClassVar[frozenset[Need]] = frozenset()
    reach: ClassVar[int] = 0

    def states(self, joint_type: JointType) -> tuple[Variable, ...]:
        """Own continuous states; ``start`` is their initial value."""
        return ()

    @abstractmethod
    def columns(self, at: Surroundings, shapes: Mapping[str, ca.SX]) -> tuple[Column, ...]:
        """The regressor columns c_i, in the order of the parameters."""

    def rates(self, at: Surroundings, shapes: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        """dz/dt of the own states; may depend on motion, time and states, not on load or acceleration."""
        return ()

    def damping(self, parameters: Mapping[str, ca.SX], shapes: Mapping[str, ca.SX], within: OperatingRange) -> ca.SX:
        """A bound of |d tau_e / d dq|: it sets the integration step of the direct model.

        Negative where the effect takes away from what another effect of the joint counts.
        """
        return ca.SX(0)

    def stiffness(self, parameters: Mapping[str, ca.SX], shapes: Mapping[str, ca.SX], within: OperatingRange) -> ca.SX:
        """A bound of |d tau_e / d q|, own states that follow q included; sets the step like :meth:`damping`."""
        return ca.SX(0)

    def own_rate(self, shapes: Mapping[str, ca.SX], within: OperatingRange) -> ca.SX:
        """Rate in 1/s that the integration must resolve whatever the inertia: own states, edges in time."""
        return ca.SX(0)
