"""From the entry of one run to its experiment: reference, torque log, and how the log follows from the loop."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from fmu_didim.case.files import NONE_GIVEN, read_signals
from fmu_didim.case.runs.instants import read_motion
from fmu_didim.case.runs.temperatures import read_temperatures
from fmu_didim.case.runs.torque_log import read_torque_log
from fmu_didim.case.sources import ExperimentSource
from fmu_didim.cosim import Instants, sample_operator
from fmu_didim.data.signals import Trajectory
from fmu_didim.data.tables import Selected
from fmu_didim.data.tables.motors import mixes
from fmu_didim.model.experiment import Experiment, InitialState


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
    motion: Selected | None = None,
) -> Experiment:
    """The data of one run; signals in memory stand for the files of their names.

    Args:
        motion: what the loop follows; that of the entry by default.

    Raises:
        InputError: a file or column is missing, or the log does not fit the reference.
    """
    if motion is None:
        motion = read_motion(source, folder, step=step, torque_units=torque_units, needed=needed, signals=signals)
    reference = _before(motion.signals, source.to_s, step)
    instants = None if source.instants is None else Instants(reference.time, step)
    log = read_torque_log(
        source, folder, reference, step=step, drive_gains=drive_gains, torque_units=torque_units, label=label,
        signals=signals,
    )  # fmt: skip
    assert source.torque is not None
    operator = sample_operator(
        log.times, start=float(reference.time[0]), step=step, tick_count=reference.time.size,
        instants=instants, **source.torque.sampled,
    ).stamped_later(source.torque.log_shift_s / step, reference.time.size)  # fmt: skip
    temperatures = read_temperatures(source, folder, reference.time, len(torque_units), label, signals)
    told, positions = [*motion.told, *log.told, *temperatures.told], None
    if source.positions is not None:
        measured = read_signals(source.positions, folder, signals, torque_units=torque_units)
        positions = measured.signals
        told += measured.told
    return Experiment(
        reference, log.times, log.torque, operator, positions, label, source.role, stamps=log.stamps,
        measured_starts=temperatures.starts, told=tuple(dict.fromkeys(told)), initial_state=initial_state_of(source),
        leaves_out_outliers=source.torque.outliers == "leave_out", is_unsigned=source.torque.unsigned,
        shares_noise=source.torque.motors is not None and mixes(source.torque.motors),
        unit=source.unit, day=source.recorded_on,
    )  # fmt: skip


def initial_state_of(source: ExperimentSource) -> InitialState:
    """Where the motion of a run starts; the loop knows later whether it has the states that are named."""
    if isinstance(source.initial_state, str):
        return InitialState(source.initial_state)
    return InitialState("given", source.initial_state)


def _before(reference: Trajectory, to_s: float | None, step: float) -> Trajectory:
    """The reference up to an instant."""
    if to_s is None:
        return reference
    kept = reference.time <= to_s + step / 2
    return replace(reference, time=reference.time[kept], values=reference.values[kept])
