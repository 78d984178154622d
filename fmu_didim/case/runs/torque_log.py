"""Torque logs as files have them, made fit for the loop: commands become torques, samples come at the asked rate."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fmu_didim.base.diagnostics import CATALOGUE, PROBLEM, DiagnosedError, Diagnostic
from fmu_didim.base.errors import InputError
from fmu_didim.case.files import NONE_GIVEN, read_signals
from fmu_didim.case.runs.instants import LONG, NEAR
from fmu_didim.case.runs.reference import SMALLER_UNITS, TIME_UNIT, at_least_two_rows
from fmu_didim.case.sources import ExperimentSource, ReferenceFile, TorqueFile
from fmu_didim.cosim import Indices, Instants, decimated_times, grid_places, period_change, sample_operator
from fmu_didim.data.filters import running_median
from fmu_didim.data.signals import Array, Trajectory

COMMAND_WITHOUT_GAIN = CATALOGUE(
    "command-without-gain", PROBLEM, rank=0,
    meaning="A log of the command becomes a torque by the gains of the drives, which the case does not give.",
    next_step="Add loop: {drive_gains: [...]}, one a joint, in N.m or N for a unit of the command; ones if the two are "
    "the same.",
)  # fmt: skip

FEWEST_ROWS = 2
"""[samples] That a log must have: one tells nothing of a motion."""
ROUNDING_S = 1e-9
"""[s] By which a row may lie outside the part of a run that is used."""


@dataclass(frozen=True)
class TorqueLog:
    """The torque log of one run.

    Attributes:
        times: (N,) instants of the samples on the clock of the reference, s; torque: (N, n) N.m or N.
        stamps: of the rows of the file, s; told: what was found in it.
    """

    times: Array
    torque: Array
    stamps: Array
    told: tuple[Diagnostic, ...]


def read_torque_log(
    source: ExperimentSource,
    folder: Path,
    reference: Trajectory,
    *,
    step: float,
    drive_gains: tuple[float, ...] | None,
    torque_units: tuple[str, ...],
    label: str,
    signals: Mapping[str, Trajectory] = NONE_GIVEN,
) -> TorqueLog:
    """The log of one run, at the rate that the case asks for.

    Args:
        reference: of the run; step: control period, s; drive_gains: of a log of the command.

    Raises:
        InputError: the log or a column is missing, its time is in another unit, or it reaches beyond the reference.
    """
    file = source.torque
    if file is None:
        raise InputError(
            "The torque log is missing.", where=label,
            next_step="Add torque: {file: ...} to it. Without, the case can be simulated, but nothing be identified.",
        )  # fmt: skip
    read = read_signals(file, folder, signals, torque_units=torque_units)
    log = at_least_two_rows(read.signals, file.file)
    torque = log.select([f"tau{j}" for j in range(1, len(torque_units) + 1)])
    if file.quantity == "command":
        torque = torque_of_command(torque, drive_gains, label)
    if file.unsigned and float(torque.min()) < 0:
        raise InputError(
            "A log without signs has negative values.", where=f"{label}: torque.unsigned",
            got=f"{int(np.sum(torque < 0))} values below 0, the least {torque.min():.4g}", valid="0 or more",
            next_step="Leave unsigned out if the log has signs; correct the zero of a sensor that reads below 0.",
        )  # fmt: skip
    check_time_unit(log, reference, file.file)
    kept = _part(log.time + file.offset_s, source)
    log, torque = replace(log, time=log.time[kept], values=log.values[kept]), torque[kept]
    times = log.time
    if file.rate_hz is not None:
        changes = source.instants is not None or period_change(log.time) is not None
        times, torque = _torque_at(log, torque, file, changes=changes)
        if times.size < FEWEST_ROWS:
            raise InputError(
                "Hardly any sample of the log is left at the rate that is asked for.", where=f"{label}: torque.rate_hz",
                got=f"{file.rate_hz:g} Hz, {times.size} samples in {np.ptp(log.time):g} s",
                next_step="Leave rate_hz out, or give a higher one: the rate of the log is the usual one.",
            )  # fmt: skip
    times = times + file.offset_s
    check_within(times, reference, step, source)
    return TorqueLog(times, torque, log.time, read.told)


def _part(times: Array, source: ExperimentSource) -> NDArray[np.bool_]:
    """(N,) which rows of a log lie in the part of the run that is used; raises InputError where hardly any does."""
    first, last = (limit if limit is not None else other for limit, other in (
        (source.from_s, -math.inf), (source.to_s, math.inf)))  # fmt: skip
    kept = (times >= first - ROUNDING_S) & (times <= last + ROUNDING_S)
    if kept.sum() < FEWEST_ROWS:
        raise InputError(
            "The log has no samples in the part of the run that is to be used.", where="from_s, to_s",
            got=f"{first:g} to {last:g} s", valid=f"within {times[0]:g} to {times[-1]:g} s",
            next_step="Choose from_s and to_s within the log, in its own time.",
        )  # fmt: skip
    return np.asarray(kept)


def _torque_at(log: Trajectory, torque: Array, source: TorqueFile, *, changes: bool) -> tuple[Array, Array]:
    """Instants (N,) and samples (N, n) of a log at the rate that is asked for: the values that hold there, or their
    averages; none where the log lacks a row that is needed.

    Args:
        changes: whether its rows come at a rate that changes, so that they hold until the next one.
    """
    assert source.rate_hz is not None
    places = _places(log.time) if changes else grid_places(log.time)
    step = float((log.time[-1] - log.time[0]) / places[-1])
    whole = np.full((int(places[-1]) + 1, torque.shape[1]), np.nan)
    whole[places] = torque
    instants = Instants(np.interp(np.arange(len(whole)), places, log.time), step) if changes else None
    times = decimated_times(log.time, source.rate_hz, source.phase_s)
    operator = sample_operator(
        times, start=float(log.time[0]), step=step, tick_count=len(whole), instants=instants,
        **source.sampled,
    )  # fmt: skip
    sampled = operator.apply(whole[operator.ticks])
    known = np.isfinite(sampled).all(axis=1)
    return times[known], sampled[known]


def _places(times: Array) -> Indices:
    """(N,) places of rows whose period changes: a step counts as many as periods that are usual near it fit into it."""
    steps = np.diff(times)
    usual = running_median(steps, NEAR)
    counts = np.where(steps > LONG * usual, np.rint(steps / usual), 1).astype(np.int64)
    return np.concatenate([[0], np.cumsum(counts)])


def check_time_unit(log: Trajectory, reference: Trajectory, file: str) -> None:
    """Raise DiagnosedError where a log lasts longer than its reference, and would not with stamps in another unit."""
    length, lasts = float(np.ptp(reference.time)) + reference.step, float(np.ptp(log.time))
    for words, unit in SMALLER_UNITS.items():
        if lasts > length and 0.5 * length <= lasts * unit <= length:
            text = (
                f"The stamps of the log seem to be in {words}: it would last {lasts:.6g} s, and its reference lasts "
                f"{length:.6g} s."
            )
            raise DiagnosedError([Diagnostic(TIME_UNIT, text, file, lasts, length, "s")])


def check_within(times: Array, reference: Trajectory, step: float, source: ExperimentSource) -> None:
    """Raise InputError that names both files where the samples of a log at these times lie outside the reference."""
    first, last = float(reference.time[0]), float(reference.time[-1]) + step
    outside = times[(times < first - step) | (times > last + step)]
    if outside.size == 0 or source.torque is None:
        return
    motion = source.reference.file if isinstance(source.reference, ReferenceFile) else "a formula of the case"
    raise InputError(
        f"The torque log {source.torque.file} reaches beyond its reference ({motion}).", where=source.torque.file,
        got=f"{outside.size} samples, the first one at t = {outside[0]:g} s",
        valid=f"t from {first:g} s to {last:g} s, which the reference covers",
        next_step="Check the clock and the unit of time of both files (time: {unit: ...}, offset_s); cut the log or "
        "give the whole reference.",
    )  # fmt: skip


def torque_of_command(command: Array, drive_gains: tuple[float, ...] | None, label: str) -> Array:
    """(N, n) torque of a log of the command; raises DiagnosedError without the gains of the drives."""
    if drive_gains is None:
        text = "The log shows the command, and the gains of the drives are not given."
        raise DiagnosedError([Diagnostic(COMMAND_WITHOUT_GAIN, text, f"{label}: torque.quantity")])
    if len(drive_gains) != command.shape[1]:
        raise InputError(
            "One drive gain is needed for each joint.", where="loop.drive_gains", got=list(drive_gains),
            valid=f"{command.shape[1]} numbers", next_step="Give a list with a number for each joint.",
        )  # fmt: skip
    return np.asarray(command * np.array(drive_gains))
