"""Named signals over time, and how they are written.

A :class:`Variable` has the attributes of an FMI scalar variable that matter outside an FMU; a
:class:`Trajectory` is a table of such variables over time. Files are read by :mod:`fmu_didim.data.tables`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from fmu_didim.base.errors import InputError, UnknownNameError, listed
from fmu_didim.data.units import DisplayUnit

Array = NDArray[np.float64]
_Thing = TypeVar("_Thing")
SAME_PERIOD = 0.02
"""[1] Of a period, by which periods of a reference of one rate may differ: its stamps may lie 1 % of one off."""


@dataclass(frozen=True)
class Variable:
    """One scalar signal or parameter.

    Attributes:
        name: the name as in FMI's ``ScalarVariable``.
        unit: SI unit in FMI syntax (``N.m``, ``rad/s``, ``kg.m2``); empty if unknown.
        causality: ``input``, ``output``, ``parameter`` or ``local``.
        start: start value in that unit.
        description: one sentence for the user.
        display: unit in which the tool that made an FMU shows it, where that is another one.
    """

    name: str
    unit: str = ""
    causality: str = "output"
    start: float = 0.0
    description: str = ""
    display: DisplayUnit | None = None

    def starting_at(self, start: float) -> Variable:
        """The same variable with another start value."""
        return self if start == self.start else altered(self, start=start)


def altered(thing: _Thing, **values: Any) -> _Thing:
    """A frozen object with other values of some attributes, which are taken as they are; what it has found out about
    itself stays known.

    For what each simulation makes anew: ``dataclasses.replace``, which checks all again, and ``copy.copy`` take several
    times as long.
    """
    changed: _Thing = object.__new__(type(thing))
    changed.__dict__.update(thing.__dict__, **values)
    return changed


@dataclass(frozen=True)
class Trajectory:
    """Signals sampled over time.

    Attributes:
        time: (N,) strictly increasing instants in s.
        values: (N, m) values, one column a variable, SI units.
        variables: the m variables.
    """

    time: Array
    values: Array
    variables: tuple[Variable, ...]
    source: str = field(default="", compare=False)

    def __post_init__(self) -> None:
        time = np.ascontiguousarray(self.time, dtype=float)
        values = np.ascontiguousarray(self.values, dtype=float)
        where = self.source or "trajectory"
        if time.ndim != 1 or values.shape != (time.size, len(self.variables)):
            raise InputError(
                "The table of a trajectory does not fit its time and its names.", where=where,
                got=f"time {time.shape}, values {values.shape}, {len(self.variables)} names",
                valid="time (N,), values (N, m), m names",
                next_step="Give one row for each instant and one name for each column.",
            )  # fmt: skip
        if time.size and not (np.isfinite(time).all() and np.isfinite(values).all()):
            wrong = ~np.isfinite(np.column_stack([time, values]))
            rows = np.flatnonzero(wrong.any(axis=1))
            names = [name for name, column in zip(("time", *self.names), wrong.T, strict=True) if column.any()]
            raise InputError(
                "A trajectory holds values that are not finite numbers.", where=where,
                got=f"{rows.size} rows, the first one is row {rows[0]} (from 0), in {listed(names)}",
                next_step="Remove or interpolate those rows.",
            )  # fmt: skip
        if time.size > 1 and not (np.diff(time) > 0).all():
            row = int(np.flatnonzero(np.diff(time) <= 0)[0]) + 1
            raise InputError(
                "Time does not increase.", where=where, got=f"row {row}: t = {time[row]:g} s after {time[row - 1]:g} s",
                next_step="Sort the rows by time and remove duplicates; where an even clock took them and stamps alone "
                "are late by chance: time: {name: ..., jittered: true}.",
            )  # fmt: skip
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "values", values)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The names of the columns."""
        return tuple(v.name for v in self.variables)

    @cached_property
    def step(self) -> float:
        """Time from the first row to the second, s: that between all rows of a reference of one rate; of one whose
        periods change the median of these."""
        return float(np.median(periods(self.time)))

    def column(self, name: str) -> Array:
        """The column of a name, (N,); raises UnknownNameError."""
        return self.select([name])[:, 0]

    @cached_property
    def extremes(self) -> tuple[Array, Array]:
        """(m,) the lowest and the highest value of each column."""
        return self.values.min(axis=0), self.values.max(axis=0)

    def first(self, count: int) -> Trajectory:
        """The same with its first columns alone."""
        return Trajectory(self.time, self.values[:, :count], self.variables[:count])

    def select(self, names: Sequence[str]) -> Array:
        """The columns of the given names, (N, len(names)); raises UnknownNameError."""
        index = {name: i for i, name in enumerate(self.names)}
        for name in names:
            if name not in index:
                raise UnknownNameError("column", name, self.names, where=self.source)
        return self.values[:, [index[name] for name in names]]

    def deviation(self, step: float) -> float:
        """Largest distance of an instant from t0 + k * step, s; kept, as a run of the loop costs little more."""
        known = self._deviations
        if step not in known:
            late = np.arange(self.time.size, dtype=float)
            late *= -step  # in place: fresh memory costs more than the sums
            late += self.time
            known[step] = float(max(late.max() - self.time[0], self.time[0] - late.min()))
        return known[step]

    @cached_property
    def _deviations(self) -> dict[float, float]:
        return {}

    def digest(self) -> str:
        """SHA-256 of time, values and names, for the provenance of a result."""
        state = hashlib.sha256(",".join(self.names).encode())
        state.update(self.time.tobytes())
        state.update(self.values.tobytes())
        return state.hexdigest()


