"""The interface of a physical effect: parameters, equations, place, and what it is confounded with.

:class:`Effect` is the root of all effects, wherever they act. :class:`TorqueEffect` acts in the torque balance
of a joint: it adds to the inverse dynamic model the torque

    tau_e = sum_i c_i(q, dq, ddq, load, t, z; shapes) * parameter_i,    dz/dt = rates(...; shapes)

linear in its amplitudes, with columns c_i that may depend on shape parameters (constants such as the smoothing
velocity of Coulomb friction), on the whole motion of the robot, on the transmitted torque, on time and on own
states z. A new effect is one file with one final class, and one row in ``fmu_didim.dynamics.effects.EFFECTS``.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import ClassVar, Literal

import casadi as ca

from fmu_didim.data.signals import Variable
from fmu_didim.dynamics.effects.first_order import FirstOrder
from fmu_didim.dynamics.effects.joint import (
    Column,
    JointType,
    OperatingRange,
    Parameter,
    Search,
    Surroundings,
    Values,
)
from fmu_didim.dynamics.effects.motor import Harmonic, Motor
from fmu_didim.dynamics.effects.stated_size import StatedSize

SURE = 2.0
"""Standard deviations by which a value must be out of the possible range to be called impossible."""
Place = Literal["torque balance", "controller", "drive", "sensor", "structure", "measurement"]
Need = Literal["load", "time", "other joints"]


def start_name(state: str, joint: int) -> str:
    """The parameter of a plant in which a measured state of a joint, counted from 1, starts."""
    return f"{state}_start{joint}"


def _range(low: float, high: float) -> str:
    return f"{low:g} or more" if math.isinf(high) else f"{low:g} to {high:g}"


@dataclass(frozen=True)
class PreCheck:
    """How a limit of the torque is looked for, to which linear screening is blind: values of its parameters, tried in
    full simulations before all other effects.

    A constant limit has one parameter. One that falls with the speed, parameter * (1 - |dq| / speed) for what drives
    the motion, has two; since it holds the constant one, it is tried where clipping the simulated torque along such a
    line promises something, and beside every constant limit that is promising.

    Attributes:
        parameter: its name; in N.m or N, at rest.
        quantiles: of the absolute measured torque of the joint, which are tried as its values; of a limit that falls,
            of what the torque would be at rest on a line through it.
        speed: name of the parameter at which nothing is left; empty of a constant limit.
        speeds: grid of its values, as multiples of the largest speed of the joint.
        flattest: the largest multiple that a fit may find: what falls less is a constant limit.
    """

    parameter: str
    quantiles: tuple[float, ...]
    speed: str = ""
    speeds: Search | None = None
    flattest: float = math.inf


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
        own_parameters: the amplitudes; zero means that the effect is absent.
        own_shapes: the shape parameters; effects of a joint share those that are equal.
        is_linear: whether the torque is linear in its parameters, which then are amplitudes of columns.
        neutral: value of each parameter with which all is as without the effect, 0 if it is not here; infinite where
            only a limit is.
        limits: parameter -> lowest and highest sensible value.
        signed: names of the shape parameters that may be zero or negative; all others are positive.

    Where it acts:
        elastic: whether it puts a spring between motor and link of its joint.
        needs_elastic: whether it acts in such a spring, so that its joint has another effect that puts one there.
        acts_on_base: whether it acts on the base of the robot, so that it is listed at joint 1.
        given_states: names of those of its states whose start is measured: each run states them, as parameters
            ``<state>_start<joint>`` of the plant.

    How it is discovered:
        is_base: whether it belongs to every base model, so that it is never proposed.
        is_composed: whether it is made of other effects, which are proposed one by one; it is still named as a member
            of its class.
        is_form: whether it is the form of something without a name, and proposed where nothing of the catalogue fits.
        is_external: whether it stands for torques from outside, which are looked for on their own, in any number.
        rivals_external_torque: whether it may look like torques from outside and is tried in their place.
        shows_on_neighbours: whether what it does on one joint shows on others too, so that no signature tells whose it
            is and all joints are tried.
        is_shared: whether joints have it in common, as what one lubricant does: named on one, it is looked for on all.
        known_at_start: whether the state in which it starts is known, so that it may be looked for where data begin.
        shows_at_start: whether it shows most in how the loop comes from where it starts to the motion, so that it is
            looked for where data begin if the data after that tell it, but too little; with a ``pre_check`` always.
        sets_ticks: whether it is the steepest effect that is likely: the ticks of a loop that has effects in its wiring
            are chosen for it.
        has_minima: whether its sum of squares has many local minima, so that it is looked for in the whole range of its
            parameters.
        pre_check: how it is looked for before all others, if linear screening is blind to it.
        first_order: outside the torque balance: its change to first order; None if only simulations of the closed
            loop show it.
        is_smooth: outside the torque balance: whether the torque of the loop has a derivative by its parameters where
            they are neutral, which then is its signature; else simulations with some values are.
        is_stated: whether the case states what it changes, as the gains of a controller: it is named before what it is
            confounded with only where it explains much more.
        stands_for: names of effects that, together on its joint, it may stand for: it is named only where it explains
            more than they do.
        simple_form: names of effects that together, on its joint, are a simple form of it: named instead where they
            explain as much, and where its own form is not told.
        bends: name of the effect whose law it bends, without which hardly any machine has it; none if it is empty.
        rest: name of the effect that is the constant of its rest, where its own torque is proportional to the position;
            none if it is empty.
        distance: the shape that is the distance over which it builds up after a reversal; none if it is empty.
        frequency: the shape that is the spatial frequency, in rad per rad or m of the joint, at which it repeats and by
            which alone it is known; none if it is empty.

    What a verdict says of it:
        stated: how the smallest size is stated that data would have shown; None where none is.
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

    own_parameters: ClassVar[tuple[Parameter, ...]] = ()
    own_shapes: ClassVar[tuple[Parameter, ...]] = ()
    is_linear: ClassVar[bool]
    signed: ClassVar[frozenset[str]] = frozenset()

    elastic: ClassVar[bool] = False
    needs_elastic: ClassVar[bool] = False
    acts_on_base: ClassVar[bool] = False
    given_states: ClassVar[frozenset[str]] = frozenset()

    is_base: ClassVar[bool] = False
    is_composed: ClassVar[bool] = False
    is_form: ClassVar[bool] = False
    is_external: ClassVar[bool] = False
    rivals_external_torque: ClassVar[bool] = False
    shows_on_neighbours: ClassVar[bool] = False
    is_shared: ClassVar[bool] = False
    known_at_start: ClassVar[bool] = False
    shows_at_start: ClassVar[bool] = False
    sets_ticks: ClassVar[bool] = False
    has_minima: ClassVar[bool] = False
    is_stated: ClassVar[bool] = False
    pre_check: ClassVar[PreCheck | None] = None
    first_order: ClassVar[FirstOrder | None] = None
    is_smooth: ClassVar[bool] = False
    stands_for: ClassVar[tuple[str, ...]] = ()
    simple_form: ClassVar[tuple[str, ...]] = ()
    bends: ClassVar[str] = ""
    rest: ClassVar[str] = ""
    distance: ClassVar[str] = ""
    frequency: ClassVar[str] = ""
    stated: ClassVar[StatedSize | None] = None

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if "name" in vars(cls) and not hasattr(cls, "class_name"):
            cls.class_name = cls.name

    @cached_property
    def neutral(self) -> Mapping[str, float]:
        return {p.name: p.neutral for p in (*self.own_parameters, *self.own_shapes) if p.neutral is not None}

    @cached_property
    def limits(self) -> Mapping[str, tuple[float, float]]:
        return {p.name: p.limits for p in (*self.own_parameters, *self.own_shapes) if p.limits is not None}

    def parameters(self, joint_type: JointType) -> tuple[Variable, ...]:
        """The amplitudes at a joint of this type."""
        return tuple(p(joint_type) for p in self.own_parameters if p.exists(joint_type))

    def shapes(self, joint_type: JointType) -> tuple[Variable, ...]:
        """The shape parameters at a joint of this type, with their default values."""
        return tuple(p(joint_type) for p in self.own_shapes if p.exists(joint_type))

    def search(self, joint_type: JointType) -> Mapping[str, Search]:
        """The parameters that are searched for when it is unknown whether the effect is there."""
        grids = {p.name: p.grid(joint_type) for p in (*self.own_parameters, *self.own_shapes)}
        return {name: grid for name, grid in grids.items() if grid is not None}

    def harmonics(self, motor: Motor) -> Mapping[str, tuple[Harmonic, ...]]:
        """Shape -> the spatial frequencies that it has on a joint with this motor; empty of one that knows none."""
        return {}

    def allows(self, shapes: Mapping[str, float]) -> bool:
        """Whether these values of its shapes go together: a window ends after it begins."""
        return True

    def acts(self, shapes: Mapping[str, float]) -> tuple[float, float] | None:
        """Begin and end in s of the time in which it acts, with these values of those shapes that are searched for;
        None of one that always may."""
        return None

    def acts_between(self, shapes: Mapping[str, float]) -> tuple[float, float] | None:
        """Lowest and highest position of its joint at which it acts, with these values of those shapes that are
        searched for; None of one that acts wherever the joint is."""
        return None

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
        return not (self.is_base or self.is_composed or self.is_form or self.pre_check is not None)

    def clipped(self, name: str, value: float) -> float:
        """A value of a parameter moved into its limits."""
        low, high = self.limits.get(name, (-math.inf, math.inf))
        return min(max(value, low), high)

    def impossible(self, values: Values, deviations: Values, link: Values) -> str:
        """Which of the values found are physically impossible, in words, or an empty string.

        Args:
            deviations: their standard deviations; link: inertial parameters of the link, as far as they are known.
        """
        least = {p.name: p.least for p in self.own_parameters if p.least is not None and p.name in values}
        bad = [name for name, bound in least.items() if values[name] < bound - SURE * deviations[name]]
        return "; ".join(f"{n} = {values[n]:.3g} ± {deviations[n]:.2g} below {least[n]:g}" for n in bad)

    def unusual(self, values: Values, deviations: Values) -> str:
        """Which of the values found hardly any machine has, in words, or an empty string; arguments as above."""
        usual = {p.name: p.usual for p in self.own_parameters if p.usual is not None and p.name in values}
        bad = [
            name for name, (low, high) in usual.items()
            if not low - SURE * deviations[name] <= values[name] <= high + SURE * deviations[name]
        ]  # fmt: skip
        return "; ".join(f"{n} = {values[n]:.3g} ± {deviations[n]:.2g}, usual is {_range(*usual[n])}" for n in bad)

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
        added_to_link: amplitude -> inertial parameter of the link that it adds to, which is stated in the link's frame.
        couples_motors: whether it says that a motor turns with its joint and the next one, so that what repeats in a
            turn of that motor does not in the position of either.
    """

    place: ClassVar[Place] = "torque balance"
    is_linear: ClassVar[bool] = True
    acts_on_link: ClassVar[bool] = False
    needs: ClassVar[frozenset[Need]] = frozenset()
    reach: ClassVar[int] = 0
    added_to_link: ClassVar[Mapping[str, str]] = MappingProxyType({})
    couples_motors: ClassVar[bool] = False

    @property
    def is_steep(self) -> bool:
        """Whether it says how steep it is: then it is integrated implicitly, with the slopes of its columns."""
        return any(
            getattr(type(self), method) is not getattr(TorqueEffect, method) for method in ("damping", "stiffness")
        )

    @property
    def sets_rate(self) -> bool:
        """Whether it sets a rate that the integration must resolve or be stable at, whatever its amplitudes."""
        return any(
            getattr(type(self), method) is not getattr(TorqueEffect, method) for method in ("own_rate", "relaxation")
        )

    def states(self, joint_type: JointType) -> tuple[Variable, ...]:
        """Own continuous states; ``start`` is their initial value."""
        return ()

    @abstractmethod
    def columns(self, at: Surroundings, shapes: Values) -> tuple[Column, ...]:
        """The regressor columns c_i, in the order of the parameters."""

    def rates(self, at: Surroundings, shapes: Values) -> tuple[ca.SX, ...]:
        """dz/dt of the own states; may depend on motion, time and states, not on load or acceleration."""
        return ()

    def damping(self, parameters: Values, shapes: Values, within: OperatingRange) -> ca.SX:
        """A bound of |d tau_e / d dq|: it sets the integration step of the direct model.

        Negative where the effect takes away from what another effect of the joint counts.
        """
        return ca.SX(0)

    def stiffness(self, parameters: Values, shapes: Values, within: OperatingRange) -> ca.SX:
        """A bound of |d tau_e / d q|, own states that follow q included; sets the step like :meth:`damping`."""
        return ca.SX(0)

    def own_rate(self, shapes: Values, within: OperatingRange) -> ca.SX:
        """Rate in 1/s that the integration must resolve whatever the inertia: own states, edges in time."""
        return ca.SX(0)

    def relaxation(self, shapes: Values, within: OperatingRange) -> ca.SX:
        """Rate in 1/s at which own states relax that have long settled: explicit integration must stay stable there, no
        more."""
        return ca.SX(0)


class NonlinearEffect(Effect):
    """One effect outside the torque balance: its parameters are no amplitudes of columns.

    Each parameter has its value in ``neutral`` and a grid in :meth:`search`.
    """

    is_linear: ClassVar[bool] = False


class ControllerEffect(NonlinearEffect):
    """An effect within a controller: its parameters are factors of parameters that the controller has."""

    place: ClassVar[Place] = "controller"

    @abstractmethod
    def gains(self, parameters: Iterable[Variable], joint: int) -> Mapping[str, str]:
        """Its own parameters that have something to multiply, each with the name of that.

        Args:
            parameters: of a controller; joint: from 1.
        """


class MeasurementEffect(NonlinearEffect):
    """An effect of the torque log as a whole; the loop runs as without it.

    Its one parameter is the lag of the log in s: the samples at t show the torque at t - lag, of all joints.
    """

    place: ClassVar[Place] = "measurement"
