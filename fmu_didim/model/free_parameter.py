"""The free parameters of a loop: values (p,) -> base parameters, and values of every other part of the loop."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fmu_didim.base.errors import UnknownNameError
from fmu_didim.cosim import Indices
from fmu_didim.data.signals import Array
from fmu_didim.dynamics.effects.drive_gain import DriveGain
from fmu_didim.dynamics.load import STEMS, Load, unit_of
from fmu_didim.model.parameters import Parameters

BASE, PLANT, DELAY, LOG = "base", "plant", "delay", "log"
"""Owners of free parameters that are no component beside the plant; see :class:`FreeParameter`."""
LONGEST_DELAY = 50.0
"""Largest delay of the command that a fit may come to, in control periods."""
LONGEST_LOG_SHIFT_S = 1.0
"""Largest shift of the stamps of a log that a fit may come to, in s."""

ROUNDING = 1e-12
"""[1] Of the largest nominal value of the same unit, below which one is the rounding of a zero: a sine of pi times an
inertia that a URDF leaves at zero. A step of that size would move nothing."""


@dataclass(frozen=True)
class FreeParameter:
    """One free parameter.

    Attributes:
        name: unique, shown to the user; unit: FMI unit string.
        owner: ``base`` (a base parameter), ``plant`` (another parameter of the plant), ``external_torque`` (a torque
            from outside), ``delay`` (of the command, in samples), ``log`` (how late it is stamped, in s), ``input
            signal`` and ``output signal`` (:mod:`fmu_didim.model.signals.path`), or the name of a component.
        key: its name there.
        value: where it starts; scale: size of a noticeable change.
        lowest, highest: limits.
        effect: index of the added effect that it belongs to; None for base parameters, nuisances and those of a case.
        is_shape: whether it enters nonlinearly.
        experiment: label of the experiment to which it belongs alone; None: shared by all.
        is_start: whether it is where the motion of that experiment, or a state of a controller, starts.
        along: of a load that one experiment carries: (b,) by how much one unit of it moves each base parameter there;
            empty for all others. also: labels of further experiments with the same load.
    """

    name: str
    unit: str
    owner: str
    key: str
    value: float
    scale: float
    lowest: float = -np.inf
    highest: float = np.inf
    effect: int | None = None
    is_shape: bool = False
    experiment: str | None = None
    is_start: bool = False
    along: tuple[float, ...] = ()
    also: tuple[str, ...] = ()

    @property
    def is_load(self) -> bool:
        """Whether it belongs to a load, which adds to the base parameters of its experiment."""
        return bool(self.along)

    @property
    def is_held(self) -> bool:
        """Whether its limits leave it one value only."""
        return self.lowest == self.highest

    def held(self) -> FreeParameter:
        """The same, which stays at its value."""
        return replace(self, lowest=self.value, highest=self.value)

    def acts_in(self, label: str) -> bool:
        """Whether it acts in the experiment of this label."""
        return self.experiment is None or label in (self.experiment, *self.also)


class FreeParameters(tuple[FreeParameter, ...]):
    """The free parameters: base parameters first, those that belong to one experiment next, then all others.

    Values (p,) are in their order. A parameter of one experiment acts there instead of the shared one; one of a load
    adds to them: theta = theta_shared or own + sum of along * value.
    """

    @cached_property
    def names(self) -> tuple[str, ...]:
        """(p,) unique names."""
        return tuple(parameter.name for parameter in self)

    @property
    def units(self) -> tuple[str, ...]:
        """(p,) FMI unit strings."""
        return tuple(parameter.unit for parameter in self)

    @property
    def start(self) -> Array:
        """(p,) start values."""
        return self._start.copy()

    @cached_property
    def _start(self) -> Array:
        return np.array([parameter.value for parameter in self])

    @property
    def limits(self) -> tuple[Array, Array]:
        """(p,) lowest and (p,) highest values."""
        return np.array([k.lowest for k in self]), np.array([k.highest for k in self])

    @cached_property
    def linear_count(self) -> int:
        """Number of base parameters, shared ones and those of one experiment: the first free parameters."""
        return sum(parameter.owner == BASE for parameter in self)

    @cached_property
    def shared_base(self) -> FreeParameters:
        """The b base parameters that the experiments share."""
        return FreeParameters(k for k in self if k.owner == BASE and k.experiment is None)

    def with_values(self, values: Array) -> FreeParameters:
        """The same, starting from other values (p,)."""
        return FreeParameters(replace(k, value=float(v)) for k, v in zip(self, values, strict=True))

    def without(self, names: Collection[str]) -> FreeParameters:
        """Those of a reduced model, in which the shared base parameters of these names are zero; they have no values of
        their own in any experiment, and no load moves them."""
        kept = [place for place, k in enumerate(self.shared_base) if k.name not in names]
        return FreeParameters(
            replace(k, along=tuple(k.along[place] for place in kept)) if k.is_load else k
            for k in self
            if k.owner != BASE or k.name not in names
        )

    def limited(self, values: Array) -> Array:
        """Values (p,) moved into their limits."""
        return np.asarray(np.clip(values, *self.limits))

    def theta(self, values: Array, label: str) -> Array:
        """(b,) base parameters that act in an experiment, with what it carries."""
        theta: Array = values[self.places(label)]
        for i, direction in self.loads(label):
            theta = theta + direction * values[i]
        return theta

    def places(self, label: str) -> Indices:
        """(b,) places among all of the base parameters of the robot alone, without a load, in an experiment."""
        if label not in self._places:  # each simulation asks for them
            found = np.arange(len(self.shared_base))
            for place, i in self._own_base(label):
                found[place] = i
            found.flags.writeable = False
            self._places[label] = found
        return self._places[label]

    @cached_property
    def _places(self) -> dict[str, Indices]:
        return {}

    def loads(self, label: str) -> list[tuple[int, Array]]:
        """Place among all of each parameter of the load that an experiment carries, and (b,) along which it acts."""
        return [(i, np.array(k.along)) for i, k in self._loads if k.acts_in(label)]

    @cached_property
    def _loads(self) -> list[tuple[int, FreeParameter]]:
        return [(i, k) for i, k in enumerate(self) if k.is_load]

    def gains_of_drives(self, joints: int) -> dict[int, int]:
        """Joint, from 0, of so many -> place among all of the gain of its drive, where that is free."""
        owners = {f"{DriveGain.name}{j + 1}": j for j in range(joints)}
        return {owners[k.owner]: i for i, k in enumerate(self) if k.owner in owners}

    def map_to_base(self, label: str) -> Array:
        """(b, p) matrix that takes the values to the base parameters that act in an experiment."""
        places = self.places(label)
        found = np.zeros((places.size, len(self)))
        found[np.arange(places.size), places] = 1.0
        for i, direction in self.loads(label):
            found[:, i] += direction
        return found

    def others(self, values: Array, label: str) -> dict[str, dict[str, float]]:
        """Values of all but the base parameters in an experiment: owner -> name there -> value."""
        found: dict[str, dict[str, float]] = {}
        for i, parameter in self._others:
            if parameter.acts_in(label):
                found.setdefault(parameter.owner, {})[parameter.key] = float(values[i])
        return found

    @cached_property
    def _others(self) -> list[tuple[int, FreeParameter]]:
        return [(i, k) for i, k in enumerate(self) if k.owner != BASE]

    def spread(self, columns: Array, label: str) -> Array:
        """(N, n, linear_count) columns (N, n, b) of the base parameters that act in an experiment, over all that are
        free: those of other experiments are zero."""
        result = np.zeros((*columns.shape[:2], self.linear_count))
        result[:, :, : columns.shape[2]] = columns
        for place, i in self._own_base(label):
            result[:, :, i], result[:, :, place] = columns[:, :, place], 0.0
        for i, direction in self.loads(label):
            result[:, :, i] = columns @ direction
        return result

    def has_own_base(self, label: str) -> bool:
        """Whether an experiment has base parameters of its own: values for some of them, or a load."""
        return bool(self._own_base(label) or self.loads(label))

    def _own_base(self, label: str) -> list[tuple[int, int]]:
        """Base parameters of one experiment: place among the shared ones, place among all."""
        places = {k.key: place for place, k in enumerate(self.shared_base)}
        own = ((i, k) for i, k in enumerate(self) if k.owner == BASE and k.experiment == label and not k.is_load)
        return [(places[k.key], i) for i, k in own]

    def acts(self, i: int, label: str) -> bool:
        """Whether a free parameter acts in an experiment, which may have its own instead."""
        one = self[i]
        if one.experiment is not None:
            return one.acts_in(label)
        return all((k.owner, k.key, k.experiment) != (one.owner, one.key, label) for k in self)


def load_parameters(load: Load, label: str, also: Sequence[str] = ()) -> tuple[FreeParameter, ...]:
    """The parameters of a load that an experiment carries, as far as they are not known, from zero.

    Args:
        also: labels of other experiments with this load.
    """
    found = []
    for k, (name, stem) in enumerate(zip(load.names, load.stems, strict=True)):
        free = FreeParameter(name, unit_of(stem), BASE, name, 0.0, float(load.scale[STEMS.index(stem)]))
        along = tuple(map(float, load.directions[:, k]))
        found.append(replace(of_experiment(free, label), along=along, also=tuple(also)))
    return tuple(found)


def joint_parameter(name: str, joint: int, *, is_shape: bool) -> str:
    """Name of a parameter of an effect with the number of its joint: ``Fs1``, of a shape ``vs_1``."""
    return f"{name}_{joint}" if is_shape else f"{name}{joint}"


def plain_name(name: str, joint: int) -> str:
    """The reverse of :func:`joint_parameter`: the name without the number of its joint."""
    return name.removesuffix(str(joint)).removesuffix("_")


def base_free_parameters(parameters: Parameters, own: Mapping[str, Sequence[str]] | None = None) -> FreeParameters:
    """The base parameters as free ones, those that belong to one experiment behind those that all share.

    Args:
        own: label of an experiment -> names of the base parameters that have values of their own there.

    Raises:
        UnknownNameError: a name is no base parameter.
    """
    lowest, highest = parameters.limits()
    nominal = parameters.nominal()
    largest = {unit: max(abs(v) for u, v in zip(parameters.units, nominal, strict=True) if u == unit)
               for unit in parameters.units}  # fmt: skip
    scales = [
        float(abs(v)) if abs(v) > ROUNDING * largest[unit] else 1.0
        for unit, v in zip(parameters.units, nominal, strict=True)
    ]
    shared = tuple(
        FreeParameter(name, unit, BASE, name, float(v), scale, lowest=float(low), highest=float(high))
        for name, unit, v, scale, low, high in zip(
            parameters.names, parameters.units, nominal, scales, lowest, highest, strict=True
        )
    )
    further = []
    for label, names in (own or {}).items():
        for name in names:
            if name not in parameters.names:
                raise UnknownNameError("base parameter", name, parameters.names, where=f"experiments.{label}.own")
            further.append(of_experiment(shared[parameters.names.index(name)], label))
    return FreeParameters((*shared, *further))


def of_experiment(parameter: FreeParameter, label: str) -> FreeParameter:
    """The same parameter with a value of its own in one experiment."""
    return replace(parameter, name=f"{parameter.name}[{label}]", experiment=label)


def delay_parameter(samples: float) -> FreeParameter:
    """The delay of the command in control periods, from a value on."""
    return FreeParameter("delay", "1", DELAY, "samples", samples, 10.0, lowest=0.0, highest=LONGEST_DELAY)


def log_shift_parameter() -> FreeParameter:
    """Lag of the stamps of the log, in addition to the stated one."""
    limit = LONGEST_LOG_SHIFT_S
    return FreeParameter("log_shift", "s", LOG, "shift", 0.0, 0.01, lowest=-limit, highest=limit)
