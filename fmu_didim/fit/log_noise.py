"""Noise of the torque logs of a loop model: by the periods of their motion, else by the residual of a fit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from fmu_didim.cosim import System
from fmu_didim.cosim.system import REFERENCE
from fmu_didim.data.signals import Array, Trajectory, trajectory
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.noise.noise import (
    Noise,
    joint_speed,
    motion_frequency,
    noise_from_periods,
    noise_from_residual,
    period_in_ticks,
    pooled,
)
from fmu_didim.model.experiment import Experiment
from fmu_didim.model.loop_model import LoopModel

NOT_NOISE = 1.25
"""[1] Periods whose difference is this many times the noise at high frequencies differ by more than noise."""
SLOW = 0.25
"""[1] So do those whose difference is that correlated over a time in which noise is not,"""
CHANCE = 3.0
"""[standard deviations] unless chance gives a correlation as large in this number of samples."""
TRANSIENT = 0.1
"""[1] Fraction of a period that is left out when periods are compared: the first one may begin with a transient."""
WHOLE_SAMPLES = 1e-3
"""[samples] A period that is farther from a whole number of samples is not compared: the difference would show the
shift."""
REVERSAL = 0.01
"""[1] Fraction of the largest speed over which the sign of a speed changes, in the columns along which friction
drifts."""
STANDSTILL = 1e-9
"""[SI] Smallest range to compare with, for a joint that rests."""


def motion_period(model: LoopModel, label: str) -> float | None:
    """Time in s after which the motion of an experiment repeats, None if it does not."""
    system = model.loop.systems[label]
    reference = _used(model.experiments[label].reference, system)
    ticks = period_in_ticks(reference)
    return None if ticks is None else ticks * system.step_size


def _used(reference: Trajectory, system: System) -> Trajectory:
    """The columns that the loop uses: a file may hold measured ones too, which never repeat exactly."""
    sources = [c.source.partition(".") for c in system.connections]
    wanted = {column for name, _, column in sources if name == REFERENCE}
    names = [name for name in reference.names if name in wanted]
    return reference if not names else trajectory(reference.time, {n: reference.column(n) for n in names})


def repeated_noise(model: LoopModel) -> tuple[dict[str, Noise], list[str]]:
    """Label of each experiment whose motion repeats -> noise of its log; and remarks on those of which it was not
    taken."""
    found, notes = {}, []
    for label in model.estimation_labels:
        experiment, period = model.experiments[label], motion_period(model, label)
        if period is None:
            continue
        count = _whole(period * experiment.rate_hz)
        if count is None:
            notes.append("The period of the motion is no whole number of torque samples, so periods were not compared.")
            continue
        noise = noise_from_periods(
            experiment.with_gaps(model.experiments.measured_in(label)),
            count,
            rate_hz=experiment.rate_hz,
            skip=round(TRANSIENT * count),
            regressors=experiment.with_gaps(friction_columns(experiment)),
        )
        if noise is not None:
            found[label] = replace(noise, period_s=period)
    return found, notes


def known_noise(model: LoopModel) -> Array | None:
    """(n,) standard deviation of the torque logs without any model: as the case states it, or as the differences of
    periods show it; None where neither exists. It is that of the unfiltered logs.
    """
    if model.torque_deviation is not None:
        return model.torque_deviation
    repeated, _ = repeated_noise(model.with_low_pass(None))
    if set(repeated) != set(model.estimation_labels):
        return None
    return pooled(list(repeated.values())).deviation


def noise_beside_fit(fit: Fit) -> Noise:
    """The noise of a fit taken anew, from the differences of periods of what the fit leaves instead of the logs
    themselves."""
    if fit.noise.source != "periods":
        return residual_noise(fit)
    found = []
    for label, rows in fit.model.experiments.rows.items():
        period, experiment = motion_period(fit.model, label), fit.model.experiments[label]
        count = None if period is None else _whole(period * experiment.rate_hz)
        if count is None:
            continue
        residual = experiment.with_gaps(fit.residual[rows])
        noise = noise_from_periods(residual, count, rate_hz=experiment.rate_hz, skip=0)
        if noise is not None:
            found.append(replace(noise, period_s=period))
    return pooled(found) if found else fit.noise


def residual_noise(fit: Fit) -> Noise:
    """The noise of logs without repetition, from what a fit leaves of all experiments."""
    return pooled([_residual_noise(fit, label) for label in fit.model.estimation_labels])


def channel_noise(fit: Fit) -> Noise:
    """(k,) noise of what is fitted beside the torque: as the case states it, or by what a fit leaves of each at high
    frequencies."""
    model, stated = fit.model, fit.model.experiments.stated_deviations
    deviation, correlation = stated.copy(), np.zeros(stated.size)
    for k, block in enumerate(model.experiments.output_blocks[1:]):
        if not np.isnan(stated[k]):
            continue
        found = []
        for log in block.logs:
            motion_hz = motion_frequency(model.experiments[log.label].reference, model.joint_count)
            rate_hz = (log.time.size - 1) / float(np.ptp(log.time))
            found.append(
                noise_from_residual(fit.residual[log.rows, block.columns], rate_hz=rate_hz, motion_hz=motion_hz)
            )
        noise = pooled(found)
        deviation[k], correlation[k] = noise.deviation[0], noise.correlation[0]
    return Noise(deviation, correlation, "residual")


def without_events(noises: Mapping[str, Noise], fit: Fit) -> tuple[Noise, list[str]]:
    """The noise of the periods, unless the periods differ by more than what the residual holds at high frequencies;
    and a remark where they do.

    Noise has both; a force from outside, or anything else that does not repeat, only the first. What is correlated for
    longer than noise is need not be larger by a quarter.
    """
    checked, notes = [], []
    for label, noise in noises.items():
        fast = _residual_noise(fit, label)
        slow = noise.slow if noise.slow is not None else np.zeros(fit.model.joint_count)
        forgets = slow < max(SLOW, CHANCE / np.sqrt(noise.samples))
        more = noise.deviation > np.where(forgets, NOT_NOISE, 1.0) * fast.deviation
        if not more.any():
            checked.append(noise)
            continue
        deviation = np.where(more, fast.deviation, noise.deviation)
        correlation = np.where(more, np.clip(fast.correlation, 0.0, None), noise.correlation)
        checked.append(replace(noise, deviation=deviation, correlation=correlation))
        named = ", ".join(str(j + 1) for j in np.flatnonzero(more))
        notes.append(
            f"Joint {named}: the periods differ by more than their noise at high frequencies: something there does not "
            "repeat. It counts as model error, not as noise."
        )
    return pooled(checked), notes


def _residual_noise(fit: Fit, label: str) -> Noise:
    experiment = fit.model.experiments[label]
    frequency = motion_frequency(experiment.reference, fit.model.joint_count)
    residual = fit.residual[fit.model.experiments.rows[label]]
    return noise_from_residual(
        residual, rate_hz=experiment.rate_hz, motion_hz=frequency, cutoff_hz=experiment.operator.cutoff_hz
    )


def _whole(samples: float) -> int | None:
    """A number of samples as an integer; None if it is not whole."""
    return None if abs(samples - round(samples)) > WHOLE_SAMPLES else round(samples)


def friction_columns(experiment: Experiment) -> Array:
    """(N, n, 3) speed, its sign and time at the samples: along them friction that drifts shows."""
    n = experiment.torque.shape[1]
    reference = experiment.reference
    result = np.zeros((experiment.torque.shape[0], n, 3))
    for j in range(n):
        if not {f"q{j + 1}", f"dq{j + 1}"} & set(reference.names):
            continue
        speed = joint_speed(reference, j + 1)
        at = np.interp(experiment.time, reference.time, speed)
        slow = REVERSAL * max(float(np.abs(speed).max()), STANDSTILL)
        result[:, j] = np.column_stack([at, np.tanh(at / slow), experiment.time - experiment.time[0]])
    return result
