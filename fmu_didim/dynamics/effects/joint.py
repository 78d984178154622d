"""A joint from the view of its effects: units, parameters of either type of joint, surroundings."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias, TypeVar

import casadi as ca

from fmu_didim.data.signals import Variable

T = TypeVar("T")
JointType = Literal["revolute", "prismatic"]
Either: TypeAlias = T | tuple[T, T]
"""One thing for joints of both types, or two: for a revolute and for a prismatic joint."""
Values: TypeAlias = Mapping[str, ca.SX]
"""Name -> expression, of parameters or of shapes."""
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
    """How a shape parameter is searched for: a grid of values, and values that are known beforehand beside it.

    The price of a value is what its choice adds to minus twice the log of the marginal likelihood. For a parameter of
    which nothing is known that is the log of its Fisher information, which grows as the number N of the samples: log N,
    one parameter. That of a frequency grows as N^3, since a phase error grows along the data: 3 log N. One of K values
    that are known beforehand, each as likely, has the probability 1/K and nothing to be fitted: 2 log K, however many
    samples there are, with the loss z^2 that the known value has against the fitted one, z standard deviations away:

        price / log N = min(cost, (2 log K + z^2) / log N)

    Source of the 3: P. M. Djuric, A model selection rule for sinusoids in white Gaussian noise, IEEE Transactions on
    Signal Processing 44 (1996).

    Attributes:
        lowest, highest: first and last value; count: number of values.
        logarithmic: whether their ratios are equal, else their differences.
        cost: parameters that the search counts as when models are compared; 3 for a frequency.
        known: values that are tried, too, as the frequencies that a motor has; any of them is as likely.
    """

    lowest: float
    highest: float
    count: int
    logarithmic: bool = True
    cost: float = 1.0
    known: tuple[float, ...] = ()

    def price(self, value: float, samples: float, *, deviation: float = 0.0) -> float:
        """Parameters that the search counts as where it has ended at a value.

        Args:
            samples: of the data that are compared; deviation: standard deviation of the value, 0 of one that was tried.
        """
        if not self.known:
            return self.cost
        off = min(abs(value - one) for one in self.known)
        if deviation <= 0:
            return self.cost if off > 0 else min(self.cost, self._choice / _parameter(samples))
        return min(self.cost, (self._choice + (off / deviation) ** 2) / _parameter(samples))

    @property
    def _choice(self) -> float:
        """Price of one of the known values."""
        return 2 * math.log(len(self.known))


def _parameter(samples: float) -> float:
    """Price of a parameter of which nothing is known."""
    return math.log(max(samples, 2.0))


@dataclass(frozen=True)
class Parameter:
    """A parameter of an effect, for joints of either type; called with a type of joint it gives the variable.

    Attributes:
        name: without the joint number.
        unit: a field of :class:`JointUnits` (``torque``) or a unit (``kg``); None for a type of joint that lacks it.
        start: value unless stated otherwise.
        neutral: value with which all is as without the effect; limits: lowest and highest sensible value.
        least: lowest physically possible value: a fit below it has found something else; None without a bound.
        usual: lowest and highest value that machines have: one certainly outside them stands for something else; None
            without bounds.
        search: how it is searched for, if it is.
    """

    name: str
    unit: Either[str | None]
    description: str
    start: Either[float] = 0.0
    neutral: float | None = None
    limits: tuple[float, float] | None = None
    least: float | None = None
    usual: tuple[float, float] | None = None
    search: Either[Search | None] = None

    def __call__(self, joint_type: JointType) -> Variable:
        """The variable of a joint of this type."""
        unit, start = _of_type(self.unit, joint_type), _of_type(self.start, joint_type)
        assert unit is not None  # what a type of joint lacks is not asked for
        return Variable(self.name, getattr(UNITS[joint_type], unit, unit), "parameter", start, self.description)

    def exists(self, joint_type: JointType) -> bool:
        """Whether joints of this type have it."""
        return _of_type(self.unit, joint_type) is not None

    def grid(self, joint_type: JointType) -> Search | None:
        """How it is searched for at joints of this type."""
        return _of_type(self.search, joint_type)

    def searched(self, search: Either[Search | None]) -> Parameter:
        """The same parameter, searched for like this."""
        return replace(self, search=search)


def _of_type(one_or_two: Either[T], joint_type: JointType) -> T:
    if isinstance(one_or_two, tuple):
        first, second = one_or_two
        return first if joint_type == "revolute" else second
    return one_or_two


@dataclass(frozen=True)
class Surroundings:
    """Quantities that a torque effect of one joint may use; CasADi expressions.

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
