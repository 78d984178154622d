"""What is wrong with the data of a case of a ``model:``, before any fit."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, PROBLEM, REMARK, Diagnostic
from fmu_didim.base.errors import SimulationError
from fmu_didim.case import Case
from fmu_didim.case.calibration.experiment import CalibrationData
from fmu_didim.case.calibration.ticks import Ticks
from fmu_didim.data.signals import Array
from fmu_didim.model.loop_model import LoopModel

STEPS_OFF = 0.1
"""[standard deviations] Of the noise of an output, from which the error of the steps of a simulation counts: over a
thousand samples that look alike it moves a value by three of its standard deviations at most."""
START_OFF = 6.0
"""[standard deviations] Of the noise, by which an output may lie beside its start in the model."""
RANGES_OFF = 5.0
"""[ranges] By which an output that was measured may lie beside that of the model, with any values of its parameters."""
MOVED = 0.05
"""[1] Of a parameter, by which it is changed to see whether an output depends on it at the start."""
MOST_STEPS = 20_000
"""[ticks] Of a simulation up to which it is run again with finer steps."""
SAME = 1e-9
"""[1] Relative difference up to which two values are one."""

OUTPUT_CONSTANT = CATALOGUE(
    "output-constant", PROBLEM, rank=6,
    meaning="An output that was measured never changes, and that of the model does: the wrong column, or a dead "
    "sensor.",
    next_step="Check its column: measured: {columns: {...}}.",
)  # fmt: skip
OUTPUT_ELSEWHERE = CATALOGUE(
    "output-elsewhere", DOUBT, rank=9,
    meaning="What was measured of an output lies far beside all that the model gives at its start: another unit, such "
    "as K for degC, another scale, or the wrong column; or a start that is far from the truth.",
    next_step="Give the unit of the column: measured: {columns: {...: {unit: ...}}}, or check which column it is.",
)  # fmt: skip
START_ELSEWHERE = CATALOGUE(
    "model-starts-elsewhere", DOUBT, rank=32,
    meaning="The model starts where no sample is, whatever the values of the parameters are: the values that are "
    "identified then make up for its start.",
    next_step="Identify where it starts, by the parameter or the state that says so, or give it its value: "
    "model: {parameters: {...}}.",
)  # fmt: skip
STEPS_COARSE = CATALOGUE(
    "inputs-vary-in-a-step", DOUBT, rank=21,
    meaning="The inputs change so much within a step of the simulation, in which they are held, that its error counts "
    "beside the noise: it moves the values.",
    next_step="Simulate in shorter steps: loop: {rate_hz: ...}.",
)  # fmt: skip
INPUT_CONSTANT = CATALOGUE(
    "input-constant",
    REMARK,
    rank=62,
    meaning="An input never changes. What acts by its changes alone cannot be identified from these data.",
    next_step="",
)


def model_diagnostics(case: Case) -> list[Diagnostic]:
    """Problems, doubts and remarks about the data of a model; raises nothing where it cannot be simulated."""
    assert case.data is not None
    model, found = case.model, list[Diagnostic]()
    for label, experiment in model.experiments.items():
        found += experiment.told
        found += _constant_inputs(case.data, label)
        try:
            simulated = model.torque(model.start, label)
            of_outputs = list(_of_outputs(model, label, simulated))
            found += of_outputs or _of_start(model, label)
        except SimulationError:  # the estimator starts elsewhere, or says why not
            continue
    with suppress(SimulationError):
        found += _of_steps(case)
    return found


def _constant_inputs(data: CalibrationData, label: str) -> Iterator[Diagnostic]:
    for name, one in data.runs[label].inputs.by_name.items():
        if not np.ptp(one.values):
            yield Diagnostic(INPUT_CONSTANT, f"{name} is {one.values[0]:g} all the time.", label)


def _of_outputs(model: LoopModel, label: str, simulated: Array) -> Iterator[Diagnostic]:
    measured = model.experiments[label].torque
    for j, name in enumerate(model.loop.labels):
        given, made = measured[:, j], simulated[:, j]
        ranges = float(np.ptp(given)), float(np.ptp(made))
        place = f"{label}: {name}"
        if not ranges[0] and ranges[1] > SAME * float(np.abs(made).max()):
            yield Diagnostic(OUTPUT_CONSTANT, f"It is {given[0]:g} in all samples.", place)
            continue
        away = abs(float(np.median(given) - np.median(made)))
        if max(ranges) and away > RANGES_OFF * max(ranges):
            text = f"It lies about {np.median(given):.4g}, that of the model with its own values about "
            text += f"{np.median(made):.4g}: {away / max(ranges):.1f} times the range of either away."
            yield Diagnostic(OUTPUT_ELSEWHERE, text, place, away / max(ranges), RANGES_OFF, "ranges")


def _of_start(model: LoopModel, label: str) -> Iterator[Diagnostic]:
    """Outputs that start elsewhere than their first sample and do not depend on what is identified there."""
    experiment = model.experiments[label]
    if abs(experiment.time[0] - experiment.reference.time[0]) > SAME * float(
        experiment.reference.time[1] - experiment.reference.time[0]
    ):
        return
    first = _first(model, model.start, label)
    moved = [_first(model, _moved(model.start, i), label) for i in range(model.start.size)]
    noise = rough_noise(experiment.torque)
    for j, name in enumerate(model.loop.labels):
        if any(abs(other[j] - first[j]) > SAME * max(abs(first[j]), 1.0) for other in moved):
            continue
        away = abs(float(experiment.torque[0, j] - first[j]))
        bound = START_OFF * float(noise[j])
        if away > bound > 0:
            text = f"It starts at {first[j]:.5g}, and its first sample is {experiment.torque[0, j]:.5g}."
            names = [v.name for v in model.loop.plant.parameters if "start" in v.name.lower() or v.name.endswith("0")]
            offered = [n for n in names if n not in model.names]
            step = f" Perhaps it is one of {', '.join(offered[:5])}." if offered else ""
            yield Diagnostic(
                START_ELSEWHERE, text, f"{label}: {name}", away, bound, next_step=START_ELSEWHERE.next_step + step
            )


def _moved(values: Array, place: int) -> Array:
    other = values.copy()
    other[place] += MOVED * (abs(values[place]) or 1.0)
    return other


def _first(model: LoopModel, values: Array, label: str) -> Array:
    """(n,) the outputs at the first tick."""
    run = model.simulation(model.free_parameters.limited(values), label)
    return np.asarray(run.logged_torque(run.record(ticks=np.zeros(1, dtype=np.int64)))[0])


def rough_noise(measured: Array) -> Array:
    """(n,) standard deviation of white noise in smooth outputs (N, n), from their second differences."""
    if measured.shape[0] < 3:
        return np.zeros(measured.shape[1])
    return np.asarray(np.sqrt(np.mean(np.diff(measured, 2, axis=0) ** 2, axis=0) / 6))


def _of_steps(case: Case) -> Iterator[Diagnostic]:
    """Whether shorter steps of the simulation give other outputs in the first experiment."""
    assert case.data is not None
    model, label = case.model, case.model.first
    inputs = case.data.runs[label].inputs
    if case.plant.follows_ramps:
        return
    if not any(one.is_linear for one in inputs.by_name.values()) or case.data.ticks[label].time.size > MOST_STEPS:
        return
    finer = finer_steps(case).model
    away = finer.torque(finer.start, label) - model.torque(model.start, label)
    measured = model.experiments[label].torque
    noise = rough_noise(measured)
    if model.torque_deviation is not None:
        noise = model.torque_deviation
    for j, name in enumerate(model.loop.labels):
        error, size = float(np.sqrt(np.mean(away[:, j] ** 2))) * 4 / 3, float(noise[j])  # of second order
        if size and error > STEPS_OFF * size:
            text = f"With steps of {case.step_size / 2:g} s it is {error:.2g} off those of {case.step_size:g} s in the "
            text += f"mean, {error / size:.2g} of its noise."
            rate = 1 / case.step_size * 2.0 ** np.ceil(np.log2(error / (STEPS_OFF * size)) / 2)
            step = f"Simulate in shorter steps: loop: {{rate_hz: {rate:.4g}}}."
            yield Diagnostic(STEPS_COARSE, text, f"{label}: {name}", error / size, STEPS_OFF, next_step=step)


def finer_steps(case: Case) -> Case:
    """The case with half the steps of its simulation."""
    data = case.data
    assert data is not None
    ticks = {
        label: Ticks(np.sort(np.concatenate([one.time, (one.time[1:] + one.time[:-1]) / 2])),
                     None if one.step is None else one.step / 2)
        for label, one in data.ticks.items()
    }  # fmt: skip
    step = data.step / 2
    return replace(case, data=replace(data, ticks=ticks, step=step), step_size=step)
