"""What makes the files of an experiment unusable before there is a loop to compare them with."""

from __future__ import annotations

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, PROBLEM, DiagnosedError, Diagnostic
from fmu_didim.base.errors import InputError
from fmu_didim.case.sources import ExperimentSource, ReferenceFile
from fmu_didim.checks.data.log import REFERENCE_STEP
from fmu_didim.cosim import grid_places
from fmu_didim.data.signals import Array, Trajectory

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
COMMAND_WITHOUT_GAIN = CATALOGUE(
    "command-without-gain", PROBLEM, rank=0,
    meaning="A log of the command becomes a torque by the gains of the drives, which the case does not give.",
    next_step="Add loop: {drive_gains: [...]}, one a joint, in N.m or N for a unit of the command; ones if the two are "
    "the same.",
)  # fmt: skip
SMALLER_UNITS = {"milliseconds": 1e-3, "microseconds": 1e-6}


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


def unevenness(time: Array) -> str:
    """How far instants (N,) are from even ones, in a sentence: scatter of the clock, and rows that lack."""
    places = grid_places(time)
    step, start = np.polyfit(places, time, 1)
    off = time - start - places * step
    lacking = int(places[-1]) + 1 - time.size
    text = f"They lie {1000 * float(np.std(off)):.3g} ms (largest {1000 * float(np.ptp(off)) / 2:.3g} ms) off even ones"
    return text + (f", and {lacking} rows are missing." if lacking else ".")


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
            valid=f"{command.shape[1]} numbers",
        )  # fmt: skip
    return np.asarray(command * np.array(drive_gains))
