"""From a problem to the base model of discovery: noise, nuisances, first fit."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fmu_didim.diagnosis.log_checks import check_log
from fmu_didim.errors import InputError
from fmu_didim.master import System
from fmu_didim.master.system import REFERENCE
from fmu_didim.prediction.least_squares import Fit, integrated, minimise
from fmu_didim.prediction.loop_model import PLANT, FreeParameter, LoopModel, loop_model
from fmu_didim.prediction.noise import (
    Noise,
    motion_frequency,
    noise_from_periods,
    noise_from_residual,
    period_in_ticks,
)
from fmu_didim.prediction.problem import Experiment, Problem
from fmu_didim.signals import Array, Trajectory, trajectory

SMOOTHING = (0.003, 0.05)
"""Range of the smoothing velocity of Coulomb friction, in parts of the largest speed of the joint; the value of the
description is always part of it."""
NOT_NOISE = 1.25
"""Periods whose difference is this many times the noise at high frequencies differ by more than noise."""
SLOW = 0.25
"""So do those whose difference is that correlated over a time in which noise is not."""
TRANSIENT = 0.1
"""Part of a period that is left out when periods are compared: the first one may begin with a transient."""


@dataclass(frozen=True)
class Prepared:
    """The base model, fitted, and the noise of its data."""

    fit: Fit
    noise: Noise
    notes: tuple[str, ...] = ()


def prepare(problem: Problem, others: dict[str, Problem], *, workers: int = 2) -> Prepared:
    """Noise and base fit of a problem; ``others`` are held-out experiments.

    Raises:
        InputError: the torque log is too short, or cannot be that of this loop.
    """
    experiment = problem.experiment
    if experiment.torque.shape[0] < 5 * problem.parameters.count:
        raise InputError(
            "The torque log is too short to look for more than the base parameters.",
            where=experiment.label,
            got=f"{experiment.torque.shape[0]} samples for {problem.parameters.count} parameters",
        )
    model = replace(with_nuisances(loop_model(problem, others, workers=workers)), coarse=True)
    remarks = [remark for label in model.runs for remark in check_log(model, label)]
    noise, notes = _measured_noise(experiment, problem)
    notes = [*remarks, *notes]
    if noise is not None:
        fit = minimise(model, noise)
        noise, further = _without_events(noise, fit, experiment, problem.joint_count)
        return Prepared(integrated(fit, noise, coarse=False), noise, (*notes, *further))
    # Without repetition: all joints alike at first, then the noise that the residual shows.
    spread = np.std(experiment.torque, axis=0)
    fit = minimise(model, Noise(np.maximum(spread, 1e-9), np.zeros(spread.size), "residual"))
    frequency = motion_frequency(experiment.reference, problem.joint_count)
    noise = noise_from_residual(fit.residual, rate_hz=experiment.rate_hz, motion_hz=frequency)
    notes.append(
        "The motion does not repeat: the noise is taken from what the residual holds above the frequencies of the "
        "motion, an upper bound."
    )
    fit = minimise(fit.model, noise, jacobian=fit.jacobian, torque=fit.torque)
    return Prepared(integrated(fit, noise, coarse=False), noise, tuple(notes))


def _without_events(noise: Noise, fit: Fit, experiment: Experiment, joints: int) -> tuple[Noise, tuple[str, ...]]:
    """The noise of the periods, unless the periods differ by more than what the residual holds at high frequencies.

    Noise has both; a force from outside, or anything else that does not repeat, only the first. What is correlated for
    longer than noise is need not be larger by a quarter.
    """
    frequency = motion_frequency(experiment.reference, joints)
    fast = noise_from_residual(fit.residual, rate_hz=experiment.rate_hz, motion_hz=frequency)
    slow = noise.slow if noise.slow is not None else np.zeros(joints)
    forgets = slow < max(SLOW, 3 / np.sqrt(experiment.torque.shape[0]))
    more = noise.deviation > np.where(forgets, NOT_NOISE, 1.0) * fast.deviation
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


def _measured_noise(experiment: Experiment, problem: Problem) -> tuple[Noise | None, list[str]]:
    ticks = period_in_ticks(_used(experiment.reference, problem.system))
    if ticks is None:
        return None, []
    period = ticks * problem.system.step_size
    samples = period * experiment.rate_hz
    if abs(samples - round(samples)) > 1e-3:
        return None, ["The period of the motion is no whole number of torque samples, so periods were not compared."]
    count = round(samples)
    noise = noise_from_periods(
        experiment.with_gaps(experiment.torque),
        count,
        rate_hz=experiment.rate_hz,
        skip=round(TRANSIENT * count),
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
        slow = 0.01 * max(float(np.abs(speed).max()), 1e-12)
        result[:, j] = np.column_stack([at, np.tanh(at / slow), experiment.time - experiment.time[0]])
    return result


def with_nuisances(model: LoopModel) -> LoopModel:
    """The model with the smoothing velocity of each joint's Coulomb friction free: left fixed, its error would be taken
    for friction at low speed."""
    offered = {v.name: v for v in model.plant.parameters}
    reference = model.runs["train"].problem.experiment.reference
    free_parameters = []
    step = float(reference.time[1] - reference.time[0])
    for j in range(1, model.joint_count + 1):
        name = f"v0_{j}"
        if name not in offered or f"q{j}" not in reference.names:
            continue
        speed = float(np.abs(np.gradient(reference.select([f"q{j}"])[:, 0], step)).max())
        if speed <= 0:
            continue
        value = offered[name].start  # what is known of the robot lies within the limits
        low, high = min(SMOOTHING[0] * speed, value), max(SMOOTHING[1] * speed, value)
        free_parameters.append(
            FreeParameter(name, offered[name].unit, PLANT, name, value, 0.5 * value, low, high, is_shape=True)
        )
    return replace(model, free_parameters=(*model.free_parameters, *free_parameters))
