"""The base model of discovery: noise, nuisances, first fit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from fmu_didim.base.diagnostics import Diagnostic
from fmu_didim.base.errors import IdentificationError, InputError, SimulationError
from fmu_didim.checks.channels import CERTAIN, CHANNEL_OFF
from fmu_didim.data.signals import Array
from fmu_didim.dynamics.effects import EFFECTS
from fmu_didim.estimators.initial_states import free_start_remarks, free_starts, held_out_starts, is_asked
from fmu_didim.estimators.starts.start import start_sequence, start_text, start_values
from fmu_didim.fit.base_projection import BaseProjection
from fmu_didim.fit.derivatives.sensitivity import sensitivity
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.log_noise import channel_noise, repeated_noise, residual_noise, without_events
from fmu_didim.fit.noise.noise import LEAST_NOISE, Noise, pooled
from fmu_didim.fit.solver.accuracy import integrated, with_fitting_substeps
from fmu_didim.fit.solver.least_squares import minimise
from fmu_didim.fit.solver.termination import Stopping
from fmu_didim.fit.statistics import relative_error_percent
from fmu_didim.model.experiments import OutputBlock
from fmu_didim.model.free_parameter import PLANT, FreeParameter
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.motion import joint_reference
from fmu_didim.model.parameters import RobotParameters

SMOOTHING = (0.003, 0.05)
"""[1] Range of the smoothing velocity of Coulomb friction, as fractions of the largest speed of the joint; the value
of the description is always within."""
SMOOTHING_SCALE = 0.5
"""[1] Noticeable change of it, as a fraction of its value."""
FEWEST_SAMPLES = 5
"""[samples] For each parameter of the base model; with fewer nothing more can be found."""
ASTRAY = 200.0
"""[%] Error of the torque of the base model from which it is none to begin from: no model at all, with no torque, is
100 % off. What a loop that swings of itself does is not what the machine lacks."""
FIRST_NOISE = 1e-9
"""[N.m or N] Smallest deviation of a torque with which the first fit weights a joint."""

MOSTLY = 0.8
"""[1] Of the misfit of all outputs beside the base model, which offsets, scales and late clocks of the sensors explain,
from which they are taken to be wrong, those that explain as much divided by their number, and are left out: an effect
of the machine shows in the torque. Wrong sensors of an arm explain all of it, a torque log that is a fifth too large
0.78."""
ABSORBED = 5e-3
"""[1] Fraction of such a shape that must survive beside the base model."""
LEFT_OUT = (
    "{0} was left out: it {1}, which explains most of what the base model leaves of all signals, as a sensor that is "
    "off does, or a part of the machine of that form that is too small for the torque to show."
)
CHANNEL_ROUNDS = 2
"""[rounds] Of the noise of what is measured beside the torque and the fit with it: the first noise is that beside
values by the torque alone."""

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
    """The base model, fitted with the noise of its data, and notes on it.

    Attributes:
        doubts: about what else was measured; of_torque: the fit to the torque alone, where more was fitted; else None.
        start: name of a free parameter -> value from which it was fitted.
    """

    fit: Fit
    notes: tuple[str, ...] = ()
    doubts: tuple[Diagnostic, ...] = ()
    of_torque: Fit | None = None
    start: Mapping[str, float] = field(default_factory=dict)


def prepare(model: LoopModel) -> Prepared:
    """Noise and base fit of a loop model, from its own values or, where the loop fails with them, as identification:
    of the torque, and then of all outputs, where more is measured.

    Raises:
        InputError: the torque logs are too short; SimulationError: the loop fails with all start values.
    """
    found = replace(_of_torque(model.torque_alone), start=dict(zip(model.names, model.start, strict=True)))
    return found if not model.experiments.channels else _of_all_outputs(found, model)


def _of_all_outputs(prepared: Prepared, model: LoopModel) -> Prepared:
    """The base model fitted to all outputs, each with its own noise, from its fit to the torque."""
    fit = prepared.fit
    # What the fit to the torque has found of starts and of the integration belongs to its model.
    experiments = fit.model.experiments
    for label, experiment in model.experiments.items():
        begin = float(experiments[label].time[0])
        channels = tuple(channel.after(begin) for channel in experiment.channels)
        experiments = experiments.with_experiment(label, replace(experiments[label], channels=channels))
    whole = replace(fit.model.with_values(fit.values), experiments=experiments)
    fit = _point(whole, fit)
    off = _like_sensors(fit)
    if off:
        told = tuple(Diagnostic(CHANNEL_OFF, LEFT_OUT.format(name, text), name) for name, text in off.items())
        prepared = replace(prepared, doubts=(*prepared.doubts, *told))
        rest = model.experiments.without_channels(tuple(off))
        return prepared if not rest.channels else _of_all_outputs(
            prepared, replace(model, experiments=rest)
        )  # fmt: skip
    for _ in range(CHANNEL_ROUNDS):
        fit = minimise(fit.model, fit.noise, stopping=BASE_FIT)
        fit = replace(fit, noise=_noise(fit, prepared.fit.noise))
    fit = minimise(fit.model, fit.noise, stopping=BASE_FIT, jacobian=fit.jacobian, outputs=fit.outputs)
    return replace(prepared, fit=integrated(fit), of_torque=prepared.fit)


def _point(model: LoopModel, of_torque: Fit) -> Fit:
    """All outputs at the values of a fit to the torque, with the noise of each."""
    values = of_torque.values
    outputs = model.outputs(values)
    jacobian = sensitivity(model, values, outputs)
    fit = replace(of_torque, model=model, outputs=outputs, jacobian=jacobian, steps={})
    noise = _noise(fit, of_torque.noise)
    return replace(fit, noise=noise, deviation=np.asarray(1 / noise.weight))


def _noise(fit: Fit, of_torque: Noise) -> Noise:
    """The noise of all outputs: that of the torque as it is known, and that of each channel."""
    own = channel_noise(fit)
    return replace(
        of_torque,
        deviation=np.concatenate([of_torque.deviation, np.maximum(own.deviation, LEAST_NOISE * _size(fit.model))]),
        correlation=np.concatenate([of_torque.correlation, own.correlation]),
    )  # fmt: skip


def _like_sensors(fit: Fit) -> dict[str, str]:
    """Name of each channel that an offset, another scale or a late clock of its sensor brings to what the base model
    can make, to first order -> which of them, in words; where those of all channels explain most of what is left of all
    outputs, those that do their part."""
    model = fit.model
    base = BaseProjection.of(fit.jacobian, fit.noise.weight)
    left = base.rest_of(base.weighted(fit.residual))
    of_noise, all_left = float(model.output_counts @ fit.noise.factor), float(left @ left)
    if all_left <= of_noise:
        return {}
    shapes = [
        (name, text, unit, base.rest_of(base.weighted(column[:, :, None]))[:, 0])
        for block, name in zip(model.experiments.output_blocks[1:], model.experiments.channels, strict=True)
        for text, unit, column in _sensor_shapes(fit, block, name)
        if _survives(base, column)
    ]  # fmt: skip
    if not shapes:
        return {}
    table = np.column_stack([rest for *_, rest in shapes])
    together = table @ np.linalg.lstsq(table, left, rcond=None)[0]
    if float(together @ left) < MOSTLY * (all_left - of_noise):
        return {}
    bound = max(MOSTLY * (all_left - of_noise) / len(model.experiments.channels), CERTAIN**2 * all_left / of_noise)
    found: dict[str, str] = {}
    for name, text, unit, rest in shapes:
        amount = float(rest @ left) / float(rest @ rest)
        if amount**2 * float(rest @ rest) > bound:
            sign = "later" if amount > 0 else "earlier"
            found[name] = text.format(amount=amount, unit=unit, ms=1e3 * abs(amount), sign=sign)
    return found


def _survives(base: BaseProjection, column: Array) -> bool:
    """Whether the base model cannot make a change (M, m) of the outputs alone."""
    weighted = base.weighted(column)
    return bool(np.linalg.norm(base.rest_of(weighted)) > ABSORBED * np.linalg.norm(weighted))


def _sensor_shapes(fit: Fit, block: OutputBlock, name: str) -> Iterator[tuple[str, str, Array]]:
    """What an offset, a scale and a late clock of a channel change in all outputs, (M, m): after what to say of them,
    and the unit of the channel."""
    unit = next(c.unit for e in fit.model.experiments.values() for c in e.channels if c.name == name)
    zero = np.zeros_like(fit.outputs)
    offset, scale, late = zero.copy(), zero.copy(), zero.copy()
    for log in block.logs:
        simulated = fit.outputs[log.rows, block.columns][:, 0]
        offset[log.rows, block.columns] = 1.0
        scale[log.rows, block.columns] = (simulated - simulated.mean())[:, None]
        late[log.rows, block.columns] = -np.gradient(simulated, log.time)[:, None]
    yield "shows {amount:.3g} {unit} more than the simulation", unit, offset
    yield "moves {amount:+.2%} more than the simulation", unit, scale
    yield "is {ms:.3g} ms {sign} than the simulation", unit, late


def _size(model: LoopModel) -> Array:
    """(k,) root mean square of each channel that is fitted."""
    squares = np.sum(model.measured_outputs[:, model.joint_count :] ** 2, axis=0)
    return np.asarray(np.sqrt(squares / model.output_counts[model.joint_count :]))


def _of_torque(model: LoopModel) -> Prepared:
    """Noise and base fit by the torque alone, from other starts where the first leads astray or the loop fails."""
    first: Prepared | SimulationError
    try:
        first = _from_start(model)
        why = f"from the values of the description the fit goes astray ({_error(first.fit):.0f} % of the torque)"
        if _error(first.fit) < ASTRAY:
            return first
    except SimulationError as error:
        first, why = error, "with the values of the description the loop fails"
    for kind in start_sequence(model, "description")[1:]:
        try:
            found = _from_start(model.with_values(start_values(model, kind)))
        except (SimulationError, IdentificationError):
            continue
        if _error(found.fit) < ASTRAY:
            note = f"The search starts from {start_text(kind)}: {why}."
            return replace(found, notes=(note, *found.notes))
    if isinstance(first, SimulationError):
        raise first
    if not may_lack_base(model):
        raise IdentificationError(
            "The base model explains nothing of the torque.", where=", ".join(model.estimation_labels),
            got=f"an error of {_error(first.fit):.0f} % at the best fit, from all starts", valid=f"below {ASTRAY:g} %",
            next_step="Run fmu-didim identify, whose verdict says more: signs, units, clock, gains, or a motion that "
            "does not hold the values to what a machine may have. What is missing is looked for near the data.",
        )  # fmt: skip
    return first


def _error(fit: Fit) -> float:
    """[%] Error of the torque of a fit."""
    return relative_error_percent(fit.model.measured, fit.torque)[0]


def may_lack_base(model: LoopModel) -> bool:
    """Whether what belongs to every base model, friction above all, may be what leads a fit astray: of a plant that is
    not built from a description with it."""
    if not isinstance(model.parameters, RobotParameters):
        return True
    base = {name for name, effect in EFFECTS.items() if effect.is_base}
    return not all(base <= set(joint.effects) for joint in model.parameters.model.description.joints)


def _longer(model: LoopModel) -> str:
    """How to come to more samples: beside a virtual controller the rate of the log hardly matters."""
    if not model.loop.is_virtual:
        return "Record longer, or log at a higher rate."
    rate = min(experiment.rate_hz for experiment in model.experiments.values())
    return (
        f"Record longer, or log positions at a higher rate and with less noise: so many samples, {rate:.3g} a second, "
        "are left of a log that is compared up to two fifths of the bandwidth of the virtual controller (controller: "
        "{kind: tracking, bandwidth_hz: ...} states another one)."
    )


def _from_start(model: LoopModel) -> Prepared:
    samples, count = model.measured.shape[0], model.parameters.count
    if samples < FEWEST_SAMPLES * count:
        raise InputError(
            "The torque log is too short to look for more than the base parameters.",
            where=", ".join(model.estimation_labels), got=f"{samples} samples of each joint for {count} parameters",
            valid=f"{FEWEST_SAMPLES * count} and more", next_step=_longer(model),
        )  # fmt: skip
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
