"""Signals of a case from the columns of a file: found by name, in SI units, with their instants in seconds."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fmu_didim.base.diagnostics import Diagnostic
from fmu_didim.base.errors import InputError
from fmu_didim.data.signals import Array, Trajectory, Variable
from fmu_didim.data.tables.clock import clock_column, instants
from fmu_didim.data.tables.codes import FILE_LAYOUT, UNIT_CONTRADICTS, UNIT_FROM_FILE, UNIT_UNKNOWN
from fmu_didim.data.tables.columns import Column, TimeColumn, conversion, target
from fmu_didim.data.tables.table import SignalTable, split_unit
from fmu_didim.data.units import known_unit

NO_COLUMNS: Mapping[str, Column] = {}
NO_UNITS: Mapping[str, str] = {}


@dataclass(frozen=True)
class Selected:
    """Signals, and the diagnostics of how they were read."""

    signals: Trajectory
    told: tuple[Diagnostic, ...] = ()


def selected(
    table: SignalTable,
    *,
    time: TimeColumn | None = None,
    columns: Mapping[str, Column] = NO_COLUMNS,
    torque_units: Sequence[str] = (),
    is_command: bool = False,
    units: Mapping[str, str] = NO_UNITS,
    others: bool | Callable[[str], bool] = True,
    sparse: bool = False,
    of_motors: bool = False,
) -> Selected:
    """The signals of a table.

    Args:
        columns: name of a signal -> its column; all other columns of the same length keep their names, without units.
        torque_units: (n,) N.m or N of each joint, where known; is_command: whether ``tau<j>`` are commands.
        units: name of a signal -> unit in which it is wanted, SI or not.
        others: whether columns that are not among ``columns`` are signals, too; or whether one of that name is wanted,
            where a column that is not, and in which something is no number, is left out.
        sparse: whether rows in which a signal is no number, such as empty cells, are left out.
        of_motors: whether signals of joints are those of their motors, which turn, as they are in the file.

    Raises:
        InputError, UnknownNameError: a column or the time is missing, or a unit is not one of its signal.
    """
    time = time or TimeColumn()
    own = {signal: table.column(column.name) for signal, column in columns.items()}
    clock = clock_column(table, time, tuple(own.values()))
    count = _row_count(table, own, clock)
    stamps, told = instants(table, time, clock, count)
    if table.notes:
        text = f"The file was read as follows: {'; '.join(table.notes)}."
        told.insert(0, Diagnostic(FILE_LAYOUT, text, table.source))
    made: dict[str, Array] = {}
    shown: dict[str, str] = {}
    converted: list[str] = []
    further = dict(_others(table, own, clock, count, others)) if others else {}
    for signal, name in {**own, **further}.items():
        wanted = target(signal, tuple(torque_units), is_command=is_command, unit=units.get(signal))
        column = columns.get(signal, Column(name=name))
        stated = table.unit(name)
        how = conversion(signal, column, stated, wanted, where=f"{table.source}, column {name}", of_motor=of_motors)
        numbers = table.columns[name]
        numbers = numbers * how.factor if how.factor != 1.0 else numbers
        made[signal] = numbers - how.shift if how.shift else numbers
        shown[signal] = wanted.names[0] if len(wanted.names) == 1 else ""
        if how.from_file:
            converted.append(f"{signal} from {how.unit}")
        if how.contradicts:
            text = f"The case says {column.unit} for {signal}, the file says {how.contradicts} for its column {name}."
            told.append(Diagnostic(UNIT_CONTRADICTS, text, table.source))
        if stated and column.unit is None and wanted.units and known_unit(stated) is None:
            text = f"The file says {stated} for its column {name}, which is not known: {signal} was taken as "
            told.append(Diagnostic(UNIT_UNKNOWN, f"{text}{' or '.join(wanted.names)}.", table.source))
    if not made:
        raise InputError(
            "The file has a time column but no signal of its length.", where=table.source,
            next_step="Name the time column, or give rate_hz; fmu-didim data FILE lists the columns.",
        )  # fmt: skip
    if converted:
        text = f"Converted by the units in the file: {', '.join(converted)}."
        told.append(Diagnostic(UNIT_FROM_FILE, text, table.source))
    variables = tuple(Variable(signal, shown[signal]) for signal in made)
    values = np.column_stack(list(made.values()))
    kept = np.isfinite(stamps) if time.polled else np.ones(stamps.size, dtype=bool)
    if sparse:
        kept &= np.isfinite(values).all(axis=1) & np.isfinite(stamps)
    if not kept.all():
        stamps, values = stamps[kept], values[kept]
    signals = Trajectory(stamps, values, variables, source=table.source)
    return Selected(signals, tuple(told))


def _row_count(table: SignalTable, own: Mapping[str, str], clock: str | None) -> int:
    """Rows of the time column, which all columns that are asked for must have."""
    sizes = {name: table.columns[name].size for name in own.values()}
    if clock is not None:
        sizes = {clock: table.columns[clock].size, **sizes}
    if len(set(sizes.values())) > 1:
        raise InputError(
            "Columns that belong together have different lengths.", where=table.source,
            got=", ".join(f"{name}: {size}" for name, size in sizes.items()),
            next_step="Name the time column that belongs to these: time: ...; of a matrix, one column is name(1).",
        )  # fmt: skip
    if sizes:
        return next(iter(sizes.values()))
    return Counter(numbers.size for numbers in table.columns.values()).most_common(1)[0][0]


def _others(
    table: SignalTable, own: Mapping[str, str], clock: str | None, count: int, wanted: bool | Callable[[str], bool]
) -> Iterator[tuple[str, str]]:
    """Name of the signal and of the column, of columns that the case does not name."""
    names = [
        name for name, numbers in table.columns.items()
        if numbers.size == count and name != clock and name not in own.values()
        and table.times.get(name, clock) == clock and name not in table.times.values()
    ]  # fmt: skip
    bare = {name: split_unit(name)[0] if table.has_header else name for name in names}
    usual = Counter(bare.values())
    for name in names:
        signal = bare[name] if usual[bare[name]] == 1 else name
        is_of_use = not callable(wanted) or wanted(signal) or np.isfinite(table.columns[name]).all()
        if signal not in own and is_of_use:
            yield signal, name