def trajectory(time: Array, columns: Mapping[str, Array], units: Mapping[str, str] | None = None) -> Trajectory:
    """A trajectory from named columns; ``units`` gives FMI unit strings by name."""
    known = units or {}
    return Trajectory(
        time=np.asarray(time, dtype=float),
        values=np.column_stack([np.asarray(c, dtype=float) for c in columns.values()]),
        variables=tuple(Variable(name, known.get(name, "")) for name in columns),
    )


def periods(time: Array) -> float | Array:
    """From each of the instants (N,) to the next one, s: one number where they are equally spaced, but for rounding.

    Behind the last one the last period goes on.
    """
    steps = np.diff(time)
    if np.abs(steps - steps[0]).max() <= SAME_PERIOD * steps[0]:
        return float(steps[0])
    return np.append(steps, steps[-1])


_FOURTH = np.sqrt(70.0)
"""Deviation of the fourth difference of white noise of deviation one: 1 + 16 + 36 + 16 + 1."""
_MEDIAN = 0.6745
"""Median of the size of a normal variable of deviation one."""


LINES_AT_ONCE = 1000
"""[lines] Of a file that are written together."""
MANY_LINES = 5_000
"""[lines] From which a file to the last bit is written by Arrow, in a third of the time; loading it takes as long as so
many."""
EXACT_DIGITS = 17
"""[digits] That are read back to the last bit."""


def write_csv(signals: Trajectory, path: Path | str, *, digits: int = 9) -> None:
    """Write a trajectory as CSV in UTF-8 with the header ``t,<names>``.

    Args:
        digits: significant digits; 17 are read back to the last bit.
    """
    header = ",".join(("t", *signals.names))
    if digits == EXACT_DIGITS and signals.time.size >= MANY_LINES:
        _write_exactly(signals, Path(path), header)
        return
    table = np.column_stack([signals.time, signals.values])
    line = ",".join([f"%.{digits}g"] * table.shape[1]) + "\n"
    with Path(path).open("w", encoding="utf-8", newline="\n") as stream:
        stream.write(header + "\n")
        for first in range(0, len(table), LINES_AT_ONCE):  # three times as fast as one by one
            some = table[first : first + LINES_AT_ONCE]
            stream.write(line * len(some) % tuple(some.ravel().tolist()))


def _write_exactly(signals: Trajectory, path: Path, header: str) -> None:
    """The same with the fewest digits of each number that are read back to the last bit."""
    import pyarrow as pa
    from pyarrow import csv

    def as_arrow(column: Array) -> pa.Array:  # by pa.array, which asks whether it is one of pandas, that is imported
        return pa.Array.from_buffers(pa.float64(), column.size, [None, pa.py_buffer(np.ascontiguousarray(column))])

    batch = {str(i): as_arrow(column) for i, column in enumerate([signals.time, *signals.values.T])}
    with path.open("wb") as stream:
        stream.write((header + "\n").encode())
        csv.write_csv(pa.table(batch), stream, csv.WriteOptions(include_header=False))


def derivative(time: Array, values: Array) -> Array:
    """Derivative of signals (N, ...) at their own instants (N,), by a cubic spline through them."""
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(time, values)(time, 1))


def white_noise(values: Array) -> float:
    """Standard deviation of the white noise in a column (N,), from the median of its fourth differences.

    A smooth motion hardly has any; at rest a rounded column shows no noise, so that only moving rows count.
    """
    fourth = np.abs(np.diff(values, 4))
    moving = fourth[np.abs(np.diff(values)[3:]) > 0]
    return float(np.median(moving)) / (_MEDIAN * _FOURTH) if moving.size else 0.0
