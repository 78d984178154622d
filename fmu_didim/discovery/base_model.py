"""The base model of discovery: noise, nuisances, first fit."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fmu_didim.diagnosis.log_checks import check_log
from fmu_didim.discovery import thresholds as limits
from fmu_didim.errors import InputError
from fmu_didim.master import System
from fmu_didim.master.system import REFERENCE
from fmu_didim.prediction.experiment import Experiment
from fmu_didim.prediction.free_parameter import PLANT, FreeParameter
from fmu_didim.prediction.least_squares import Fit, Stopping, integrated, minimise
from fmu_didim.prediction.loop_model import LoopModel
from fmu_didim.prediction.noise import (
    Noise,
    motion_frequency,
    noise_from_periods,
    noise_from_residual,
    period_in_ticks,
    pooled,
)
from fmu_didim.signals import Array, Trajectory, trajectory

BASE_FIT = Stopping(exact=True)
"""The base model is fitted once, and what it can absorb is projected out of all candidates: with the best
sensitivities."""


@dataclass(frozen=True)
class Prepared:
    """The base model, fitted with the noise of its data, and what there is to say of them."""

    fit: Fit
    notes: tuple[str, ...] = ()


def prepare(model: LoopModel) -> Prepared:
    """Noise and base fit of a loop model.

    Raises:
        InputError: the torque logs are too short, or cannot be those of this loop.
    """
    samples, count = model.measured.shape[0], model.parameters.count
    if samples < limits.FEWEST_SAMPLES * count:
        raise InputError(
            "The torque log is too short to look for more than the base parameters.",
            where=", ".join(model.estimation_labels),
            got=f"{samples} samples for {count} parameters",
        )
    model = replace(with_nuisances(model), coarse=True)
    notes = [remark for label in model.experiments for remark in check_log(model, label)]
    found = {label: _measured_noise(model, label) for label in model.estimation_labels}
    notes += [note for _, further in found.values() for note in further]
    repeated = {label: noise for label, (noise, _) in found.items() if noise is not None}
    if repeated:
        first = pooled(list(repeated.values()), [_samples(model, label) for label in repeated])
        fit = minimise(model, first, stopping=BASE_FIT)
        checked = []
        for label, noise in repeated.items():
            noise, further = _without_events(noise, fit, label)
            checked.append(noise)
            notes += further
        noise = pooled(checked, [_samples(model, label) for label in repeated])
        return Prepared(integrated(replace(fit, noise=noise), coarse=False), tuple(notes))
    # Without repetition: all joints alike at first, then the noise that the residual shows.
    spread = np.std(model.measured, axis=0)
    first = Noise(np.maximum(spread, limits.FIRST_NOISE), np.zeros(spread.size), "residual")
    fit = minimise(model, first, stopping=BASE_FIT)
    notes.append(
        "The motion does not repeat: the noise is taken from what the residual holds above the frequencies of the "
        "motion, an upper bound."
    )
    fit = minimise(fit.model, residual_noise(fit), stopping=BASE_FIT, jacobian=fit.jacobian, torque=fit.torque)
    return Prepared(integrated(fit, coarse=False), tuple(notes))


def _samples(model: LoopModel, label: str) -> int:
    return int(model.experiments[label].time.size)


def residual_noise(fit: Fit) -> Noise:
    """The noise of logs without repetition, from what a fit leaves of all experiments."""
    labels = fit.model.estimation_labels
    return pooled([_residual_noise(fit, label) for label in labels], [_samples(fit.model, label) for label in labels])


def _residual_noise(fit: Fit, label: str) -> Noise:
    experiment = fit.model.experiments[label]
    frequency = motion_frequency(experiment.reference, fit.model.joint_count)
    return noise_from_residual(
        fit.residual[fit.model.rows[label]], rate_hz=experiment.rate_hz, motion_hz=frequency
    )  # fmt: skip


def _without_events(noise: Noise, fit: Fit, label: str) -> tuple[Noise, tuple[str, ...]]:
    """The noise of the periods, unless the periods differ by more than what the residual holds at high frequencies.

    Noise has both; a force from outside, or anything else that does not repeat, only the first. What is correlated for
    longer than noise is need not be larger by a quarter.
    """
    fast = _residual_noise(fit, label)
    slow = noise.slow if noise.slow is not None else np.zeros(fit.model.joint_count)
    forgets = slow < max(limits.SLOW, limits.CHANCE / np.sqrt(_samples(fit.model, label)))
    more = noise.deviation > np.where(forgets, limits.NOT_NOISE, 1.0) * fast.deviation
    if not more.any():
        return noise, ()
    named = ", ".join(str(j + 1) for j in np.flatnonzero(more))
    text = (
        f"Joint {named}: the periods differ by more than their noise at high frequencies: something there does not "
        "repeat. It counts as model error, not as noise."
    )
    return replace(
        noise,
        deviation=np.where(more, fast.deviation, noise.deviation),
        correlation=np.where(more, np.clip(fast.correlation, 0.0, None), noise.correlation),
    ), (text,)


def motion_period(model: LoopModel, label: str) -> float | None:
    """Time in s after which the motion of an experiment repeats, None if it does not."""
    system = model.systems[label]
    ticks = period_in_ticks(_used(model.experiments[label].reference, system))
    return None if ticks is None else ticks * system.step_size


def _measured_noise(model: LoopModel, label: str) -> tuple[Noise | None, list[str]]:
    experiment = model.experiments[label]
    period = motion_period(model, label)
    if period is None:
        return None, []
    samples = period * experiment.rate_hz
    if abs(samples - round(samples)) > limits.WHOLE_SAMPLES:
        return None, ["The period of the motion is no whole number of torque samples, so periods were not compared."]
    count = round(samples)
    noise = noise_from_periods(
        experiment.with_gaps(experiment.torque),
        count,
        rate_hz=experiment.rate_hz,
        skip=round(limits.TRANSIENT * count),
        regressors=experiment.with_gaps(friction_columns(experiment)),
    )
    return (None, []) if noise is None else (replace(noise, period_s=period), [])


def _used(reference: Trajectory, system: System) -> Trajectory:
    """The columns that go into the loop: a file may hold measured ones too, which never repeat exactly."""
    sources = [c.source.partition(".") for c in system.connections]
    wanted = {column for name, _, column in sources if name == REFERENCE}
    names = [name for name in reference.names if name in wanted]
    return reference if not names else trajectory(reference.time, {n: reference.select([n])[:, 0] for n in names})


def friction_columns(experiment: Experiment) -> Array:
    """(N, n, 3) speed, its sign and time at the samples: along them friction that drifts shows."""
    n = experiment.torque.shape[1]
    reference = experiment.reference
    result = np.zeros((experiment.torque.shape[0], n, 3))
    step = float(reference.time[1] - reference.time[0])
    for j in range(n):
        name = f"dq{j + 1}"
        if name in reference.names:
            speed = reference.select([name])[:, 0]
        elif f"q{j + 1}" in reference.names:
            speed = np.gradient(reference.select([f"q{j + 1}"])[:, 0], step)
        else:
            continue
        at = np.interp(experiment.time, reference.time, speed)
        slow = limits.REVERSAL * max(float(np.abs(speed).max()), limits.STANDSTILL)
        result[:, j] = np.column_stack([at, np.tanh(at / slow), experiment.time - experiment.time[0]])
    return result


def with_nuisances(model: LoopModel) -> LoopModel:
    """The model with the smoothing velocity of each joint's Coulomb friction free: left fixed, its error would be taken
    for friction at low speed."""
    offered = {v.name: v for v in model.plant.parameters}
    references = [model.experiments[label].reference for label in model.estimation_labels]
    free_parameters = []
    for j in range(1, model.joint_count + 1):
        name = f"v0_{j}"
        if name not in offered or not all(f"q{j}" in reference.names for reference in references):
            continue
        speed = max(_largest_speed(reference, f"q{j}") for reference in references)
        if speed <= 0:
            continue
        scale, value = limits.SMOOTHING_SCALE, offered[name].start  # what is known of the robot lies within the limits
        low, high = min(limits.SMOOTHING[0] * speed, value), max(limits.SMOOTHING[1] * speed, value)
        free_parameters.append(
            FreeParameter(name, offered[name].unit, PLANT, name, value, scale * value, low, high, is_shape=True)
        )
    return model.with_free(free_parameters)


def _largest_speed(reference: Trajectory, name: str) -> float:
    step = float(reference.time[1] - reference.time[0])
    return float(np.abs(np.gradient(reference.select([name])[:, 0], step)).max())
