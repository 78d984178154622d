"""The instants of the rows of a file: from its time column, from rounded stamps, or counted."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from fmu_didim.base.diagnostics import Diagnostic
from fmu_didim.base.errors import InputError
from fmu_didim.data.even_clock import even_clock
from fmu_didim.data.polled import AGAIN, read_again, ticks_of
from fmu_didim.data.signals import Array
from fmu_didim.data.tables.codes import (
    COUNTED_TIME,
    ROWS_READ_AGAIN,
    STAMPS_ON_GRID,
    STAMPS_POLLED,
    STAMPS_REBUILT,
    TIME_CONTRADICTS,
)
from fmu_didim.data.tables.columns import TimeColumn
from fmu_didim.data.tables.table import SignalTable, split_unit
from fmu_didim.data.units import known_unit

STAMP_ROUNDING = 0.5
"""[1] Of a sample period by which rounded stamps may lie off the instants of the rate that is given: a stamp that is
farther off is nearer to another instant."""
SAME_RATE = 0.01
"""[1] Relative difference of the rate that is given from that of the stamps, from which they contradict each
other."""

TIME_NAMES = ("t", "time", "zeit")
_STAMP = re.compile(r"zeit|time|stamp|stempel|\buhr")
_NO_STAMP = re.compile(r"loop|cycle|ctrl|control|instant|takt|zyklus|regler|dauer|duration|delay|totzeit|rechen|comput")
"""In the name of a column that tells how long something took, or when the controller ran."""


def clock_column(table: SignalTable, time: TimeColumn, names: Sequence[str]) -> str | None:
    """The column of the instants of these columns; None where the rows are to be counted.

    Raises:
        InputError: there is no such column, or the columns have different ones.
    """
    own = {table.times[name] for name in names if name in table.times}
    if time.name is not None:
        own = own and own | {table.column(time.name)}
    elif time.rate_hz is not None and not time.is_rebuilt:
        return None
    else:
        own = own or set(table.times.values())
    if len(own) > 1:
        raise InputError(
            "Signals of one section are sampled at different instants in the file.", where=table.source,
            got=", ".join(_rows(table, clock) for clock in sorted(own)),
            next_step="Name columns of one group (columns: {q1: ...}); reference: and torque: may take different ones. "
            "Nothing is resampled unasked.",
        )  # fmt: skip
    if time.name is not None:
        return table.column(time.name)
    found = next(iter(own), None) or _by_name(table) or (table.calendar[0] if len(table.calendar) == 1 else None)
    if found is None:
        raise InputError(
            "The file has no time column.", where=table.source, got=", ".join(table.columns),
            valid=("t", "time", *(["time: its number"] if not table.has_header else [])),
            next_step="Name it: time: {name: ..., unit: ms}; or give the rate of the rows: time: {rate_hz: ...}.",
        )  # fmt: skip
    return found


def _rows(table: SignalTable, clock: str) -> str:
    return f"{clock}: {table.columns[clock].size} rows" if clock in table.columns else clock


def _by_name(table: SignalTable) -> str | None:
    if not table.has_header:
        return None
    named = {name: split_unit(name)[0] for name in table.columns}
    for usual in TIME_NAMES:
        exact = [name for name, bare in named.items() if bare == usual]
        if not exact and len(usual) > 1:  # T is a temperature
            exact = [name for name, bare in named.items() if bare.casefold() == usual]
        if len(exact) == 1:
            return exact[0]
    stamps = [name for name in stamp_columns(table) if table.unit(name)]
    return stamps[0] if len(stamps) == 1 else None


def stamp_columns(table: SignalTable) -> list[str]:
    """Columns that look like stamps: a word for time in their name, no unit but one of time, and values that grow."""
    found = []
    for name, values in table.columns.items():
        bare = split_unit(name)[0].casefold()
        known = known_unit(table.unit(name)) if table.unit(name) else None
        if not table.has_header or (known is not None and known.powers != {"s": 1}):
            continue
        if _STAMP.search(bare) and not _NO_STAMP.search(bare) and values.size > 1 and (np.diff(values) > 0).all():
            found.append(name)
    return found


def instants(table: SignalTable, time: TimeColumn, clock: str | None, count: int) -> tuple[Array, list[Diagnostic]]:
    """(N,) instants of the rows in s, not a number for a row that is left out, and the diagnostics of how they were
    found.

    Raises:
        InputError: the unit is not a unit of time, or the stamps are not rounded instants of the given rate, or not
            jittered or polled ones of an even clock.
    """
    if clock is None:
        assert time.rate_hz is not None
        told = [*_counted(table, time), *_again(table)]
        return time.start_s + np.arange(count) / time.rate_hz, told
    seconds = _seconds(table, clock, time)
    stamps = table.columns[clock]
    stamps = stamps if seconds == 1.0 else stamps * seconds
    if time.polled:
        return _of_polled(table, stamps, time)
    if time.jittered:
        return _of_even_clock(stamps, time.rate_hz, table.source, _same_rows(table, clock))
    at, told = (stamps, []) if time.rate_hz is None else _on_grid(stamps, time.rate_hz, table.source)
    return at, [*told, *_again(table, clock)]


def _same_rows(table: SignalTable, *clocks: str) -> int:
    """Number of rows that were read again, by all columns but stamps; 0 in a file of stamps alone, which shows nothing
    of it."""
    stamps = {*clocks, *stamp_columns(table)}
    count = max((c.size for c in table.columns.values()), default=0)
    others = [c for name, c in table.columns.items() if name not in stamps and c.size == count]
    return read_again(np.column_stack(others)) if others else 0


def _again(table: SignalTable, *clocks: str) -> list[Diagnostic]:
    """Whether rows were read again, which the case says nothing of."""
    same = _same_rows(table, *clocks)
    if not same:
        return []
    count = max(c.size for c in table.columns.values())
    text = f"{same} of {count} rows are the same as the one before in all columns."
    return [Diagnostic(ROWS_READ_AGAIN, text, table.source, same / count, AGAIN, "1")]


def _seconds(table: SignalTable, clock: str, time: TimeColumn) -> float:
    unit = time.unit or table.unit(clock)
    known = known_unit(unit) if unit else None
    if clock in table.calendar and known != known_unit("s"):
        raise InputError(
            "The time column holds dates or times of day, which have no unit.", where=f"{table.source}, column {clock}",
            got=unit, next_step="Leave out unit: in time: {...}.",
        )  # fmt: skip
    if known is not None and known.powers != {"s": 1}:
        raise InputError(
            "The unit of the time column is not a unit of time.", where=f"{table.source}, column {clock}", got=unit,
            next_step="Name another column, or give its unit: time: {name: ..., unit: ms}.",
        )  # fmt: skip
    return known.factor if known is not None else 1.0


def _counted(table: SignalTable, time: TimeColumn) -> list[Diagnostic]:
    text = f"Its rows were counted: {time.rate_hz:g} Hz from t = {time.start_s:g} s."
    beside = _by_name(table)
    if beside is None:
        return [Diagnostic(COUNTED_TIME, text, table.source)]
    stamps = table.columns[beside] * _seconds(table, beside, time)
    rate = (stamps.size - 1) / float(stamps[-1] - stamps[0]) if stamps[-1] != stamps[0] else np.inf
    if abs(rate / (time.rate_hz or 1.0) - 1) > SAME_RATE:
        text += f" By its column {beside} they come at {rate:.6g} Hz."
        return [Diagnostic(TIME_CONTRADICTS, text, table.source, rate, time.rate_hz, "Hz")]
    return [Diagnostic(COUNTED_TIME, f"{text} Its column {beside} was not used.", table.source)]


def _of_even_clock(stamps: Array, rate: float | None, source: str, again: int) -> tuple[Array, list[Diagnostic]]:
    """The instants of the even clock behind jittered stamps, of rows of which so many were read again."""
    clock = even_clock(stamps, rate)
    fault = clock.fault or (f"{again} rows are the same as the ones before them in all columns" if again else "")
    if fault:
        raise InputError(
            "The stamps are not jittered readings of an even clock.", where=source, got=fault,
            next_step="Leave out time: {jittered: true}, so that the stamps count, or give a log without missing rows; "
            "where a program read the newest sample at its own pace: time: {name: ..., rate_hz: that of the machine, "
            "polled: [columns of positions]}.",
        )  # fmt: skip
    text = (
        f"Its stamps scatter by {1000 * clock.scatter:.3g} ms ({1000 * clock.largest:.3g} ms at most) about the "
        f"instants of an even clock of {1 / clock.period:.6g} Hz, which were taken instead, as the case asks for."
    )
    return clock.instants(stamps.size), [Diagnostic(STAMPS_REBUILT, text, source, 1000 * clock.scatter, None, "ms")]


def _of_polled(table: SignalTable, stamps: Array, time: TimeColumn) -> tuple[Array, list[Diagnostic]]:
    """The ticks of a machine's clock behind rows that were read at a pace of their own."""
    assert time.rate_hz is not None
    names = [table.column(name) for name in time.polled]
    other = [name for name in names if table.columns[name].size != stamps.size]
    if other:
        raise InputError(
            "A column of positions that is to tell the ticks has other rows than the time column.", where=table.source,
            got=f"{other[0]}: {table.columns[other[0]].size} rows, not {stamps.size}",
            next_step="Name columns that stand in the same rows: time: {polled: [...]}.",
        )  # fmt: skip
    found = ticks_of(stamps, time.rate_hz, np.column_stack([table.columns[name] for name in names]))
    if found.fault:
        raise InputError(
            "The rows are not the newest samples of a machine, read at a pace of their own.", where=table.source,
            got=found.fault,
            next_step="Correct time: {rate_hz: ..., polled: [...]}, or leave out polled, so that the stamps count.",
        )  # fmt: skip
    text = (
        f"Its {stamps.size} rows are readings of a clock of {time.rate_hz:g} Hz at a pace of their own, as the case "
        f"says: {stamps.size - int(found.fresh.sum())} show a tick again and were left out, {found.skipped} ticks have "
        f"no row. The motion tells the ticks of {100 * found.told:.3g} % of the rows, to {found.off:.1g} of a tick; "
        f"readings are up to {1000 * found.latest:.3g} ms later than the promptest."
    )
    told = Diagnostic(STAMPS_POLLED, text, table.source, found.skipped, None, "ticks")
    return np.where(found.fresh, found.instants, np.nan), [told]


