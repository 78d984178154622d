"""Torques that act on a joint from outside the model for a while, as columns of the reference."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fmu_didim.data.signals import Array, Trajectory, Variable, periods

EXTERNAL_TORQUE = "external_torque"


@dataclass(frozen=True)
class ExternalTorque:
    """A torque that acts on a joint from outside the model for a while.

    Attributes:
        joint: from 1; begin_s, end_s: when, in the time of the loop; torque: N.m or N, positive along the joint.
        is_logged: whether the torque log shows it, as when it was added to the command.
    """

    joint: int
    begin_s: float
    end_s: float
    torque: float
    is_logged: bool = False

    def moved(self, name: str, value: float) -> ExternalTorque:
        """The same with another ``begin_s``, ``end_s`` or ``torque``."""
        values = {"begin_s": self.begin_s, "end_s": self.end_s, "torque": self.torque, name: value}
        return ExternalTorque(self.joint, is_logged=self.is_logged, **values)

    def along(self, time: Array) -> Array:
        """(K,) its mean over each control period that begins at ``time``."""
        step = periods(time)
        held = np.minimum(time + step, self.end_s) - np.maximum(time, self.begin_s)
        return np.asarray(self.torque * np.clip(held / step, 0.0, 1.0))


def with_external_torques(reference: Trajectory, external_torques: Sequence[ExternalTorque]) -> Trajectory:
    """The reference with a column ``external_torque<j>`` for each joint on which one acts."""
    if not external_torques:
        return reference
    columns: dict[str, Array] = {}
    for external in external_torques:
        name = f"{EXTERNAL_TORQUE}{external.joint}"
        if name not in columns:
            columns[name] = reference.column(name) if name in reference.names else np.zeros(reference.time.size)
        columns[name] = columns[name] + external.along(reference.time)
    names = list(dict.fromkeys((*reference.names, *columns)))
    further = [columns[name][:, None] for name in names[len(reference.names) :]]
    values = np.concatenate([reference.values, *further], axis=1)
    for name in set(columns).intersection(reference.names):
        values[:, names.index(name)] = columns[name]
    return Trajectory(reference.time, values, tuple(Variable(name) for name in names))


def held(reference: Trajectory, count: int, *, at_instants: bool = False, ramps: Collection[str] = ()) -> Trajectory:
    """A reference with ``count`` rows for each, held.

    Args:
        at_instants: whether its rows are not equally spaced, so that each period is divided by itself.
        ramps: names of the columns that go straight from row to row instead.
    """
    if at_instants:
        parts = np.diff(reference.time, append=2 * reference.time[-1] - reference.time[-2]) / count
        time = (reference.time[:, None] + parts[:, None] * np.arange(count)).ravel()
    else:
        time = reference.time[0] + reference.step / count * np.arange(reference.time.size * count)
    values = np.repeat(reference.values, count, axis=0)
    for i, name in enumerate(reference.names):
        if name in ramps:
            values[:, i] = np.interp(
                np.arange(time.size) / count, np.arange(reference.time.size), reference.values[:, i]
            )
    return replace(reference, time=time, values=values)
