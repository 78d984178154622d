"""What was measured beside the torque: from the entries of a run to channels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from fmu_didim.base.diagnostics import Diagnostic
from fmu_didim.base.errors import InputError, UnknownNameError
from fmu_didim.case.files import NONE_GIVEN, read_signals
from fmu_didim.case.sources import ExperimentSource, MeasuredFile
from fmu_didim.case.torque_log import ROUNDING_S
from fmu_didim.cosim import System, measured_output, sample_operator
from fmu_didim.data.signals import Array, Trajectory, Variable
from fmu_didim.model.channel import Channel

FEWEST = 20
"""[samples] Of a channel: fewer show neither noise nor its colour."""


def read_channels(
    source: ExperimentSource,
    folder: Path,
    reference: Trajectory,
    system: System,
    *,
    plant: str,
    torque_units: tuple[str, ...],
    label: str,
    signals: Mapping[str, Trajectory] = NONE_GIVEN,
) -> tuple[tuple[Channel, ...], tuple[Diagnostic, ...]]:
    """The channels of a run, and diagnostics of reading their files.

    Args:
        reference: of the run; system: its loop; plant: the name of the plant there.

    Raises:
        InputError: a file or signal is missing, two files show one signal, or their samples lie outside the reference.
    """
    found: list[Channel] = []
    told: list[Diagnostic] = []
    for file in source.measured_files:
        where = f"{label}: measured: {file.file}"
        read = read_signals(file, folder, signals, torque_units=torque_units)
        told += read.told
        outputs = {v.name: v for v in system.components[plant].outputs}
        for name in _names(file, read.signals, outputs, where):
            if any(channel.name == name for channel in found):
                raise InputError(
                    "Two files show the same signal.", where=where, got=name, next_step="Give one of them."
                )
            times, values = _samples(read.signals, name, file, source)
            found.append(_channel(name, times, values, file, reference, system, plant, outputs[name].unit, where))
    return tuple(found), tuple(told)


def _names(file: MeasuredFile, read: Trajectory, outputs: Mapping[str, Variable], where: str) -> Sequence[str]:
    """The signals that a file shows."""
    names = file.signals or tuple(file.columns)
    if not names:
        names = tuple(name for name in read.names if name in outputs and name.startswith("q") and name[1:].isdigit())
    if not names:
        raise InputError(
            "The file shows no position of a joint.", where=where, got=", ".join(read.names),
            next_step="Say which output of the plant is which column: columns: {q1: name in the file}.",
        )  # fmt: skip
    for name in names:
        if name not in outputs:
            raise UnknownNameError("output of the plant", name, outputs, where=where)
        if name not in read.names:
            raise UnknownNameError("column", name, read.names, where=where)
    return names


def _samples(read: Trajectory, name: str, file: MeasuredFile, source: ExperimentSource) -> tuple[Array, Array]:
    """Instants (N,) and values (N,) in the part of the run that is used; a cell that is not a number is no sample."""
    times, values = read.time + file.offset_s, read.column(name)
    first = -np.inf if source.from_s is None else source.from_s - ROUNDING_S
    last = np.inf if source.to_s is None else source.to_s + ROUNDING_S
    kept = np.isfinite(values) & (times >= first) & (times <= last)
    times, values = times[kept], values[kept]
    if file.rate_hz is not None and times.size:
        slots = np.floor((times - times[0]) * file.rate_hz + 1e-6)
        taken = np.unique(slots, return_index=True)[1]
        times, values = times[taken], values[taken]
    return times, values


def _channel(
    name: str, times: Array, values: Array, file: MeasuredFile, reference: Trajectory, system: System, plant: str,
    unit: str, where: str,
) -> Channel:  # fmt: skip
    start, end, step = float(reference.time[0]), float(reference.time[-1]), system.step_size
    outside = times[(times < start - ROUNDING_S) | (times > end + step)]
    if outside.size:
        raise InputError(
            "The samples reach beyond the reference.", where=where,
            got=f"{outside.size} samples of {name}, the first one at t = {outside[0]:g} s",
            valid=f"t from {start:g} s to {end:g} s",
            next_step="Check the clock and the unit of time of both files (time: {unit: ...}, offset_s), or cut the "
            "run: from_s, to_s.",
        )  # fmt: skip
    if times.size < FEWEST:
        raise InputError(
            "There are too few samples.", where=where, got=f"{times.size} of {name}", valid=f"{FEWEST} or more",
            next_step="Give a log with more samples, or more of its time by from_s and to_s.",
        )  # fmt: skip
    # A sample in the last period follows from the last tick.
    inside = np.clip(times, start, end)
    count = reference.time.size
    operator = sample_operator(inside, start=start, step=step, tick_count=count).stamped_later(0.0, count, between=True)
    return Channel(
        name, measured_output(system, f"{plant}.{name}"), unit, times, values, operator, file.std.get(name)
    )  # fmt: skip
