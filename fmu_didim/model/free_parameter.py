"""What a loop model leaves free: a parameter of any part of the loop, with its owner, unit, scale and limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fmu_didim.base.errors import UnknownNameError
from fmu_didim.model.parameters import Parameters

BASE, PLANT, DELAY, LOG = "base", "plant", "delay", "log"
"""Owners of free parameters that are no component beside the plant; see :class:`FreeParameter`."""
LONGEST_DELAY = 50.0
"""Largest delay of the command that a fit may come to, in control periods."""
LONGEST_LOG_SHIFT_S = 1.0
"""Largest shift of the stamps of a log that a fit may come to, in s."""


@dataclass(frozen=True)
class FreeParameter:
    """One free parameter.

    Attributes:
        name: unique, shown to the user; unit: FMI unit string.
        owner: ``base`` (a base parameter), ``plant`` (another parameter of the plant), ``external_torque`` (a torque
            from outside), ``delay`` (of the command, in samples), ``log`` (how late it is stamped, in s), or the name
            of a component of the loop.
        key: its name there.
        value: where it starts; scale: size of a noticeable change.
        lowest, highest: limits.
        effect: index of the added effect that it belongs to; None for base parameters, nuisances and those of a case.
        is_shape: whether it enters nonlinearly.
        experiment: label of the experiment to which it belongs alone; None: shared by all.
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

    @property
    def is_held(self) -> bool:
        """Whether its limits leave it one value only."""
        return self.lowest == self.highest

    def acts_in(self, label: str) -> bool:
        """Whether it acts in the experiment of this label."""
        return self.experiment is None or self.experiment == label


def joint_parameter(name: str, joint: int, *, is_shape: bool) -> str:
    """Name of a parameter of an effect with the number of its joint: ``Fs1``, of a shape ``vs_1``."""
    return f"{name}_{joint}" if is_shape else f"{name}{joint}"


def plain_name(name: str, joint: int) -> str:
    """The reverse of :func:`joint_parameter`: the name without the number of its joint."""
    return name.removesuffix(str(joint)).removesuffix("_")


def base_free_parameters(
    parameters: Parameters, own: Mapping[str, Sequence[str]] | None = None
) -> tuple[FreeParameter, ...]:
    """The base parameters as free ones, those that belong to one experiment behind those that all share.

    Args:
        own: label of an experiment -> names of the base parameters that have values of their own there.

    Raises:
        UnknownNameError: a name is no base parameter.
    """
    lowest, highest = parameters.limits()
    shared = tuple(
        FreeParameter(name, unit, BASE, name, float(v), float(abs(v)) or 1.0, lowest=float(low), highest=float(high))
        for name, unit, v, low, high in zip(
            parameters.names, parameters.units, parameters.nominal(), lowest, highest, strict=True
        )
    )
    further = []
    for label, names in (own or {}).items():
        for name in names:
            if name not in parameters.names:
                raise UnknownNameError("base parameter", name, parameters.names, where=f"experiments.{label}.own")
            further.append(of_experiment(shared[parameters.names.index(name)], label))
    return (*shared, *further)


def of_experiment(parameter: FreeParameter, label: str) -> FreeParameter:
    """The same parameter with a value of its own in one experiment."""
    return replace(parameter, name=f"{parameter.name}[{label}]", experiment=label)


def delay_parameter(samples: float) -> FreeParameter:
    """The delay of the command in control periods, from a value on."""
    return FreeParameter("delay", "1", DELAY, "samples", samples, 10.0, lowest=0.0, highest=LONGEST_DELAY)


def log_shift_parameter() -> FreeParameter:
    """How late the log is stamped, beyond what is stated of it."""
    limit = LONGEST_LOG_SHIFT_S
    return FreeParameter("log_shift", "s", LOG, "shift", 0.0, 0.01, lowest=-limit, highest=limit)
