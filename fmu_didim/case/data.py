"""Where the data of a case lie, and how they become an experiment."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np

from fmu_didim.base.diagnostics import Diagnostic
from fmu_didim.base.errors import InputError
from fmu_didim.base.files import is_file
from fmu_didim.case.file_checks import check_reference_rate, check_time_unit, check_within, torque_of_command
from fmu_didim.case.memory import check_at_hand
from fmu_didim.case.reference import resampled, with_derivatives
from fmu_didim.case.sources import ExperimentSource, ReferenceFile, SignalFile, TorqueFile
from fmu_didim.cosim import decimated_times, grid_places, sample_operator
from fmu_didim.data.excitation import Excitation
from fmu_didim.data.signals import Array, Trajectory
from fmu_didim.data.tables import Selected, SignalTable, TimeColumn, read_table, selected
from fmu_didim.model.experiment import Experiment

DATA_VARIABLE = "FMU_DIDIM_DATA"
DATA_PREFIX = "data:"
NONE_GIVEN: Mapping[str, Trajectory] = MappingProxyType({})
TIME_IN_MEMORY = "time of signals in memory"


def data_folder(folder: Path) -> Path:
    """The folder of the environment variable ``FMU_DIDIM_DATA``, else ``../shared/data`` beside the project.

    Args:
        folder: that of the case file, from which the project's folder is looked for.
    """
    named = os.environ.get(DATA_VARIABLE)
    if named:
        return Path(named)
    for parent in (folder.resolve(), *folder.resolve().parents):
        if (parent / "pyproject.toml").is_file():
            return parent.parent / "shared" / "data"
    return Path("../shared/data")


def resolve(source: SignalFile, folder: Path) -> Path:
    """The path of a file; raises InputError that says where to get it."""
    check_at_hand(source.file)
    is_data = source.file.startswith(DATA_PREFIX)
    path = data_folder(folder) / source.file.removeprefix(DATA_PREFIX) if is_data else folder / source.file
    if not is_file(path):
        step = how_to_get(source.file, source.obtain)
        raise InputError("A data file is absent.", where=str(path), next_step=step)
    return path


def how_to_get(file: str, obtain: str = "") -> str:
    """What a user whose data file is absent does next.

    Args:
        file: as the case names it; obtain: what the case says of where to get it.
    """
    step = "Check the path in the case file; it is relative to the folder of that file."
    if file.startswith(DATA_PREFIX):
        step = f"Set {DATA_VARIABLE} to the folder that holds {file.removeprefix(DATA_PREFIX)}."
    return f"{step} {obtain}".strip()


def read_signals(
    source: SignalFile,
    folder: Path,
    signals: Mapping[str, Trajectory] = NONE_GIVEN,
    *,
    torque_units: tuple[str, ...] = (),
) -> Selected:
    """The signals of a file, or those given under its name, under the names of the case and in SI units."""
    given = signals.get(source.file)
    table = read_table(resolve(source, folder), layout=source.csv) if given is None else _in_memory(given, source)
    command = isinstance(source, TorqueFile) and source.quantity == "command"
    time = source.time if given is None else TimeColumn(name=TIME_IN_MEMORY)
    found = selected(table, time=time, columns=source.columns, torque_units=torque_units, is_command=command)
    return replace(found, told=_of_file(found.told, source.file))


def _of_file(told: Iterable[Diagnostic], file: str) -> tuple[Diagnostic, ...]:
    """What was found in a file, under the name that the case gives it."""
    return tuple(replace(diagnostic, place=file) for diagnostic in told)


def _in_memory(given: Trajectory, source: SignalFile) -> SignalTable:
    columns = {name: given.values[:, i] for i, name in enumerate(given.names)}
    return SignalTable({TIME_IN_MEMORY: given.time, **columns}, source=given.source or source.file)


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
    joint_count = len(torque_units)
    if isinstance(source, Excitation):
        if source.joint_count != joint_count:
            raise InputError(
                "The reference has another number of joints than the robot.", where="reference",
                got=source.joint_count, valid=str(joint_count),
            )  # fmt: skip
        return Selected(_of_two_rows(source.trajectory(1.0 / step), "reference"))
    read = read_signals(source, folder, signals, torque_units=torque_units)
    found, told = _of_two_rows(read.signals, source.file), [*read.told]
    if source.resample:
        found, of_rows = resampled(found, step)
        told += _of_file(of_rows, source.file)
    check_reference_rate(found, step, source.file)
    if source.warm_up_s > 0 and source.period_s is not None:
        found = _with_warm_up(found, step, source.period_s, source.warm_up_s)
    found, of_derivatives = with_derivatives(found, needed)
    return Selected(found, (*told, *_of_file(of_derivatives, source.file)))


def _of_two_rows(found: Trajectory, where: str) -> Trajectory:
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
        )  # fmt: skip
    before = found.values[period - count : period].copy()
    # Test signals added to the command are not part of the periodic motion.
    motion = [v.name.rstrip("0123456789") in ("q", "dq", "ddq") for v in found.variables]
    before[:, ~np.array(motion)] = 0.0
    time = found.time[0] + np.arange(-count, 0) * step
    return replace(found, time=np.concatenate([time, found.time]), values=np.vstack([before, found.values]))


def _torque_at(log: Trajectory, torque: Array, source: TorqueFile, times: Array) -> Array:
    """Samples of a log at other instants: the values that hold there, or their averages."""
    gaps = np.flatnonzero(np.diff(grid_places(log.time)) > 1)
    if gaps.size:
        raise InputError(
            "A log that lacks samples cannot be brought to another rate.", where=log.source,
            got=f"{gaps.size} gaps, the first one after t = {log.time[gaps[0]]:g} s",
            next_step="Leave out torque.rate_hz: the log is then used as it is, without the samples that it lacks.",
        )  # fmt: skip
    step = float((log.time[-1] - log.time[0]) / (log.time.size - 1))
    operator = sample_operator(
        times, start=float(log.time[0]), step=step, tick_count=log.time.size, kind=source.sampling,
        window=source.window, window_s=source.window_s,
    )  # fmt: skip
    return operator.apply(torque[operator.ticks])


def read_experiment(
    source: ExperimentSource,
    folder: Path,
    *,
    step: float,
    drive_gains: tuple[float, ...] | None,
    torque_units: tuple[str, ...],
    label: str,
    needed: frozenset[str] = frozenset(),
    signals: Mapping[str, Trajectory] = NONE_GIVEN,
) -> Experiment:
    """The data of one run; signals in memory stand for the files of their names.

    Raises:
        InputError: a file or column is missing, or the log does not fit the reference.
    """
    motion = read_reference(
        source.reference, folder, step=step, torque_units=torque_units, needed=needed, signals=signals
    )
    reference = motion.signals
    if source.torque is None:
        raise InputError(
            "The torque log is missing.", where=label,
            next_step="Add torque: {file: ...} to it. Without, the case can be simulated, but nothing be identified.",
        )  # fmt: skip
    read = read_signals(source.torque, folder, signals, torque_units=torque_units)
    log = _of_two_rows(read.signals, source.torque.file)
    torque = log.select([f"tau{j}" for j in range(1, len(torque_units) + 1)])
    if source.torque.quantity == "command":
        torque = torque_of_command(torque, drive_gains, label)
    check_time_unit(log, reference, source.torque.file)
    times = log.time
    if source.torque.rate_hz is not None:
        times = decimated_times(log.time, source.torque.rate_hz, source.torque.phase_s)
        torque = _torque_at(log, torque, source.torque, times)
    times = times + source.torque.offset_s
    check_within(times, reference, step, source)
    operator = sample_operator(
        times, start=float(reference.time[0]), step=step, tick_count=reference.time.size,
        kind=source.torque.sampling, window=source.torque.window, window_s=source.torque.window_s,
    ).stamped_later(source.torque.log_shift_s / step, reference.time.size)  # fmt: skip
    told, positions = [*motion.told, *read.told], None
    if source.positions is not None:
        measured = read_signals(source.positions, folder, signals, torque_units=torque_units)
        positions = measured.signals
        told += measured.told
    return Experiment(
        reference, times, torque, operator, positions, label, source.role, stamps=log.time,
        told=tuple(dict.fromkeys(told)),
    )  # fmt: skip
