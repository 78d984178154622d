"""Simulated data: a machine with known values follows the references of a case; noise is added to its logs.

torque = sampled torque of the true loop + s_j e,   e = sqrt(1 - c) white + sqrt(c) AR(1),   unit variance
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from scipy import signal

from fmu_didim.base.documents import validate
from fmu_didim.base.errors import InputError
from fmu_didim.campaigns.planning.document import Noise
from fmu_didim.campaigns.planning.recorded import (
    SimulatedOutput,
    channel_deviation,
    output_file,
    outputs_deviation,
    simulated_channels,
    simulated_files,
    simulated_outputs,
    with_simulated_outputs,
)
from fmu_didim.case import Case, load_case
from fmu_didim.case.runs.experiment import initial_state_of
from fmu_didim.case.sources import TorqueFile
from fmu_didim.cosim import Instants, decimated_times, sample_operator
from fmu_didim.data.signals import Array, Trajectory, trajectory
from fmu_didim.dynamics.robot import RobotDescription
from fmu_didim.estimators.starts.start import with_free_delay
from fmu_didim.model.experiment import Experiment
from fmu_didim.model.parameters import Parameters

NO_OUTPUTS: Mapping[str, list[SimulatedOutput]] = MappingProxyType({})
SPIN_UP = 20
"""[memories] Coloured noise is simulated this long before the log starts, so that it is stationary."""


@dataclass(frozen=True)
class SimulatedLog:
    """The log of one experiment without noise.

    Attributes:
        stamps: (N,) instants in the log; torque: (N, n).
        positions: ``q<j>`` at the control rate, where the case has positions.
    """

    stamps: Array
    torque: Array
    positions: Trajectory | None


@dataclass(frozen=True)
class Truth:
    """A simulated machine.

    Attributes:
        logs: label -> log; values: name of a free parameter -> its true value, and what is regrouped into it.
        robot: its description, where it has one.
        outputs: label -> what a model gives, in place of logs, or a robot beside its torque.
    """

    logs: Mapping[str, SimulatedLog]
    values: Mapping[str, tuple[float, str]]
    robot: RobotDescription | None
    outputs: Mapping[str, list[SimulatedOutput]] = field(default_factory=dict)


def simulated_truth(content: Mapping[str, Any], folder: Path) -> Truth:
    """Run the machine that ``content`` describes along all its references.

    Raises:
        InputError, FmuError, SimulationError: it cannot be loaded, or its loop diverges.
    """
    content = {key: value for key, value in content.items() if key != "torque_std"}
    if isinstance(content.get("identify"), Mapping):  # true values are those of the loop, not those a fit starts from
        kept = ("of", "parameter", "joint")
        content["identify"] = {
            name: {k: v for k, v in (entry or {}).items() if k in kept} for name, entry in content["identify"].items()
        }
    case = load_case(content, folder=folder, require_torque=False)
    if case.data is not None:
        start = zip(case.model.names, case.model.start, strict=True)
        return Truth({}, {name: (float(value), "") for name, value in start}, None, simulated_outputs(case))
    experiments = {label: case.with_channels(label, _experiment(case, label)) for label in case.document.runs}
    model, logs, outputs = case.model_on(experiments), {}, {}
    for label, source in case.document.runs.items():
        run = model.simulation(model.start, label)
        recording = run.record(all_ticks=True)
        operator = run.experiment.operator  # without the clock of the log, which may be unknown
        torque = operator.apply(run.logged_torque(recording)[operator.ticks])
        if source.measured_files:
            outputs[label] = simulated_channels(run)
        positions = None
        if source.positions is not None:
            names = model.loop.joint_signals("q")
            columns = {f"q{j}": recording.table([name])[:, 0] for j, name in enumerate(names, start=1)}
            positions = trajectory(recording.time, columns)
        assert experiments[label].stamps is not None
        logs[label] = SimulatedLog(np.asarray(experiments[label].stamps), torque, positions)
    model, known = with_free_delay(model), regrouped(model.parameters)
    pairs = zip(model.names, model.start, strict=True)
    values = {name: (float(value), known.get(name.partition("[")[0], "")) for name, value in pairs}
    return Truth(logs, values, case.robot, outputs)


def regrouped(parameters: Parameters) -> dict[str, str]:
    """Name of each regrouped parameter -> what is in it: ``ZZ1 + Ia1 + 0.25 M2``."""
    pairs = (line.partition(" = ") for line in parameters.relations())
    return {name: terms for name, _, terms in pairs}


def _experiment(case: Case, label: str) -> Experiment:
    """An experiment without torque: the instants of the log, and how it is sampled from the command."""
    reference = case.reference(label)
    source = case.document.runs[label].torque or TorqueFile(file="")
    start, step = float(reference.time[0]), case.step_size
    times = reference.time[reference.time > -0.5 * step]  # without the warm-up
    if source.rate_hz is not None:
        if source.rate_hz > (1 + 1e-9) / step:
            raise InputError(
                "Simulated torque cannot be logged faster than the control rate.", where=f"{label}: torque.rate_hz",
                got=f"{source.rate_hz:g} Hz", valid=f"up to {1 / step:g} Hz",
                next_step="Lower torque.rate_hz, or raise the rate of the reference.",
            )  # fmt: skip
        times = decimated_times(times, source.rate_hz, source.phase_s)
    operator = sample_operator(
        times, start=start, step=step, tick_count=reference.time.size, **source.sampled,
        instants=None if case.document.runs[label].instants is None else Instants(reference.time, step),
    ).stamped_later(source.log_shift_s / step, reference.time.size)  # fmt: skip
    nothing = np.zeros((times.size, case.parameters.joint_count))
    return Experiment(
        reference, times, nothing, operator, label=label, stamps=times - source.offset_s,
        measured_starts=case.measured_starts(label, reference),
        initial_state=initial_state_of(case.document.runs[label]),
    )  # fmt: skip


def noise_deviation(noise: Noise, log: SimulatedLog) -> Array:
    """(n,) standard deviation of the torque noise of each joint; raises InputError where ``std`` does not fit."""
    n = log.torque.shape[1]
    if noise.std is not None:
        if len(noise.std) != n:
            raise InputError(
                "noise.std needs one value for each joint.", got=len(noise.std), valid=str(n),
                next_step="Give one number for all joints, or a list of that length.",
            )  # fmt: skip
        return np.array(noise.std)
    return np.asarray((noise.relative or 0.0) * np.sqrt((log.torque**2).mean(axis=0)))


def unit_noise(rng: np.random.Generator, time: Array, joints: int, *, coloured: float, memory_s: float) -> Array:
    """(N, n) noise of variance one, part of whose power is a first-order autoregression with this memory."""
    if not coloured or time.size < 2:
        return np.asarray(rng.normal(size=(time.size, joints)))
    step = float(time[-1] - time[0]) / (time.size - 1)
    rho = np.exp(-step / memory_s)
    before = int(np.ceil(SPIN_UP * memory_s / step - 1e-9))
    driven = rng.normal(size=(before + time.size, joints)) * np.sqrt(1 - rho**2)
    slow = signal.lfilter([1.0], [1.0, -rho], driven, axis=0)[before:]
    white = rng.normal(size=(time.size, joints))
    return np.asarray(np.sqrt(coloured) * slow + np.sqrt(1 - coloured) * white)


def noisy_logs(truth: Truth, stated: Mapping[str, Any], data: str) -> dict[str, Trajectory]:
    """File in the case -> log with noise.

    Args:
        stated: the noise, as the campaign says; data: digest of the data, which seeds it.

    Raises:
        InputError: the noise is wrong, or does not fit the joints.
    """
    noise, found = validate(Noise, dict(stated), where="noise"), dict[str, Trajectory]()
    for label, outputs in truth.outputs.items():
        if label in truth.logs:  # of a robot, whose torque has noise of its own
            rng = np.random.default_rng([int(data, 16), zlib.crc32(f"{label}: measured".encode())])
            sizes = [channel_deviation(one, noise) for one in outputs]
        else:
            rng = np.random.default_rng([int(data, 16), zlib.crc32(label.encode())])
            sizes = outputs_deviation(outputs, relative=noise.relative, std=noise.std)
        for one, size in zip(outputs, sizes, strict=True):
            unit = unit_noise(rng, one.time, 1, coloured=noise.coloured, memory_s=noise.memory_s)[:, 0]
            found[output_file(label, one.name)] = trajectory(one.time, {one.name: one.values + size * unit})
    for label, log in truth.logs.items():
        rng = np.random.default_rng([int(data, 16), zlib.crc32(label.encode())])
        n = log.torque.shape[1]
        unit = unit_noise(rng, log.stamps, n, coloured=noise.coloured, memory_s=noise.memory_s)
        torque = log.torque + noise_deviation(noise, log) * unit
        found[torque_file(label)] = trajectory(log.stamps, {f"tau{j + 1}": torque[:, j] for j in range(n)})
        if log.positions is not None:
            values = log.positions.values
            values = values + noise.position_std * rng.normal(size=values.shape)
            found[positions_file(label)] = replace(log.positions, values=values)
    return found


def torque_file(label: str) -> str:
    """Name of the simulated torque log of an experiment."""
    return f"torque_{label}.csv"


def positions_file(label: str) -> str:
    """Name of its simulated positions."""
    return f"positions_{label}.csv"


def with_simulated_logs(
    content: Mapping[str, Any], outputs: Mapping[str, list[SimulatedOutput]] = NO_OUTPUTS
) -> dict[str, Any]:
    """The content of a case that reads the simulated logs instead of its own, or the simulated outputs of a model.

    They already have the rate of the case and the unit of torque; what the case assumes about their clock and sampling
    stays.
    """
    names = {label: [one.name for one in each] for label, each in outputs.items()}
    if "model" in content:
        return with_simulated_outputs(content, names) if outputs else dict(content)
    result = dict(content)
    runs = dict(result.get("experiments") or {})
    labelled = {"train": "estimation", "validation": "validation"}
    for name, label in [*labelled.items(), *((name, name) for name in runs)]:
        place = result if name in labelled and name in result else runs
        if not isinstance(place.get(name), Mapping):
            continue
        run = dict(place[name])
        assumed = {k: v for k, v in (run.get("torque") or {}).items() if k in _ASSUMED}
        run["torque"] = {**assumed, "file": torque_file(label)}
        if run.get("positions") is not None:
            run["positions"] = {"file": positions_file(label)}
        if run.get("measured") is not None:
            run["measured"] = simulated_files(label, names.get(label, ()), run["measured"])
        place[name] = run
    return {**result, "experiments": runs} if runs else result


_ASSUMED = ("sampling", "window", "window_s", "cutoff_hz", "offset_s", "log_shift_s")


def hidden_effects(truth: RobotDescription | None, model: RobotDescription | None) -> str:
    """Effects that the true robot has and the described one lacks: ``stribeck@1+actuator_lag@2``."""
    if truth is None or model is None or len(truth.joints) != len(model.joints):
        return ""
    pairs = enumerate(zip(truth.joints, model.joints, strict=True), start=1)
    return "+".join(f"{e}@{j}" for j, (true, known) in pairs for e in true.effects if e not in known.effects)
