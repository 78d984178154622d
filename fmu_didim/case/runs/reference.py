"""References as files have them, made fit for the loop: rows brought to the control rate, derivatives computed.

Both by a cubic spline through the rows. White noise of the deviation s in a position sampled every h becomes, by the
frequency response of the spline's derivative,

    s_dq = s g_1 / h,    s_ddq = s g_2 / h^2,    g_n^2 = mean over w in (0, pi) of |3 sin w / (2 + cos w)|^(2n)
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, PROBLEM, REMARK, DiagnosedError, Diagnostic
from fmu_didim.base.errors import InputError
from fmu_didim.case.files import NONE_GIVEN, found_in, read_signals
from fmu_didim.case.sources import ReferenceFile
from fmu_didim.checks.data.log import REFERENCE_STEP
from fmu_didim.cosim import grid_places
from fmu_didim.data.excitation import Excitation
from fmu_didim.data.signals import Array, Trajectory, Variable, derivative, periods, white_noise
from fmu_didim.data.tables import Selected

FEWEST_ROWS = 8
"""[rows] Of a reference that can be differentiated or resampled."""
DIFFERENTIATED_NOISE = 0.02
"""[1] Scatter of a velocity (acceleration) that was computed from a position, of its own standard deviation, from
which it is doubted: a planned trajectory with nine digits has less than 1e-3, an encoder of 4 096 lines at 1 kHz
more."""
BETWEEN_ROWS = 1e-3
"""[1] Of the range of a reference column by which a spline through every second row may miss the others, from which
what lies between rows is doubted; with all rows it misses a sixteenth of that."""
STARTS_MOVING = 0.01
"""[1] Of the deviation of a velocity, from which a motion has begun at its first row: the plant then starts with
it."""


REFERENCE_RATE = CATALOGUE(
    "reference-rate", PROBLEM, rank=0,
    meaning="The reference is not sampled at the control rate: it must have one row a control period.",
    next_step="Correct the rate of the loop or of the controller; where only the stamps are rounded: reference: {time: "
    "{name: ..., rate_hz: ...}}; to interpolate between the rows: reference: {resample: true}.",
)  # fmt: skip
TIME_UNIT = CATALOGUE(
    "time-unit", PROBLEM, rank=0,
    meaning="The stamps of a file are in milliseconds or microseconds, not in seconds.",
    next_step="Give its unit: time: {name: t, unit: ms}.",
)  # fmt: skip
REFERENCE_DERIVED = CATALOGUE(
    "reference-derived", REMARK, rank=93,
    meaning="The reference lacks velocities or accelerations; they were computed from its positions by a cubic spline.",
    next_step="Nothing if the controller is fed with the derivatives of its positions; else give the columns.",
)  # fmt: skip
REFERENCE_ROUGH = CATALOGUE(
    "reference-derived-from-noise", DOUBT, rank=4,
    meaning="Derivatives of the reference were computed from positions that are noisy or coarsely rounded, such as "
    "measured ones; the controller of the model then gets what that of the machine never got.",
    next_step="Give the planned positions, or the columns dq<j> that the controller got.",
)  # fmt: skip
REFERENCE_RESAMPLED = CATALOGUE(
    "reference-resampled", REMARK, rank=93,
    meaning="The rows of the reference were brought to the control rate by a cubic spline through them, as asked for.",
    next_step="Nothing if the stamps tell when a row held; if they are only rounded: time: {name: ..., rate_hz: ...}.",
)  # fmt: skip
REFERENCE_GAPS = CATALOGUE(
    "reference-gaps", DOUBT, rank=4,
    meaning="Rows of the reference are missing, and what it did there was filled in by a spline.",
    next_step="Log the reference without gaps, or take a part of the run that has none.",
)  # fmt: skip
REFERENCE_COARSE = CATALOGUE(
    "reference-coarse", DOUBT, rank=4,
    meaning="Between the rows of the reference the motion is not known well: a spline through every second row misses "
    "the others.",
    next_step="Log the reference at the control rate, or describe it by its formula (kind: ...).",
)  # fmt: skip
_WAVE = np.linspace(0.0, math.pi, 2001)
_GAIN = 3 * np.sin(_WAVE) / (2 + np.cos(_WAVE))
_NOISE_GAINS = {order: float(np.sqrt(np.mean(_GAIN ** (2 * order)))) for order in (1, 2)}

SMALLER_UNITS = {"milliseconds": 1e-3, "microseconds": 1e-6}


def read_reference(
    source: Excitation | ReferenceFile,
    folder: Path,
    *,
    step: float,
    torque_units: tuple[str, ...],
    needed: frozenset[str] = frozenset(),
    signals: Mapping[str, Trajectory] = NONE_GIVEN,
) -> Selected:
    """The reference, one row a control period; a warm-up starts before t = 0.

    Velocities and accelerations that a file lacks and the loop needs are computed.

    Args:
        step: control period, s; torque_units: (n,) N.m or N of each joint; needed: columns that the loop takes.

    Raises:
        InputError: a file or column is missing, a unit is wrong, or the rows are not one control period apart.
    """
    if isinstance(source, Excitation):
        check_joints(source, len(torque_units))
        return Selected(at_least_two_rows(source.trajectory(1.0 / step), "reference"))
    read = read_signals(source, folder, signals, torque_units=torque_units, needed=needed)
    found, told = at_least_two_rows(read.signals, source.file), [*read.told]
    if source.resample:
        found, of_rows = resampled(found, step)
        told += found_in(of_rows, source.file)
    check_reference_rate(found, step, source.file)
    if source.warm_up_s > 0 and source.period_s is not None:
        found = _with_warm_up(found, step, source.period_s, source.warm_up_s)
    found, of_derivatives = with_derivatives(found, needed)
    return Selected(found, (*told, *found_in(of_derivatives, source.file)))


def check_joints(source: Excitation, joint_count: int) -> None:
    """Raise InputError where a formula is one for another number of joints."""
    if source.joint_count != joint_count:
        raise InputError(
            "The reference has another number of joints than the robot.", where="reference", got=source.joint_count,
            valid=str(joint_count),
            next_step="Name the columns of all joints: q: [column of joint 1, ...]; fmu-didim data FILE lists them.",
        )  # fmt: skip


def at_least_two_rows(found: Trajectory, where: str) -> Trajectory:
    """The signals, unless they are an instant and no motion."""
    if found.time.size < 2:
        raise InputError(
            "One instant is no motion.", where=where, got=f"{found.time.size} rows", valid="two rows and more",
            next_step="Give a longer one; look at its duration and at the rate of the loop.",
        )  # fmt: skip
    return found


def _with_warm_up(found: Trajectory, step: float, period_s: float, warm_up_s: float) -> Trajectory:
    period, count = round(period_s / step), round(warm_up_s / step)
    if period > found.time.size:
        raise InputError(
            "The reference is shorter than its period.", where=found.source,
            got=f"{found.time[-1] - found.time[0]:g} s", valid=f">= {period_s:g} s",
            next_step="Give a whole period, or the period_s that the file has.",
        )  # fmt: skip
    before = found.values[period - count : period].copy()
    # Test signals added to the command are not part of the periodic motion.
    motion = [v.name.rstrip("0123456789") in ("q", "dq", "ddq") for v in found.variables]
    before[:, ~np.array(motion)] = 0.0
    time = found.time[0] + np.arange(-count, 0) * step
    return replace(found, time=np.concatenate([time, found.time]), values=np.vstack([before, found.values]))


def check_reference_rate(reference: Trajectory, step: float, file: str) -> None:
    """Raise DiagnosedError where the rows of a reference are not one control period (s) apart."""
    if reference.time.size < 2 or reference.deviation(step) <= REFERENCE_STEP * step:
        return
    steps = np.diff(reference.time)
    usual = float(np.median(steps))
    for words, unit in SMALLER_UNITS.items():
        if abs(usual * unit - step) <= REFERENCE_STEP * step:
            text = (
                f"The stamps of the reference seem to be in {words}: its rows are {usual:.6g} apart, a control period "
                f"lasts {step:.6g} s."
            )
            raise DiagnosedError([Diagnostic(TIME_UNIT, text, file, usual, step, "s")])
    uneven = "unevenly, usually " if np.ptp(steps) > REFERENCE_STEP * usual else ""
    text = (
        f"The reference is not sampled at the control rate: its rows are {uneven}{usual:.6g} s apart "
        f"({1 / usual:.6g} Hz), and the loop runs at {1 / step:.6g} Hz."
    )
    if uneven:
        text += f" {unevenness(reference.time)}"
    raise DiagnosedError([Diagnostic(REFERENCE_RATE, text, file, 1 / usual, 1 / step, "Hz")])


def unevenness(time: Array) -> str:
    """How far instants (N,) are from even ones, in a sentence: scatter of the clock, and rows that lack."""
    places = grid_places(time)
    step, start = np.polyfit(places, time, 1)
    off = time - start - places * step
    lacking = int(places[-1]) + 1 - time.size
    text = f"They lie {1000 * float(np.std(off)):.3g} ms (largest {1000 * float(np.ptp(off)) / 2:.3g} ms) off even ones"
    return text + (f", and {lacking} rows are missing." if lacking else ".")


def with_derivatives(found: Trajectory, needed: frozenset[str]) -> tuple[Trajectory, list[Diagnostic]]:
    """The reference with the derivatives that it lacks and that are used; what a file gives stays.

    Args:
        needed: columns that the loop takes from the reference. Velocities are computed as well where the motion has
            begun at the first row, because the plant starts with them.
    """
    made: dict[str, Array] = {}
    worst, worst_name = 0.0, ""
    for position in [name for name in found.names if name[:1] == "q" and name[1:].isdigit()]:
        given, order = position, 0
        for name in (f"d{position}", f"dd{position}"):
            if name in found.names:
                given, order = name, 0
                continue
            if found.time.size < FEWEST_ROWS:
                break
            order += 1
            rate = derivative(found.time, made.get(name[1:], found.column(given)))
            size = float(rate.std())
            if not {name, f"d{name}"} & needed and (name[:2] == "dd" or abs(rate[0]) <= STARTS_MOVING * size):
                break
            made[name] = rate
            if name in needed and size:
                noise = white_noise(_evenly(found.time, found.column(given))) * _NOISE_GAINS[order] / found.step**order
                worst, worst_name = max((worst, worst_name), (noise / size, name))
    if not made:
        return found, []
    text = f"Computed by cubic splines, because the reference lacks them: {', '.join(made)}."
    told = [Diagnostic(REFERENCE_DERIVED, text, found.source)]
    if worst > DIFFERENTIATED_NOISE:
        text = f"{worst_name} of the reference was computed from a noisy or rounded column: {100 * worst:.2g} % noise."
        told.append(Diagnostic(REFERENCE_ROUGH, text, found.source, worst, DIFFERENTIATED_NOISE, "1"))
    variables = (*found.variables, *(Variable(name) for name in made))
    return replace(found, variables=variables, values=np.column_stack([found.values, *made.values()])), told


def _evenly(time: Array, column: Array) -> Array:
    """(N,) a column at as many instants that are equally spaced."""
    from scipy.interpolate import CubicSpline  # few cases need it

    if isinstance(periods(time), float):
        return column
    return np.asarray(CubicSpline(time, column)(np.linspace(time[0], time[-1], time.size)))


def resampled(found: Trajectory, step: float) -> tuple[Trajectory, list[Diagnostic]]:
    """The reference at t_0 + k step, by cubic splines through its rows, and its diagnostics.

    Args:
        step: control period, s.

    Raises:
        InputError: it has too few rows.
    """
    from scipy.interpolate import CubicSpline  # few cases need it

    if found.time.size < FEWEST_ROWS:
        raise InputError(
            "The reference is too short to be resampled.", where=found.source, got=f"{found.time.size} rows",
            next_step="Record or compute a longer reference.",
        )  # fmt: skip
    start, count = float(found.time[0]), int((found.time[-1] - found.time[0]) / step + 1e-6) + 1
    time = start + np.arange(count, dtype=np.float64) * step
    values = CubicSpline(found.time, found.values)(np.minimum(time, found.time[-1]))
    usual = float(np.median(np.diff(found.time)))
    text = f"The rows of the reference, usually {1000 * usual:.6g} ms apart, were brought to {1 / step:.6g} Hz."
    told = [Diagnostic(REFERENCE_RESAMPLED, f"{text} {unevenness(found.time)}", found.source)]
    return replace(found, time=time, values=np.asarray(values)), [*told, *told_of_rows(found)]


def told_of_rows(found: Trajectory) -> list[Diagnostic]:
    """What keeps a spline from knowing the motion between the rows of a reference: rows that lack or are far apart."""
    from scipy.interpolate import CubicSpline  # few cases need it

    told = []
    places = grid_places(found.time)
    lacking = int(places[-1]) + 1 - found.time.size
    if lacking:
        longest = float(np.diff(found.time).max())
        text = f"{lacking} rows of the reference are missing, up to {1000 * longest:.4g} ms long; a spline fills in."
        told.append(Diagnostic(REFERENCE_GAPS, text, found.source, float(lacking), 0.0, "rows"))
    between = CubicSpline(found.time[::2], found.values[::2])(found.time[1:-1:2]) - found.values[1:-1:2]
    size = np.maximum(np.ptp(found.values, axis=0), np.finfo(float).tiny)
    missed = float((np.abs(between[1:-1]).max(axis=0) / size).max())
    if missed > BETWEEN_ROWS:
        text = f"A spline through every second row misses the others by {100 * missed:.2g} % of its range."
        told.append(Diagnostic(REFERENCE_COARSE, text, found.source, missed, BETWEEN_ROWS, "1"))
    return told
