"""What may be wrong where the outputs of a model do not fit: each suspect with what it would change.

    d_s(a) = y(suspect s by the amount a) - y

by a simulation with another value of a parameter, or with inputs that are larger by an offset, move more by a factor or
come later; or from the outputs themselves, that are shown with an offset, a factor, another clock or a drift. Beside
the sensitivities S of what is identified, a suspect explains (d' r)^2 / d' d of the squared residual r.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from fmu_didim.base.errors import FmuDidimError
from fmu_didim.checks.outputs.residuals import OutputResiduals
from fmu_didim.data.signals import Array
from fmu_didim.fit.noise.noise import TINY
from fmu_didim.model.free_parameter import PLANT, FreeParameter
from fmu_didim.model.loop_model import LoopModel

SMALL = 0.01
"""[1] First amount by which a value is moved, of its size or of what an input moves: beyond the jitter of solvers."""
MOST_INPUTS = 8
"""[inputs] That are suspected, those that move the outputs most often; three simulations each."""
MOST_PARAMETERS = 40
"""[parameters] Of the model that are tried at most, a simulation each: library models have hundreds."""
TRANSIENTS = (1.0, 3.0, 10.0, 30.0)
"""[samples] Time constants of what a wrong initial state leaves."""

A_LOSS = "a loss or load that the model lacks or a wrong scale"

Moved = Callable[[OutputResiduals, float], Array]
"""From an amount to what it changes of the outputs, (M, m); raises FmuDidimError."""


SAME_SLOPE = 1e-7
"""[1] Of the largest slope of an input, up to which it goes on straight: values at the ticks are rounded."""


@dataclass(frozen=True)
class Suspect:
    """Something that may differ from the model.

    Attributes:
        name: unique; first: the amount that is tried first; moved: what an amount changes.
        text: from amount and its standard deviation to words; advice: from the amount to what to do.
        is_linear: whether what it changes grows with the amount, so that no further simulation is needed.
    """

    name: str
    first: float
    moved: Moved
    text: Callable[[float, float], str]
    advice: Callable[[float], str]
    is_linear: bool = False


def with_unit(value: str, unit: str) -> str:
    """A value and its unit, if it has one."""
    return value if unit in ("", "1") else f"{value} {unit}"


def amount(value: float, deviation: float, unit: str = "") -> str:
    """``1.2 ± 0.1 K``, with a deviation of one digit."""
    return with_unit(f"{value:.3g} ± {deviation:.1g}", unit)


def more(value: float) -> str:
    """``more`` or ``less``."""
    return "more" if value > 0 else "less"


def of_outputs(found: OutputResiduals) -> Iterator[Suspect]:
    """Suspects that need no simulation: how outputs are shown, and where the model starts."""
    for k, (name, unit) in enumerate(zip(found.names, found.units, strict=True)):
        yield from _shown(found, k, name, unit)
    yield Suspect(
        "clock", 1.0, lambda r, a: -a * _rates(r),
        lambda a, s: f"outputs that are {amount(abs(a), s, 's')} {'late' if a > 0 else 'early'} beside the inputs, or "
        "inputs that are as much the other way",
        lambda a: "Check that both files share one clock: offset_s: of inputs or of measured brings one on the other "
        f"(measured: {{offset_s: {-a:.3g}}}); else the model lacks a lag.",
        is_linear=True,
    )  # fmt: skip
    yield from _starts(found)


def _shown(found: OutputResiduals, k: int, name: str, unit: str) -> Iterator[Suspect]:
    def only(column: Array) -> Array:
        table = np.zeros(found.outputs.shape)
        table[found.rows(k), k] = column
        return table

    own, time = found.outputs[found.rows(k), k], found.times(k)
    span = max(float(np.ptp(time)), TINY)
    yield Suspect(
        f"offset of {name}", 1.0, lambda _, a: only(np.full(time.size, a)),
        lambda a, s: f"{name} that shows {amount(abs(a), s, unit)} {more(a)} than it is",
        lambda a: f"Check the sensor: measured: {{columns: {{{name}: {{zero: {a:.3g}}}}}}} takes an offset out.",
        is_linear=True,
    )  # fmt: skip
    yield Suspect(
        f"scale of {name}", SMALL, lambda _, a: only(a * (own - own.mean())),
        lambda a, s: f"{name} that moves {amount(abs(100 * a), 100 * s, '%')} {more(a)} than simulated, by "
        + ("a wrong scale or too much damping in the model" if a > 0 else A_LOSS),
        lambda a: f"Check unit and scale of {name} (measured: {{columns: {{{name}: {{unit: ...}}}}}}), and what of the "
        "model sets how far it moves, such as a loss or a load that it lacks.",
        is_linear=True,
    )  # fmt: skip
    yield Suspect(
        f"drift of {name}", 1.0, lambda _, a: only(a * (time - time[0]) / span),
        lambda a, s: f"{name} that drifts by {amount(a, s, unit)} over the experiment",
        lambda _: f"Check the sensor of {name} for drift, and the model for what changes slowly: a parameter that is "
        "not constant, an input that was not recorded.",
        is_linear=True,
    )  # fmt: skip


def _rates(found: OutputResiduals) -> Array:
    """(M, m) time derivatives of the simulated outputs."""
    table = np.zeros(found.outputs.shape)
    for k in range(len(found.names)):
        for log in found.logs(k):
            rows = found.indices(log.rows)
            table[rows, k] = np.gradient(found.outputs[rows, k], log.time)
    return table


def _starts(found: OutputResiduals) -> Iterator[Suspect]:
    """What decays from the start of an experiment."""
    for k, name in enumerate(found.names):
        for count in TRANSIENTS:
            table = np.zeros(found.outputs.shape)
            for log in found.logs(k):
                constant = count * float(np.median(np.diff(log.time)))
                table[found.indices(log.rows), k] = np.exp(-(log.time - log.time[0]) / constant)
            unit, many = found.units[k], count * float(np.median(np.diff(found.logs(k)[0].time)))

            def moved(_: OutputResiduals, a: float, table: Array = table) -> Array:
                return a * table

            def text(a: float, s: float, name: str = name, unit: str = unit, many: float = many) -> str:
                return f"a start of {name} that is off by {amount(a, s, unit)} and forgotten within some {many:.3g} s"

            yield Suspect(
                f"start of {name}, {count:g}", 1.0, moved, text,
                lambda _: "Let the model start where the data do: give or identify its initial state (identify: {start "
                "value in the model: {}}), or cut the transient (from_s).",
                is_linear=True,
            )  # fmt: skip


def of_inputs(found: OutputResiduals) -> Iterator[Suspect]:
    """An offset, a scale and a delay of each input, by a simulation each."""
    references = [found.model.experiments[label].reference for label in found.model.estimation_labels]
    if any(np.ptp(reference.values, axis=0).any() for reference in references):
        yield _interpolation(found)
    units = {v.name: v.unit for v in found.model.loop.plant.inputs}
    for name in references[0].names[:MOST_INPUTS]:
        columns = [reference.column(name) for reference in references]
        size = float(np.ptp(np.concatenate(columns)))
        step = float(np.median(np.diff(references[0].time)))
        yield _offset_of_input(name, units.get(name, ""), size or max(float(np.abs(columns[0]).max()), 1.0))
        if size > 0:
            yield _scale_of_input(name)
            yield _delay_of_input(name, step)


def _interpolation(found: OutputResiduals) -> Suspect:
    """Inputs that are held from row to row where the case has straight lines between them, or the other way round."""
    are_linear = any(system.ramps for system in found.model.loop.systems.values())
    kind = "held" if are_linear else "linear"
    otherwise = cache(lambda: _interpolated_otherwise(found))
    what = "were held from row to row" if are_linear else "went straight from row to row"
    return Suspect(
        "interpolation", 1.0, lambda _, a: a * otherwise(),
        lambda a, s: f"inputs that {what} (to {amount(100 * a, 100 * s, '%')})",
        lambda _: f"State it: inputs: {{interpolation: {kind}}}.",
        is_linear=True,
    )  # fmt: skip


def _interpolated_otherwise(found: OutputResiduals) -> Array:
    """What the other interpolation of all inputs changes."""
    model = found.model
    systems = dict(model.loop.systems)
    for label in model.estimation_labels:
        experiment, system = model.experiments[label], systems[label]
        reference = experiment.reference
        values = reference.values.copy()
        for place, name in enumerate(reference.names):
            values[:, place] = of_other_interpolation(reference.time, values[:, place], is_linear=name in system.ramps)
        systems[label] = replace(system, ramps=frozenset(reference.names) - system.ramps)
        model = model.with_experiment(label, replace(experiment, reference=replace(reference, values=values)))
    return model.with_loop(systems=systems).outputs(found.values) - found.outputs


def of_other_interpolation(time: Array, values: Array, *, is_linear: bool) -> Array:
    """(T,) an input at the ticks, held between its rows where it was linear, and linear where it was held.

    Its rows are where it changes its slope, or its value.
    """
    if is_linear:
        slope = np.diff(values) / np.diff(time)
        bends = np.abs(np.diff(slope)) > SAME_SLOPE * max(float(np.abs(slope).max()), TINY)
        rows = np.concatenate([[True], bends, [True]])
        return np.asarray(values[np.maximum.accumulate(np.where(rows, np.arange(values.size), 0))])
    rows = np.concatenate([[True], np.diff(values) != 0])
    return np.asarray(np.interp(time, time[rows], values[rows]))


def _offset_of_input(name: str, unit: str, size: float) -> Suspect:
    return Suspect(
        f"offset of {name}", SMALL * size, lambda r, a: _driven(r, name, lambda _, u: u + a),
        lambda a, s: f"a constant influence that the model lacks, or {name} being {amount(abs(a), s, unit)} "
        f"{'larger' if a > 0 else 'smaller'} than recorded",
        lambda a: f"Look for what acts besides the inputs, such as a further source, load or neighbour; check zero and "
        f"unit of {name} (inputs: {{columns: {{{name}: ...}}}}).",
    )  # fmt: skip


def _scale_of_input(name: str) -> Suspect:
    return Suspect(
        f"scale of {name}", SMALL, lambda r, a: _driven(r, name, lambda _, u: u + a * (u - u.mean())),
        lambda a, s: f"{name} acting {amount(abs(100 * a), 100 * s, '%')} {more(a)} than the model has it",
        lambda a: f"Check unit and scale of {name} (inputs: {{columns: {{{name}: {{scale: ...}}}}}}), and what of the "
        "model weighs it.",
    )  # fmt: skip


def _delay_of_input(name: str, step: float) -> Suspect:
    return Suspect(
        f"delay of {name}", step, lambda r, a: _driven(r, name, lambda t, u: np.interp(t - a, t, u)),
        lambda a, s: f"{name} acting {amount(abs(a), s, 's')} {'later' if a > 0 else 'earlier'} than recorded: "
        f"{'the inputs' if a > 0 else 'the outputs'} are early, or the model {'lacks' if a > 0 else 'has'} a delay",
        lambda a: f"Check the clocks of both files (inputs: {{offset_s: {a:.3g}}} shifts all of them); where {name} "
        "alone comes late, shift its column, or add the delay to the model.",
    )  # fmt: skip


def _driven(found: OutputResiduals, name: str, changed: Callable[[Array, Array], Array]) -> Array:
    """What another course of an input changes, ``changed`` being made of the instants and its values."""
    model = found.model
    for label in model.estimation_labels:
        experiment = model.experiments[label]
        reference = experiment.reference
        values = reference.values.copy()
        place = reference.names.index(name)
        values[:, place] = changed(reference.time, values[:, place])
        model = model.with_experiment(label, replace(experiment, reference=replace(reference, values=values)))
    return model.outputs(found.values) - found.outputs


def of_parameters(found: OutputResiduals) -> Iterator[Suspect]:
    """Each further parameter of the model, which keeps the value of its file."""
    return (_parameter(free) for free in held_parameters(found.model))


def _parameter(free: FreeParameter) -> Suspect:
    name, start, unit = free.key, free.value, free.unit
    return Suspect(
        f"parameter {name}", SMALL * free.scale, moved_parameter(free),
        lambda a, s: f"{name} = {amount(start + a, s, unit)} in the place of {start:.4g}",
        lambda a: f"Identify it too (identify: {{{name}: {{}}}}), or correct its value (model: {{parameters: {{{name}: "
        f"{start + a:.4g}}}}}) if that can be.",
    )  # fmt: skip


def held_parameters(model: LoopModel, most: int | None = MOST_PARAMETERS) -> list[FreeParameter]:
    """The parameters of a model that are not identified, as free ones; ``most``: of them at most, None for all."""
    known = {*model.parameters.plant_names, *(p.key for p in model.free_parameters), "t_start"}
    offered = [v for v in model.loop.plant.parameters if v.name not in known][:most]
    return [
        FreeParameter(v.name, v.unit, PLANT, v.name, float(v.start), abs(float(v.start)) or 1.0)
        for v in offered if np.isfinite(float(v.start))
    ]  # fmt: skip


def moved_parameter(free: FreeParameter) -> Moved:
    """What another value of a parameter of the model changes."""

    def moved(found: OutputResiduals, a: float) -> Array:
        freed = found.model.with_free((*found.model.free_parameters, free))
        return freed.outputs(np.append(found.values, free.value + a)) - found.outputs

    return moved


def first_changes(found: OutputResiduals, suspects: Iterator[Suspect]) -> dict[Suspect, Array]:
    """What the first amount of each suspect changes, (M, m); those that cannot be simulated are left out."""
    tables = {}
    for suspect in suspects:
        try:
            table = suspect.moved(found, suspect.first)
        except FmuDidimError:
            continue
        if np.isfinite(table).all() and table.any():
            tables[suspect] = table
    return tables
