"""What was measured beside the torque: from the entries of a run to channels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fmu_didim.base.diagnostics import Diagnostic
from fmu_didim.base.errors import InputError, UnknownNameError
from fmu_didim.case.files import NONE_GIVEN, read_samples, table_and_time
from fmu_didim.case.runs.torque_log import ROUNDING_S
from fmu_didim.case.sources import ExperimentSource, MeasuredFile
from fmu_didim.cosim import Instants, SampleOperator, System, measured_output, sample_operator
from fmu_didim.data.signals import Array, Trajectory, Variable
from fmu_didim.data.tables import Column
from fmu_didim.data.tables.table import split_unit
from fmu_didim.model.signals.channel import Channel
from fmu_didim.model.signals.error_model import ErrorModel

FEWEST = 20
"""[samples] Of a channel beside a torque: fewer show neither noise nor its colour."""
FEWEST_ESTIMATED = 5
"""[samples] Of an output of a model whose noise is estimated: fewer do not show it within a third, white as it counts
there. Samples of a culture are taken by hand, ten in a day."""
FEWEST_STATED = 2
"""[samples] Of one whose noise is stated: a rate needs two."""


@dataclass(frozen=True, eq=False)
class Samples:
    """What was measured of an output: (N,) instants in s and values in a unit, and the error model of its noise that
    the case states; ``where``: the file, for messages."""

    name: str
    time: Array
    values: Array
    unit: str
    errors: ErrorModel
    where: str

    @property
    def scale(self) -> Array | None:
        """(N,) scales of its samples before anything is simulated; None where all are alike."""
        return None if self.errors.is_plain else self.errors.scale(self.values)


def read_measured(
    source: ExperimentSource,
    folder: Path,
    outputs: Mapping[str, Variable],
    *,
    label: str,
    torque_units: tuple[str, ...] = (),
    is_any: bool = False,
    signals: Mapping[str, Trajectory] = NONE_GIVEN,
) -> tuple[dict[str, Samples], tuple[Diagnostic, ...]]:
    """What was measured in a run beside its torque log: name of the output -> samples; and diagnostics of the files.

    Args:
        outputs: of the plant or model, by name; is_any: whether those are of a model that is no robot, in units of its
            own; torque_units: (n,) N.m or N of each joint.

    Raises:
        InputError: a file or signal is missing, or two files show one signal.
    """
    found: dict[str, Samples] = {}
    told: list[Diagnostic] = []
    for file in source.measured_files:
        where = f"{label}: measured: {file.file}"
        columns = _columns(file, folder, outputs, where, signals, is_any=is_any)
        units = {name: outputs[name].unit for name in columns} if is_any else {}
        samples = read_samples(file, folder, columns, signals, torque_units=torque_units, units=units)
        for name, read in samples.items():
            if name in found:
                raise InputError(
                    "Two files show the same signal.", where=where, got=name, next_step="Give one of them."
                )
            times, values = _part(read.signals, name, file, source)
            errors = file.error_model(name)
            fewest = (FEWEST_ESTIMATED if errors.stated is None else FEWEST_STATED) if is_any else FEWEST
            if times.size < fewest:
                raise InputError(
                    "There are too few samples.", where=where, got=f"{times.size} of {name}",
                    valid=f"{fewest} or more",
                    next_step="State its noise (std:), or give more of it." if is_any and errors.stated is None else
                    "Give a log with more samples, or more of its time by from_s and to_s.",
                )  # fmt: skip
            found[name] = Samples(name, times, values, outputs[name].unit, errors, where)
            told += read.told
    return found, tuple(dict.fromkeys(told))


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
    """The channels of a run of a robot, and diagnostics of reading their files.

    Args:
        reference: of the run; system: its loop; plant: the name of the plant there.

    Raises:
        InputError: as of :func:`read_measured`, or samples lie outside the reference.
    """
    outputs = {v.name: v for v in system.components[plant].outputs}
    found, told = read_measured(
        source, folder, outputs, label=label, torque_units=torque_units, signals=signals
    )  # fmt: skip
    return tuple(channel_of(one, reference, system, plant) for one in found.values()), told


def _columns(
    file: MeasuredFile, folder: Path, outputs: Mapping[str, Variable], where: str, signals: Mapping[str, Trajectory],
    *, is_any: bool,
) -> dict[str, Column]:  # fmt: skip
    """The signals that a file shows, and their columns."""
    names = file.signals or tuple(file.columns) or _shown(file, folder, outputs, where, signals, is_any=is_any)
    for name in names:
        if name not in outputs:
            raise UnknownNameError(f"output of the {'model' if is_any else 'plant'}", name, outputs, where=where)
    return {name: file.columns.get(name, Column(name=name)) for name in names}


def _shown(
    file: MeasuredFile, folder: Path, outputs: Mapping[str, Variable], where: str, signals: Mapping[str, Trajectory],
    *, is_any: bool,
) -> tuple[str, ...]:  # fmt: skip
    """The outputs after which columns of a file are named."""
    table, _ = table_and_time(file, folder, signals)
    if is_any:
        names = tuple(name for name in outputs if table.find(name) is not None)
    else:
        bare = [split_unit(name)[0] if table.has_header else name for name in table.columns]
        names = tuple(name for name in bare if name in outputs and name.startswith("q") and name[1:].isdigit())
    if not names:
        what = "The file shows no output of the model." if is_any else "The file shows no position of a joint."
        example = next(iter(outputs), "y") if is_any else "q1"
        raise InputError(
            what, where=where, got=", ".join(table.columns), valid=", ".join(outputs) if is_any else "",
            next_step="Say which output is which column: columns: "
            f"{{{example}: name in the file}}.",
        )  # fmt: skip
    return names


def _part(read: Trajectory, name: str, file: MeasuredFile, source: ExperimentSource) -> tuple[Array, Array]:
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


def channel_of(one: Samples, reference: Trajectory, system: System, plant: str) -> Channel:
    """The channel of a measured output.

    Args:
        reference: of the run, a row a tick; system: its loop; plant: the component of the output.

    Raises:
        InputError: samples lie outside the reference.
    """
    times, step = one.time, system.step_size
    start, end = float(reference.time[0]), float(reference.time[-1])
    outside = times[(times < start - ROUNDING_S) | (times > end + step)]
    if outside.size:
        raise InputError(
            "The samples reach beyond the reference.", where=one.where,
            got=f"{outside.size} samples of {one.name}, the first one at t = {outside[0]:g} s",
            valid=f"t from {start:g} s to {end:g} s",
            next_step="Check the clock and the unit of time of both files (time: {unit: ...}, offset_s), or cut the "
            "run: from_s, to_s.",
        )  # fmt: skip
    # A sample in the last period follows from the last tick.
    operator = output_operator(np.clip(times, start, end), reference, system)
    signal = measured_output(system, f"{plant}.{one.name}")
    errors, scale = one.errors, one.scale
    return Channel(one.name, signal, one.unit, times, one.values, operator, errors.stated, errors, scale)


def output_operator(times: Array, reference: Trajectory, system: System) -> SampleOperator:
    """How samples of an output at these times (N,) follow from it at the ticks: on straight lines between them."""
    count = reference.time.size
    instants = Instants(reference.time, system.step_size) if system.at_instants else None
    operator = sample_operator(
        times, start=float(reference.time[0]), step=system.step_size, tick_count=count, instants=instants
    )
    return operator.stamped_later(0.0, count, between=True)
