"""The instants at which a controller ran, from a file, and a reference brought to them.

    t_k, k = 0, 1, ...:   the loop is simulated from t_k to t_(k+1), the controller runs at each t_k

Where the file begins later than the reference, nominal periods lead up to its first instant; what lies behind its last
instant is left out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, PROBLEM, REMARK, DiagnosedError, Diagnostic
from fmu_didim.base.errors import InputError
from fmu_didim.case.files import NONE_GIVEN, found_in, read_signals, read_stamps
from fmu_didim.case.runs.reference import (
    FEWEST_ROWS,
    SMALLER_UNITS,
    TIME_UNIT,
    at_least_two_rows,
    check_joints,
    read_reference,
    told_of_rows,
    with_derivatives,
)
from fmu_didim.case.sources import ExperimentSource, InstantsFile
from fmu_didim.checks.data.log import REFERENCE_STEP
from fmu_didim.data.excitation import Excitation
from fmu_didim.data.filters import running_median
from fmu_didim.data.signals import Array, Trajectory
from fmu_didim.data.tables import Selected

OTHER_RATE = 1.5
"""[1] Ratio of the usual period and the nominal one, either way, from which the instants are not those of the
controller: loops that run late lose a part of a period, a log of every second period two of two."""
LONG = 1.7
"""[1] Of the usual period near it, from which a period is one in which an instant lacks."""
NEAR = 21
"""[periods] From which the usual period is taken."""

INSTANTS_RATE = CATALOGUE(
    "instants-rate", PROBLEM, rank=0,
    meaning="The instants of the controller do not come at its rate: they may be those of a slower logger.",
    next_step="Name the file of the control loop itself, a row a control period; or correct the rate of the loop.",
)  # fmt: skip
INSTANTS_GAPS = CATALOGUE(
    "instants-missing", DOUBT, rank=4,
    meaning="Some instants of the controller are missing: there it is simulated as if it had not run.",
    next_step="Log every control period, or use a part of the run that has them all: from_s, to_s.",
)  # fmt: skip
CONTROL_INSTANTS = CATALOGUE(
    "control-instants", REMARK, rank=93,
    meaning="The loop is simulated from instant to instant of the controller, as asked for: its period changes.",
    next_step="",
)  # fmt: skip


def read_motion(
    source: ExperimentSource,
    folder: Path,
    *,
    step: float,
    torque_units: tuple[str, ...],
    needed: frozenset[str] = frozenset(),
    signals: Mapping[str, Trajectory] = NONE_GIVEN,
) -> Selected:
    """The reference of a run, one row a tick: a control period apart, or at the instants that the run names.

    Args:
        step: control period, s; torque_units: (n,) N.m or N of each joint; needed: columns that the loop takes.

    Raises:
        InputError: a file or column is missing, a unit is wrong, or the rows or instants are not those of the loop.
    """
    given = source.reference
    assert given is not None  # the document says so
    if source.instants is None:
        return read_reference(given, folder, step=step, torque_units=torque_units, needed=needed, signals=signals)
    instants = read_instants(source.instants, folder, step=step, signals=signals)
    where = source.instants.file
    if isinstance(given, Excitation):
        check_joints(given, len(torque_units))
        return Selected(given.at(ticks_of(instants, 0.0, given.length_s, step, where)), instants.told)
    read = read_signals(given, folder, signals, torque_units=torque_units, needed=needed)
    own, of_derivatives = with_derivatives(at_least_two_rows(read.signals, given.file), needed)
    time = ticks_of(instants, float(own.time[0]), float(own.time[-1]), step, where)
    found, of_rows = brought_to(own, time)
    return Selected(found, (*instants.told, *read.told, *found_in([*of_rows, *of_derivatives], given.file)))


@dataclass(frozen=True)
class ControlInstants:
    """(N,) instants of a controller in s, and what was found in their file."""

    time: Array
    told: tuple[Diagnostic, ...]


def read_instants(
    source: InstantsFile, folder: Path, *, step: float, signals: Mapping[str, Trajectory] = NONE_GIVEN
) -> ControlInstants:
    """The instants of a controller.

    Args:
        step: nominal control period, s.

    Raises:
        InputError: the file or its time column is missing, time does not increase, or it is not that of the loop.
    """
    stamps, told = read_stamps(source, folder, signals)
    time = stamps + source.offset_s
    if time.size < FEWEST_ROWS or not np.isfinite(time).all():
        raise InputError(
            "These are not the instants of a controller.", where=source.file,
            got=f"{time.size} rows, {int((~np.isfinite(time)).sum())} of them no numbers",
            valid=f"{FEWEST_ROWS} rows and more, a number each", next_step="Name the log that the control loop writes.",
        )  # fmt: skip
    periods = np.diff(time)
    if (periods <= 0).any():
        row = int(np.flatnonzero(periods <= 0)[0]) + 1
        raise InputError(
            "The instants do not increase.", where=source.file,
            got=f"row {row}: t = {time[row]:g} s after {time[row - 1]:g} s",
            next_step="Sort the rows by time and remove duplicates.",
        )  # fmt: skip
    _check_rate(periods, step, source.file)
    long = np.flatnonzero(periods > LONG * running_median(periods, NEAR))
    text = (
        f"The controller ran at {time.size} instants, {1000 * np.percentile(periods, 1):.4g} to "
        f"{1000 * np.percentile(periods, 99):.4g} ms apart (99 % of them; nominally {1000 * step:.4g} ms)."
    )
    found = [*told, Diagnostic(CONTROL_INSTANTS, text, source.file)]
    if long.size:
        text = (
            f"Before {long.size} instants the period is {LONG:g} times as long as usual there and more, up to "
            f"{1000 * periods.max():.4g} ms, the first time after t = {time[long[0]]:.6g} s."
        )
        found.append(Diagnostic(INSTANTS_GAPS, text, source.file, float(long.size), 0.0, "periods"))
    return ControlInstants(time, tuple(found))


def _check_rate(periods: Array, step: float, file: str) -> None:
    """Raise DiagnosedError where the usual period is far from the nominal one."""
    usual = float(np.median(periods))
    if 1 / OTHER_RATE < usual / step < OTHER_RATE:
        return
    for words, unit in SMALLER_UNITS.items():
        if 1 / OTHER_RATE < usual * unit / step < OTHER_RATE:
            text = f"The instants of the controller seem to be in {words}: they are usually {usual:.6g} apart."
            raise DiagnosedError([Diagnostic(TIME_UNIT, text, file, usual, step, "s")])
    text = (
        f"The instants are usually {1000 * usual:.6g} ms apart ({1 / usual:.6g} Hz), and the loop runs nominally at "
        f"{1 / step:.6g} Hz."
    )
    raise DiagnosedError([Diagnostic(INSTANTS_RATE, text, file, 1 / usual, 1 / step, "Hz")])


def ticks_of(instants: ControlInstants, first: float, last: float, step: float, where: str) -> Array:
    """(T,) instants of the ticks along a reference from ``first`` to ``last``, s.

    Args:
        step: nominal control period, s, of the ticks before the first instant.

    Raises:
        InputError: hardly any instant lies within the reference.
    """
    given, slack = instants.time, REFERENCE_STEP * step
    time = given[(given >= first - slack) & (given <= last + slack)]
    if time.size < FEWEST_ROWS:
        raise InputError(
            "The controller ran while the reference lasted hardly at all.", where=where,
            got=f"instants from {given[0]:g} to {given[-1]:g} s", valid=f"within {first:g} to {last:g} s",
            next_step="Check that both share one clock and its unit: instants: {time: ..., offset_s: ...}.",
        )  # fmt: skip
    before = int((time[0] - first) / step + REFERENCE_STEP)
    return np.concatenate([time[0] - step * np.arange(before, 0, -1), time])


def brought_to(found: Trajectory, time: Array) -> tuple[Trajectory, list[Diagnostic]]:
    """A reference at the instants (T,) of a controller: its own rows if they lie there, else by cubic splines through
    them."""
    from scipy.interpolate import CubicSpline  # few cases need it

    own = found.time
    if own.size == time.size and np.abs(own - time).max() <= REFERENCE_STEP * float(np.median(np.diff(time))):
        return replace(found, time=time), []
    if own.size < FEWEST_ROWS:
        raise InputError(
            "The reference is too short to be evaluated at instants.", where=found.source, got=own.size,
            next_step="Record or compute a longer reference.",
        )  # fmt: skip
    values = CubicSpline(own, found.values)(np.clip(time, own[0], own[-1]))
    return replace(found, time=time, values=np.asarray(values)), told_of_rows(found)
