"""What a physical effect is: its parameters, its equations, where it acts and what it is mistaken for.

:class:`Effect` is the root of all effects, wherever they act. :class:`TorqueEffect` acts in the torque balance
of a joint: it adds to the inverse dynamic model the torque

    tau_e = sum_i c_i(q, dq, ddq, load, t, z; shapes) * parameter_i,    dz/dt = rates(...; shapes)

linear in its amplitudes, with columns c_i that may depend on shape parameters (constants such as the smoothing
velocity of Coulomb friction), on the whole motion of the robot, on the transmitted torque, on time and on own
states z. A new effect is one file with one final class, and one row in ``fmu_didim.effects.EFFECTS``.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar, Literal, TypeAlias

import casadi as ca

from fmu_didim.effects.first_order import FirstOrder
from fmu_didim.effects.pre_check import PreCheck
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
    """One physical effect at one joint, and what discovery knows about it.

    Class attributes, what it is:
        name: identifier used in a robot description and in results.
        title: its name in words, for a user.
        equation: what it does, in one line.
        place: where it acts.
        class_name: class of effects that ordinary data cannot tell apart; the own name if it has none.
        confounded_with: names of effects that data can hardly tell apart from it.
        signature: one sentence: where the residual of a model without it shows.
        experiment: what would split it from those it is confounded with.
        source: where the equation comes from.

    Its parameters:
        is_linear: whether the torque is linear in its parameters, which then are amplitudes of columns.
        neutral: value of each parameter with which all is as without the effect, 0 if it is not here; infinite where
            only a limit is.
        limits: parameter -> lowest and highest sensible value.
        signed: names of the shape parameters that may be zero or negative; all others are positive.

    Where it acts:
        elastic: whether it puts a spring between motor and link of its joint.
        acts_on_base: whether it acts on the base of the robot, so that it is listed at joint 1.

    How it is discovered:
        is_base: whether it belongs to every base model, so that it is never proposed.
        is_composed: whether it is made of other effects, which are proposed one by one; it is still named as a member
            of its class.
        is_external: whether it stands for torques from outside, which are looked for on their own, in any number.
        rivals_external_torque: whether it may look like torques from outside and is tried in their place.
        shows_on_neighbours: whether what it does on one joint shows on others too, so that no signature tells whose it
            is and all joints are tried.
        known_at_start: whether the state in which it starts is known, so that it may be looked for where data begin.
        sets_ticks: whether it is the steepest effect that is likely: the ticks of a loop that has effects in its wiring
            are chosen for it.
        pre_check: how it is looked for before all others, if linear screening is blind to it.
        first_order: outside the torque balance: its change to first order; None if only simulations of the closed
            loop show it.
        is_smooth: outside the torque balance: whether the torque of the loop has a derivative by its parameters where
            they are neutral, which then is its signature; else simulations with some values are.
        distance: the shape that is the distance over which it builds up after a reversal; none if it is empty.
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

    is_linear: ClassVar[bool]
    neutral: ClassVar[Mapping[str, float]] = {}
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {}
    signed: ClassVar[frozenset[str]] = frozenset()

    elastic: ClassVar[bool] = False
    acts_on_base: ClassVar[bool] = False

    is_base: ClassVar[bool] = False
    is_composed: ClassVar[bool] = False
    is_external: ClassVar[bool] = False
    rivals_external_torque: ClassVar[bool] = False
    shows_on_neighbours: ClassVar[bool] = False
    known_at_start: ClassVar[bool] = False
    sets_ticks: ClassVar[bool] = False
    pre_check: ClassVar[PreCheck | None] = None
    first_order: ClassVar[FirstOrder | None] = None
    is_smooth: ClassVar[bool] = False
    distance: ClassVar[str] = ""

    @abstractmethod
    def parameters(self, joint_type: JointType) -> tuple[Variable, ...]:
        """The amplitudes, names without the joint number; zero means that the effect is absent."""

    def shapes(self, joint_type: JointType) -> tuple[Variable, ...]:
        """The shape parameters with their default values; effects of a joint share those that are equal."""
        return ()

    def search(self, joint_type: JointType) -> Mapping[str, Search]:
        """The shape parameters that are searched for when it is unknown whether the effect is there."""
        return {}

    def allows(self, shapes: Mapping[str, float]) -> bool:
        """Whether these values of its shapes go together: a window ends after it begins."""
        return True

    def supersedes(self, values: Mapping[str, float]) -> frozenset[str]:
        """Shapes of other effects of its joint that mean nothing beside it, with these values of its parameters."""
        return frozenset()

    @property
    def is_of_log(self) -> bool:
        """Whether it changes the log as a whole, and not the loop."""
        return self.place == "measurement"

    @property
    def is_proposed(self) -> bool:
        """Whether it takes part in the competition of the candidates."""
        return not (self.is_base or self.is_composed or self.pre_check is not None)

    def clipped(self, name: str, value: float) -> float:
        """A value of a parameter moved into its limits."""
        low, high = self.limits.get(name, (-math.inf, math.inf))
        return min(max(value, low), high)

    def outside_limits(self, values: Mapping[str, float]) -> str:
        """Which of these values lie outside their limits, in words, or an empty string."""
        bad = [name for name, value in values.items() if self.clipped(name, value) != value]
        return "; ".join(f"{n} = {values[n]:g} must lie in {self.limits[n][0]:g} to {self.limits[n][1]:g}" for n in bad)


class TorqueEffect(Effect):
    """One effect in the torque balance.

    Class attributes:
        needs: what :class:`Surroundings` beyond the motion of its own joint the columns depend on.
        reach: number of joints after its own that it acts on or looks at.
        acts_on_link: whether it acts on the link and sees the link's motion where a gear gives way; else it acts on the
            motor.
    """

    place: ClassVar[Place] = "torque balance"
    is_linear: ClassVar[bool] = True
    acts_on_link: ClassVar[bool] = False
    needs: ClassVar[frozenset[Need]] = frozenset()
    reach: ClassVar[int] = 0

    @property
    def is_steep(self) -> bool:
        """Whether it says how steep it is, and its torque follows from motion and states: then it is integrated
        implicitly, with the slopes of its columns."""
        says = any(
            getattr(type(self), method) is not getattr(TorqueEffect, method) for method in ("damping", "stiffness")
        )
        return says and not self.needs & {"load"}

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

    def relaxation(self, shapes: Mapping[str, ca.SX], within: OperatingRange) -> ca.SX:
        """Rate in 1/s at which own states relax that have long settled: explicit integration must stay stable there, no
        more."""
        return ca.SX(0)
