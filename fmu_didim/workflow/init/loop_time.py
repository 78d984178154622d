"""What files say of the time of the loop: when the controller ran, and whether the motion begins at rest."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fmu_didim.base.errors import InputError
from fmu_didim.case.runs.instants import OTHER_RATE
from fmu_didim.checks.data.log import OF_THE_LOOP
from fmu_didim.cosim.instants import PeriodChange, period_change
from fmu_didim.data.signals import Array
from fmu_didim.estimators.initial_states import MOVING
from fmu_didim.workflow.init.data_file import DataFile
from fmu_didim.workflow.init.inventory import Inventory, key_of
from fmu_didim.workflow.init.runs import FilesOfRun

_OF_LOOP = r"loop|cycle|ctrl|control|instant|takt|zyklus|regler"
"""In the name of a column of instants of a controller."""


@dataclass(frozen=True)
class LoopTime:
    """Instants of the controller of a run.

    Attributes:
        data: the file whose rows they are; column: of its instants, None for its time column.
        reason: why they are taken for that; is_certain: whether they are, or may be.
    """

    data: DataFile
    column: str | None
    reason: str
    is_certain: bool = True


def loop_time(found: Inventory, run: FilesOfRun) -> LoopTime | None:
    """The instants at which the controller of a run ran, as far as files show them; None where its period does not
    change, as far as anyone can see."""
    own = [d for d in found.loop_logs if key_of(d.path) == run.label]
    own = own or (found.loop_logs if len(found.loop_logs) == 1 else [])
    if own:
        return LoopTime(own[0], None, "a file of instants and no signals")
    period = _period(run.reference, "q")
    for data in (run.torque, run.reference):
        for guess in data.guesses:
            if guess.role == "other" and re.search(_OF_LOOP, guess.name.lower()) and _may_be(data, guess.name, period):
                return LoopTime(data, guess.name, f"{guess.name} has instants a control period apart")
    change = _change(run.reference, "q")
    if change is not None:  # which has a row a control period
        return LoopTime(run.reference, None, f"its rows come at a period that changes {change.text}")
    change = _change(run.torque, "tau", "current", "command")
    if change is None or period is None:
        return None
    of_loop = abs(change.shortest / period - 1) <= OF_THE_LOOP
    return LoopTime(run.torque, None, f"its rows come at a period that changes {change.text}", is_certain=of_loop)


def control_rate_hz(data: DataFile) -> float | None:
    """Rate of the rows of a reference; where their period changes, by the shortest one: loops run late, not early."""
    change = _change(data, "q")
    return data.rate_hz("q") if change is None else float(f"{1 / change.shortest:.3g}")


def begins_moving(data: DataFile, columns: Sequence[str]) -> bool:
    """Whether one of these positions moves in its first row."""
    time = _times(data, data.clock("q"))
    if time is None or time.size < 3 or not (np.diff(time) > 0).all():
        return False
    speeds = [np.abs(np.gradient(data.table.columns[name], time)) for name in columns if name in data.table.columns]
    return any(speed[0] > MOVING * speed.max() for speed in speeds)


def _times(data: DataFile, clock: str | None) -> Array | None:
    """(N,) instants of a time column in s; None without one, or where it has no unit of time."""
    if clock is None:
        return None
    try:
        return data.instants(clock)
    except InputError:
        return None


def _period(data: DataFile, *roles: str) -> float | None:
    rate = data.rate_hz(*roles)
    return None if rate is None else 1 / rate


def _change(data: DataFile, *roles: str) -> PeriodChange | None:
    time = _times(data, data.clock(*roles))
    return None if time is None or time.size < 2 or not (np.diff(time) > 0).all() else period_change(time)


def _may_be(data: DataFile, column: str, period: float | None) -> bool:
    """Whether a column has increasing instants about a control period apart."""
    time = _times(data, column)
    if period is None or time is None or time.size < 2 or not np.isfinite(time).all():
        return False
    steps = np.diff(time)
    return bool((steps > 0).all()) and 1 / OTHER_RATE < float(np.median(steps)) / period < OTHER_RATE
