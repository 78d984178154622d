"""The base model of discovery: noise, nuisances, first fit."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fmu_didim.base.errors import IdentificationError, InputError, SimulationError
from fmu_didim.estimators.initial_states import free_start_remarks, free_starts, held_out_starts, is_asked
from fmu_didim.estimators.start import start_sequence, start_text, start_values
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.log_noise import repeated_noise, residual_noise, without_events
from fmu_didim.fit.noise.noise import Noise, pooled
from fmu_didim.fit.solver.accuracy import integrated, with_fitting_substeps
from fmu_didim.fit.solver.least_squares import minimise
from fmu_didim.fit.solver.termination import Stopping
from fmu_didim.model.free_parameter import PLANT, FreeParameter
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.motion import joint_reference

SMOOTHING = (0.003, 0.05)
"""[1] Range of the smoothing velocity of Coulomb friction, as fractions of the largest speed of the joint; the value
of the description is always within."""
SMOOTHING_SCALE = 0.5
"""[1] Noticeable change of it, as a fraction of its value."""
FEWEST_SAMPLES = 5
"""[samples] For each parameter of the base model; with fewer nothing more can be found."""
FIRST_NOISE = 1e-9
"""[N.m or N] Smallest deviation of a torque with which the first fit weights a joint."""

BASE_FIT = Stopping(exact=True)
"""The best sensitivities, which are projected out of all candidates."""
NO_REPETITION = (
    "The motion does not repeat: the noise is taken from the residual above the frequencies of the motion, "
    "an upper bound."
)
MAY_BE_OFF = (
    "{}: its first samples stand out, as those of a motion that does not start on its reference, or of a missing "
    "effect. Write initial_state: free if the start is unknown."
)


@dataclass(frozen=True)
class Prepared:
    """The base model, fitted with the noise of its data, and notes on it."""

    fit: Fit
    notes: tuple[str, ...] = ()


def prepare(model: LoopModel) -> Prepared:
    """Noise and base fit of a loop model, from its own values or, where the loop fails with them, as identification.

    Raises:
        InputError: the torque logs are too short; SimulationError: the loop fails with all start values.
    """
    try:
        return _from_start(model)
    except SimulationError as failed:
        for kind in start_sequence(model, "description")[1:]:
            try:
                found = _from_start(model.with_values(start_values(model, kind)))
            except (SimulationError, IdentificationError):
                continue
            note = f"The search starts from {start_text(kind)}: with the values of the description the loop fails."
            return replace(found, notes=(note, *found.notes))
        raise failed


def _from_start(model: LoopModel) -> Prepared:
    samples, count = model.measured.shape[0], model.parameters.count
    if samples < FEWEST_SAMPLES * count:
        raise InputError(
            "The torque log is too short to look for more than the base parameters.",
            where=", ".join(model.estimation_labels),
            got=f"{samples} samples for {count} parameters",
        )
    model = with_nuisances(model)
    repeated, notes = repeated_noise(model)
    spread = np.maximum(np.std(model.measured, axis=0), FIRST_NOISE)
    # Without repetition all joints are weighted alike at first; then the residual shows the noise.
    first = pooled(list(repeated.values())) if repeated else Noise(spread, np.zeros(spread.size), "residual")
    known = first.deviation if repeated else None
    fit = minimise(with_fitting_substeps(model, model.start, known), first, stopping=BASE_FIT)
    if repeated:
        fit, started = _started(fit)
        noise, further = without_events(repeated, fit)
        return Prepared(integrated(replace(fit, noise=noise)), (*notes, *started, *further))
    fit, started = _started(fit)
    fit = minimise(fit.model, residual_noise(fit), stopping=BASE_FIT, jacobian=fit.jacobian, outputs=fit.outputs)
    return Prepared(integrated(fit), (*notes, *started, NO_REPETITION))


def _started(fit: Fit) -> tuple[Fit, list[str]]:
    """The fit with the initial states free, or found where held out, that the case asks for; and notes. No others: an
    effect that is missing may look like a start that is off the reference."""
    starts = free_starts(fit)
    asked = tuple(start for start in starts if start.experiment is not None and is_asked(fit, start.experiment))
    notes = [MAY_BE_OFF.format(label) for label in dict.fromkeys(k.experiment for k in starts if k not in asked)]
    if asked:
        model = fit.model.with_free((*fit.model.free_parameters, *asked))
        fit = minimise(model, fit.noise, stopping=BASE_FIT)
    model, further = held_out_starts(fit, asked_only=True)
    return replace(fit, model=model), [*notes, *free_start_remarks(fit, asked), *further]


def with_nuisances(model: LoopModel) -> LoopModel:
    """The model with the smoothing velocity of each joint's Coulomb friction free: left fixed, its error would be taken
    for friction at low speed."""
    offered = {v.name: v for v in model.loop.plant.parameters}
    references = [model.experiments[label].reference for label in model.estimation_labels]
    free_parameters = []
    for j in range(1, model.joint_count + 1):
        name = f"v0_{j}"
        if name not in offered:
            continue
        speed = max(float(np.abs(joint_reference(reference, j)[1]).max()) for reference in references)
        if speed <= 0:
            continue
        unit, value = offered[name].unit, offered[name].start  # which lies within the limits
        low, high = min(SMOOTHING[0] * speed, value), max(SMOOTHING[1] * speed, value)
        scale = SMOOTHING_SCALE * value
        free_parameters.append(FreeParameter(name, unit, PLANT, name, value, scale, low, high, is_shape=True))
    return model.with_free((*model.free_parameters, *free_parameters))
