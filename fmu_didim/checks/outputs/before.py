"""What was measured of a model against what it gives before any fit: a dead sensor, another unit, another start."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, PROBLEM, Diagnostic
from fmu_didim.base.errors import SimulationError
from fmu_didim.checks.plant.idle import with_change
from fmu_didim.data.signals import Array
from fmu_didim.model.loop_model import LoopModel

START_OFF = 6.0
"""[standard deviations] Of the noise, by which an output may lie beside its start in the model."""
RANGES_OFF = 5.0
"""[ranges] By which an output that was measured may lie beside that of the model, with any values of its parameters."""
MOVED = 0.05
"""[1] Of a parameter, by which it is changed to see whether an output depends on it at the start."""
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


def before_the_fit(model: LoopModel) -> list[Diagnostic]:
    """What the outputs that were measured have against those of the model at its start; nothing where that cannot be
    simulated."""
    found = list[Diagnostic]()
    for label in model.experiments:
        try:
            of_outputs = list(_of_outputs(model, label, model.torque(model.start, label)))
            found += of_outputs or _of_start(model, label)
        except SimulationError:  # the estimator starts elsewhere, or says why not
            continue
    return found


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
    moved = [_first(model, with_change(model.start, i, MOVED), label) for i in range(model.start.size)]
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


def _first(model: LoopModel, values: Array, label: str) -> Array:
    """(n,) the outputs at the first tick."""
    run = model.simulation(model.free_parameters.limited(values), label)
    return np.asarray(run.logged_torque(run.record(ticks=np.zeros(1, dtype=np.int64)))[0])


def rough_noise(measured: Array) -> Array:
    """(n,) standard deviation of white noise in smooth outputs (N, n), from their second differences."""
    if measured.shape[0] < 3:
        return np.zeros(measured.shape[1])
    return np.asarray(np.sqrt(np.mean(np.diff(measured, 2, axis=0) ** 2, axis=0) / (1 + 2**2 + 1)))