def _on_grid(stamps: Array, rate: float, source: str) -> tuple[Array, list[Diagnostic]]:
    """The nearest instants of the rate; its phase is the median of that of the stamps."""
    places = np.rint((stamps - stamps[0]) * rate)
    phase = float(np.median(stamps - places / rate))
    places = np.rint((stamps - phase) * rate)
    off = float(np.abs(stamps - phase - places / rate).max())
    twice = int((np.diff(places) < 1).sum())
    if twice or off >= STAMP_ROUNDING / rate:
        usual = 1 / float(np.median(np.diff(stamps)))
        raise InputError(
            "The stamps do not lie near the instants of that rate.", where=source,
            got=f"{rate:g} Hz; the stamps come at {usual:.6g} Hz, lie up to {1000 * off:.3g} ms off, and {twice} "
            "of them fall on the instant of another",
            next_step="Correct time: {rate_hz: ...}, or leave it out.",
        )  # fmt: skip
    lacking = int(places[-1] - places[0]) + 1 - stamps.size
    text = f"Its stamps lie up to {1000 * off:.3g} ms off the instants of {rate:g} Hz, which were taken instead"
    text += f"; {lacking} rows are missing." if lacking else "."
    return phase + places / rate, [Diagnostic(STAMPS_ON_GRID, text, source, 1000 * off, None, "ms")]
