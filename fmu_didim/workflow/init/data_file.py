"""A file of signals that a user has, and what its columns are taken for."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from fmu_didim.data.signals import Array
from fmu_didim.data.tables import SignalTable, TimeColumn
from fmu_didim.data.tables.clock import instants
from fmu_didim.workflow.init.roles import Guess, Role, guesses, time_column
from fmu_didim.workflow.init.time_unit import unit_by_motion
from fmu_didim.workflow.init.values import measured_by_values

WORDS_OF_LOOPS = r"loop|instants?|cycles?|takte?|zyklus"
"""In the name of a file: a control loop wrote it."""
TORQUES: tuple[Role, ...] = ("tau", "current", "command")
"""Roles of what a log shows of the torque, the best first."""


@dataclass(frozen=True)
class DataFile:
    """A file of signals; ``joints``: names of those of the robot, where one is given."""

    path: Path
    table: SignalTable
    joints: tuple[str, ...] = ()

    @cached_property
    def guesses(self) -> list[Guess]:
        """The guess for each column."""
        return [self._by_values(one) for one in guesses(self.table, self.joints)]

    def _by_values(self, one: Guess) -> Guess:
        """A position whose name does not say whether it was measured, and whose values do."""
        if one.role != "q" or one.side:
            return one
        why = measured_by_values(self.table.columns[one.name])
        return replace(one, side="measured", why=why) if why else one

    def clock(self, *roles: str) -> str | None:
        """The time column of the columns with these roles, of all where there are none."""
        return time_column(self.table, [g.name for g in self.guesses if g.role in roles])

    def rate_hz(self, *roles: str) -> float | None:
        """Usual rate of the rows of these columns."""
        clock = self.clock(*roles)
        if clock is None:
            return None
        step = float(np.median(np.diff(self.instants(clock))))
        return float(f"{1 / step:.4g}") if step > 0 else None

    def instants(self, clock: str) -> Array:
        """(N,) stamps of a time column in s; raises InputError where its unit is none of time."""
        time = TimeColumn(unit=self.time_unit(clock) or None)
        return instants(self.table, time, clock, self.table.columns[clock].size)[0]

    def time_unit(self, clock: str) -> str:
        """The unit of a time column of which the file says none, as its velocities tell it; empty where they do not."""
        if self.table.unit(clock) or clock in self.table.calendar or clock in self.table.times.values():
            return ""
        if clock not in self._time_units:
            self._time_units[clock] = unit_by_motion(self.table.columns[clock], self.table.columns, self.guesses)
        return self._time_units[clock]

    @cached_property
    def _time_units(self) -> dict[str, str]:
        return {}

    @property
    def is_loop_log(self) -> bool:
        """Whether it has the instants of a controller and no signals."""
        if any(g.role != "other" for g in self.guesses) or self.clock() is None:
            return False
        return not self.guesses or bool(re.search(WORDS_OF_LOOPS, self.path.stem.lower()))

    @property
    def is_temperature_log(self) -> bool:
        """Whether it has temperatures and no signals of a motion or of a drive."""
        return self.has("temperature") and not self.has("q", "dq", "ddq", *TORQUES)

    def has(self, *roles: str) -> bool:
        """Whether a column has one of these roles."""
        return any(g.role in roles for g in self.guesses)
