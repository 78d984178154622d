"""Recorded inputs of a model as functions of time.

Between its rows t_i a file gives u on a straight line, or held,

    linear:  u(t) = u_i + (u_(i+1) - u_i) (t - t_i) / (t_(i+1) - t_i),      held:  u(t) = u_i,      t_i <= t < t_(i+1)

At the instants t_k of the simulation the model has u(t_k). In model exchange linear inputs go on straight from there to
u(t_(k+1)); in co-simulation they are held at the mean of both, with which the states follow them to second order in
the step, and the steps are made as short as the noise of the data asks for.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fmu_didim.base.diagnostics import Diagnostic
from fmu_didim.base.errors import InputError, UnknownNameError
from fmu_didim.case.files import NONE_GIVEN, read_samples, table_and_time
from fmu_didim.case.sources import InputsFile
from fmu_didim.data.signals import Array, Trajectory, Variable
from fmu_didim.data.tables import Column

ROUNDING_S = 1e-9
"""[1] Of the time that inputs cover by which an instant may lie outside: clocks are rounded."""


@dataclass(frozen=True, eq=False)
class RecordedInput:
    """One input: its rows at ``time`` (R,), s, ``values`` (R,), and whether a straight line leads from one to the
    next."""

    time: Array
    values: Array
    is_linear: bool

    def at(self, times: Array) -> Array:
        """(N,) u at these times; outside of the rows the first or the last one."""
        if self.is_linear:
            return np.asarray(np.interp(times, self.time, self.values))
        slack = ROUNDING_S * max(float(np.ptp(self.time)), 1.0)
        row = np.searchsorted(self.time, times + slack, side="right") - 1
        return self.values[np.clip(row, 0, self.time.size - 1)]


@dataclass(frozen=True, eq=False)
class RecordedInputs:
    """All inputs that a file gives: by the name of the input; told: what was found in the file."""

    by_name: Mapping[str, RecordedInput]
    told: tuple[Diagnostic, ...] = ()

    @property
    def rows(self) -> Array:
        """The instants of all rows, s."""
        found = [one.time for one in self.by_name.values()]
        return np.unique(np.concatenate(found)) if found else np.zeros(0)

    def along(self, ticks: Array) -> Trajectory:
        """The inputs at the ticks (T,): (T, m)."""
        columns = [one.at(ticks) for one in self.by_name.values()]
        values = np.column_stack(columns) if columns else np.zeros((ticks.size, 0))
        return Trajectory(ticks, values, tuple(Variable(name) for name in self.by_name), source="inputs")


def read_inputs(
    source: InputsFile | None,
    folder: Path,
    inputs: Mapping[str, Variable],
    *,
    held: Collection[str] = (),
    signals: Mapping[str, Trajectory] = NONE_GIVEN,
) -> RecordedInputs:
    """The recorded inputs of a model.

    Args:
        source: None where there are none; inputs: those of the model, by name; held: those that are no real numbers.

    Raises:
        InputError: the file gives no input, or one without a number in a row; UnknownNameError: the model has no such
            input.
    """
    if source is None:
        return RecordedInputs({})
    where = f"inputs: {source.file}"
    for name in source.columns:
        if name not in inputs:
            raise UnknownNameError("input of the model", name, inputs, where=where)
    table, _ = table_and_time(source, folder, signals)
    columns = {name: Column(name=name) for name in inputs if table.find(name) is not None} | dict(source.columns)
    if not columns:
        raise InputError(
            "No column of the file has the name of an input.", where=where, got=", ".join(table.columns),
            valid=", ".join(inputs) or "the model has no inputs",
            next_step="Say which column is which input: inputs: {file: ..., columns: {input: column}}."
            if inputs else "Take inputs: out of the case.",
        )  # fmt: skip
    units = {name: inputs[name].unit for name in columns}
    found, told = dict[str, RecordedInput](), list[Diagnostic]()
    for name, read in read_samples(source, folder, columns, signals, units=units).items():
        one, lacking = read.signals, table.columns[table.column(columns[name].name)].size - read.signals.time.size
        if one.time.size < 2 or lacking:
            raise InputError(
                "An input has no number in some rows.", where=f"{where}, column {columns[name].name}",
                got=f"{lacking} empty rows of {one.time.size + lacking}", valid="a number in each of two rows and more",
                next_step="Fill the rows in or take them out of the file: nothing is invented for an input.",
            )  # fmt: skip
        is_linear = source.interpolation == "linear" and name not in held
        found[name] = RecordedInput(one.time + source.offset_s, one.values[:, 0], is_linear)
        told += read.told
    return RecordedInputs(found, tuple(dict.fromkeys(told)))


def check_covered(inputs: RecordedInputs, source: InputsFile | None, first: float, last: float, label: str) -> None:
    """Raise InputError where the inputs do not reach from the first to the last instant (s) of a simulation."""
    rows = inputs.rows
    if source is None or source.outside == "hold" or not rows.size:
        return
    slack = ROUNDING_S * max(abs(first), abs(last), float(np.ptp(rows)))
    if rows[0] <= first + slack and last <= rows[-1] + slack:
        return
    raise InputError(
        "The inputs do not cover what was measured.", where=f"{label}: inputs: {source.file}",
        got=f"inputs from {rows[0]:g} to {rows[-1]:g} s", valid=f"from {first:g} to {last:g} s at least",
        next_step="Check that both files share one clock and its unit (time: {unit: ...}, offset_s), cut the run "
        "(from_s, to_s, start_s), or hold the last row: inputs: {outside: hold}.",
    )  # fmt: skip
