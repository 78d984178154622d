"""Which single thing that may differ from the case explains what a fit leaves: each suspect is tried in the loop.

A suspect has one parameter a, which is fitted beside the values theta by steps with the sensitivities S of the fit,

    r(theta, a) = y - y_s(theta; a),      min over theta and a of sum |r / s|^2,

or stands for another way of sampling, which has none. Those are tried that promise most by one linear step; of what
is known to first order alone (:mod:`fmu_didim.checks.motion.misfits`) that step is all. What one explains is the fall
of that sum. A suspect is named where what still follows the motion beside it
(:mod:`fmu_didim.checks.motion.dependence`) is little against that; those that explain as much are named beside it, in
this order. Effects of the catalogue compete, too: where one explains more, the model lacks something, and no error of
the case is named.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, Code, Diagnostic
from fmu_didim.base.errors import FmuDidimError, SimulationError
from fmu_didim.checks.data.robot import GRAVITY, LINK_LENGTH, TORQUE_SCALE
from fmu_didim.checks.data.timing import CLOCK_EARLY, CLOCK_LATE, COMMAND_DELAY, SAMPLING_KIND
from fmu_didim.checks.motion.colour import orthonormal, rest_of
from fmu_didim.checks.motion.dependence import (
    DEPENDS_ON_MOTION,
    MOTION_CHANCE,
    OWN_PART,
    independent,
    residuals_of_fit,
    tested_rows,
)
from fmu_didim.checks.motion.misfits import Misfit, Misfits
from fmu_didim.checks.sampling_kind import other_ways, way_text
from fmu_didim.cosim import SampleOperator
from fmu_didim.data.signals import Array
from fmu_didim.fit.fit import Fit, sum_of_squares
from fmu_didim.fit.noise.noise import TINY
from fmu_didim.fit.noise.weighting import whitened
from fmu_didim.fit.solver.admissible import mass_matrix_problem
from fmu_didim.model.free_parameter import DELAY, LOG
from fmu_didim.model.workers import side_by_side

TRIED = 4
"""[suspects] That promise most by one linear step, and are tried in the loop."""
ROUNDS = 10
"""[steps] At most, with the sensitivities of the fit, corrected by what each step has changed: a torque that is twice
as large is then found to 3 %."""
SHORTENED = (1.0, 0.5, 0.25)
"""[1] Parts of a step that are tried until the sum falls."""
SETTLED = 1e-3
"""[1] Part of the sum that a step must take off for another one to follow."""
MOSTLY = 0.6
"""[1] Of what it explains and what still follows the motion beside it, from which a suspect is named."""
AS_WELL = 0.9
"""[1] Of what the best suspect explains, from which another one is named beside it."""
NAMED = 3
"""[suspects] At most that are named together."""
SURE = 4.0
"""[standard deviations] Between an amount and none, from which a suspect counts."""
STEP = 1e-3
"""[1] Change of a scale, or of a shift in control periods, for a slope."""
DEPENDENT = 1e-9
"""[1] Singular value, of the largest one, of directions along which no step is made."""

POSITION_ZERO = CATALOGUE(
    "position-zero", DOUBT, rank=21,
    meaning="Another zero of the position of a joint explains the residual torque.",
    next_step="Drive the joint to its mark or against its stop, and compare the position that is shown there.",
)  # fmt: skip
OF_CASE = {CLOCK_LATE, CLOCK_EARLY, COMMAND_DELAY, SAMPLING_KIND, TORQUE_SCALE, LINK_LENGTH, GRAVITY}
"""What is suspected before a fit, along a motion near the measured one."""
OF_DESCRIPTION = {"gravity": GRAVITY, "link_length": LINK_LENGTH, "position_zero": POSITION_ZERO}
"""Misfit -> what it is called; what is stated at the base is another gravity, too."""

Left = Callable[[Array, float], Array]
"""From values (p,) and an amount to the residual (N, n); raises SimulationError."""
Told = Callable[[float, float], Diagnostic | None]
"""From an amount and its standard deviation to what is said of it; nothing of what discovery names."""


@dataclass(frozen=True)
class Suspect:
    """Something that may differ from the case.

    Attributes:
        name: unique; left: the residual with an amount of it, as (N, n).
        told: what is said of it.
        step: for a slope; None where it is there or not, which is an amount of one.
        first: amount from which it is tried; least: below which none can be.
        is_linear: whether it is known to first order alone.
    """

    name: str
    left: Left
    told: Told
    step: float | None
    first: float = 0.0
    least: float = -np.inf
    is_linear: bool = False


@dataclass(frozen=True)
class Tried:
    """A suspect as tried: amount and standard deviation, residual (N, n), its columns (N, n, p + 1) or (N, n, p), and
    by how much the sum of squares has fallen."""

    suspect: Suspect
    amount: float
    deviation: float
    residual: Array
    columns: Array
    explained: float

    @property
    def counts(self) -> bool:
        """Whether it explains anything, by an amount that is sure."""
        return self.explained > 0 and abs(self.amount) > SURE * self.deviation


@dataclass(frozen=True)
class ByValues:
    """What one linear step of the values of a fit leaves, beyond the limits of machines, too: what each suspect is held
    against."""

    fit: Fit

    @cached_property
    def basis(self) -> Array:
        """(N n, r) orthonormal, of all that the values change, over the deviations of the residual."""
        return orthonormal(independent(whitened(self.fit.jacobian, self.fit.deviation)))

    @cached_property
    def left(self) -> float:
        """Sum of squares."""
        rest = rest_of(_flat(self.fit.residual, self.fit), self.basis)
        return float(rest @ rest)

    def left_with(self, suspect: Suspect) -> float:
        """Sum of squares after one linear step of the values and a suspect; infinite where it cannot be simulated."""
        try:
            slope, residual = _slope(self.fit, suspect)
        except FmuDidimError:
            return np.inf
        rest = rest_of(_flat(residual, self.fit), self.basis)
        if slope is not None:
            column = _flat(slope, self.fit)
            own = rest_of(column, self.basis)
            size = float(own @ own)
            if size > OWN_PART**2 * float(column @ column):
                rest = rest - own * (float(own @ rest) / size)
        return float(rest @ rest)


def _slope(fit: Fit, suspect: Suspect) -> tuple[Array | None, Array]:
    """By how much the residual falls with the amount of a suspect, as (N, n), none where it is there or not; and the
    residual (N, n) with its first amount."""
    if suspect.step is None:
        return None, suspect.left(fit.values, 1.0)
    residual = suspect.left(fit.values, suspect.first)
    return (residual - suspect.left(fit.values, suspect.first + suspect.step)) / suspect.step, residual


def with_suspects(fit: Fit, misfits: Misfits, found: Sequence[Diagnostic]) -> list[Diagnostic]:
    """The diagnostics of a fit that is doubted, with those suspects that explain most of what it leaves in the place of
    those from before the fit; as they are where nothing explains most of it.

    Args:
        misfits: of the fit.
    """
    fit = fit.torque_alone
    values = ByValues(fit)
    clocks = [d.value / 1000 for d in found if d.code in (CLOCK_LATE, CLOCK_EARLY) and d.value is not None]
    best = likely(values, [*of_log(fit, clocks), *of_misfits(fit, misfits)])
    if not best:
        return list(found)
    left = [d for d in found if d.code not in OF_CASE or not _is_of(d, fit.model.estimation_labels)]
    told = said(best, values.left)
    if told:
        return left + told
    follows = min((d for d in left if d.code is DEPENDS_ON_MOTION), key=lambda d: d.value or 0.0, default=None)
    text = "" if follows is None else f"{follows.text} In the catalogue {best[0].suspect.name} explains it best."
    return [replace(d, text=text) if d is follows else d for d in left]


def _is_of(found: Diagnostic, labels: Sequence[str]) -> bool:
    """Whether it is about one of these experiments, or about the machine."""
    first = found.place.split(":")[0]
    return first in labels or first.startswith(("joint", "robot")) or not first


def likely(values: ByValues, suspects: Sequence[Suspect]) -> list[Tried]:
    """The suspects that explain most, the best first; none where no one explains most of what follows the motion."""
    fit, before = values.fit, values.left
    promising = sorted(suspects, key=values.left_with)[:TRIED]
    promising += [one for one in suspects if one.first and one not in promising]
    found = side_by_side([partial(tried, fit, one, before) for one in promising], fit.model.threads)
    return chosen([one for one in found if one is not None], partial(_still_follows, fit))


def chosen(found: Sequence[Tried], follows: Callable[[Tried], float]) -> list[Tried]:
    """Those that explain as much as the best one, the best first; none if that explains little.

    Args:
        follows: squares that still follow the motion beside one.
    """
    best = sorted((one for one in found if one.counts), key=lambda one: -one.explained)
    if not best or best[0].explained < MOSTLY * (best[0].explained + follows(best[0])):
        return []
    return [one for one in best if one.explained > AS_WELL * best[0].explained]


def said(best: Sequence[Tried], before: float) -> list[Diagnostic]:
    """What is said of those that explain most; nothing where the best one is no error of the case. ``before``: sum of
    squares without them."""
    told = [(one, one.suspect.told(one.amount, one.deviation)) for one in best][:NAMED]
    if told[0][1] is None:
        return []
    named, others = [(one, d) for one, d in told if d is not None], [one.suspect.name for one, d in told if d is None]
    found = []
    for one, diagnostic in named:
        share = 100 * np.sqrt(max(before - one.explained, 0.0) / before)
        text = f"{diagnostic.text} With that in the loop, the residual falls to {share:.0f} % of its size"
        as_well = [*(d.code.name for other, d in named if other is not one), *others]
        text += f"; {' and '.join(as_well)} would explain it as well." if as_well else "."
        found.append(replace(diagnostic, text=text, weight=one.explained))
    return found


def tried(fit: Fit, suspect: Suspect, before: float) -> Tried | None:
    """A suspect in the loop; None where it cannot be simulated. ``before``: sum of squares without it."""
    amounts = [] if suspect.step is None else [suspect.first]
    at = np.append(fit.values, amounts)
    try:
        columns, residual = _linear(fit, suspect)
        if suspect.is_linear:
            step = _step(fit, columns, residual)
            at, residual = at + step, residual - columns @ step
        for _ in range(0 if suspect.is_linear else ROUNDS):
            moved = _moved(fit, suspect, at, columns, residual)
            if moved is None:
                break
            gain = _squares(residual, fit) - _squares(moved[2], fit)
            at, columns, residual = moved
            if gain < SETTLED * _squares(residual, fit):
                break
    except FmuDidimError:
        return None
    left = _squares(residual, fit)
    if not amounts:
        return Tried(suspect, 1.0, 0.0, residual, columns, before - left)
    table = whitened(columns, fit.deviation)
    beside = rest_of(table[:, -1], orthonormal(independent(table[:, :-1])))
    deviation = float(np.sqrt(left / table.shape[0] / max(float(beside @ beside), TINY)))
    return Tried(suspect, float(at[-1]), deviation, residual, columns, before - left)


def _linear(fit: Fit, suspect: Suspect) -> tuple[Array, Array]:
    """Columns (N, n, p + 1) of the values and of a suspect, or of the values alone, and the residual (N, n)."""
    slope, residual = _slope(fit, suspect)
    if slope is None:
        return fit.jacobian, residual
    return np.concatenate([fit.jacobian, slope[:, :, None]], axis=2), residual


def _step(fit: Fit, columns: Array, residual: Array) -> Array:
    """The step of values and amount to the least sum of squares, to first order."""
    table = whitened(columns, fit.deviation)
    size = np.maximum(np.linalg.norm(table, axis=0), TINY)
    found: Array = np.linalg.lstsq(table / size, _flat(residual, fit), rcond=DEPENDENT)[0]
    return np.asarray(found / size)


def _moved(fit: Fit, suspect: Suspect, at: Array, columns: Array, residual: Array) -> tuple[Array, Array, Array] | None:
    """Values and amount after a step, or a part of it, that lowers the sum, with columns and residual there; None where
    none does. After it the values follow the amount once more: a scale acts with them."""
    p, step = fit.values.size, _step(fit, columns, residual)
    cost = _squares(residual, fit)
    for part in SHORTENED:
        other = at + part * step
        other[p:] = np.maximum(other[p:], suspect.least)
        if mass_matrix_problem(fit.model, other[:p]):
            continue
        try:
            left = suspect.left(other[:p], float(other[p:].sum()))
            table = _corrected(fit, columns, other - at, residual - left)
            again = other.copy()
            again[:p] += _step(fit, table[:, :, :p], left)
            if not mass_matrix_problem(fit.model, again[:p]):
                further = suspect.left(again[:p], float(again[p:].sum()))
                if _squares(further, fit) < _squares(left, fit):
                    table = _corrected(fit, table, again - other, left - further)
                    other, left = again, further
        except SimulationError:
            continue
        if _squares(left, fit) < cost:
            return other, table, left
    return None


def _corrected(fit: Fit, columns: Array, step: Array, change: Array) -> Array:
    """Columns with which a step changes the outputs as it did, by the least correction (Broyden, Mathematics of
    Computation 19 (1965))."""
    weighted = step * np.sum(whitened(columns, fit.deviation) ** 2, axis=0)
    size = float(weighted @ step)
    return columns if not size > 0 else np.asarray(columns + (change - columns @ step)[:, :, None] * (weighted / size))


def _flat(residual: Array, fit: Fit) -> Array:
    return np.asarray((residual / fit.deviation).reshape(-1))


def _squares(residual: Array, fit: Fit) -> float:
    return sum_of_squares(residual, fit.deviation)


def _still_follows(fit: Fit, one: Tried) -> float:
    """Squares of the residual beside a suspect that follow the motion beyond chance."""
    beside = replace(fit, outputs=fit.model.measured_outputs - one.residual, jacobian=one.columns)
    joints = residuals_of_fit(beside, tested_rows(fit))
    squares = np.sum((one.residual / fit.deviation) ** 2, axis=0)
    follows = [one.dependence() for one in joints]
    level = MOTION_CHANCE / max(len(follows), 1)
    return float(sum(squares[d.joint - 1] * d.share for d in follows if d.p_value < level))


# ---- what is suspected


def of_log(fit: Fit, clocks: Sequence[float] = ()) -> Iterator[Suspect]:
    """Clock, sampling and scale of the log, and a delay of the command; nothing that is free in the fit.

    Args:
        clocks: s by which the log seemed to be late before the fit.
    """
    model, owners = fit.model, {k.owner for k in fit.model.free_parameters}
    step = model.simulation(fit.values).step_size
    if LOG not in owners:
        yield Suspect("clock", partial(_stamped_later, fit), _clock, STEP * step, next(iter(clocks), 0.0))
    if DELAY not in owners and not model.loop.is_virtual:
        name = model.loop.plant_name
        there = min(float(system.delays.get(name, 0.0)) for system in model.loop.systems.values())
        yield Suspect("delay", partial(_delayed, fit, there), partial(_delay, 1000 * step), 0.5, least=-there)
    yield from _ways(fit)
    n = model.joint_count
    for joint in (0, *(range(1, n + 1) if n > 1 else ())):
        scaled = np.ones(n) if joint == 0 else np.arange(1, n + 1) == joint
        told = partial(_scale, joint, model.loop.is_virtual)
        yield Suspect(f"scale {joint}", partial(_scaled, fit, scaled), told, STEP)


def of_misfits(fit: Fit, misfits: Misfits) -> Iterator[Suspect]:
    """What misfits change to first order: gravity, lengths of links, zeros of joints, and effects of the catalogue."""
    for misfit in misfits:
        load = misfit.load
        if not load.is_of_log and not load.stated.is_scale:  # which are suspected as clocks and scales of the log
            code = GRAVITY if load.stated.joints == "base" else OF_DESCRIPTION.get(load.effect)
            told = _nothing if code is None else partial(_of_description, misfit, code)
            yield Suspect(misfit.what, partial(_beside, fit, misfit), told, 1.0, is_linear=True)


def _stamped_later(fit: Fit, values: Array, late_s: float) -> Array:
    model = fit.model
    for label in model.estimation_labels:
        own, step = model.experiments[label], model.simulation(values, label).step_size
        operator = own.operator.stamped_later(late_s / step, own.reference.time.size, between=True)
        model = model.with_experiment(label, replace(own, operator=operator))
    return model.measured - model.torque(values)


def _delayed(fit: Fit, before: float, values: Array, samples: float) -> Array:
    return fit.model.measured - fit.model.with_delay(before + samples).torque(values)


def _ways(fit: Fit) -> Iterator[Suspect]:
    """Other ways of sampling; none where an instant lies at the end of the data."""
    model = fit.model
    runs = {label: model.simulation(fit.values, label) for label in model.estimation_labels}
    period_ms = 1000 / model.experiments[model.first].rate_hz
    for kind, window, operators in other_ways(runs):
        shows, entry = way_text(kind, window, period_ms)
        told = Diagnostic(
            SAMPLING_KIND, f"The log seems to show {shows}.", model.first,
            next_step=f"Find out how the logger samples; if so: torque: {{{entry}}}.",
        )  # fmt: skip
        yield Suspect(shows, partial(_sampled, fit, operators), partial(_told, told), None)


def _sampled(fit: Fit, operators: Mapping[str, SampleOperator], values: Array, _: float) -> Array:
    model = fit.model
    for label, operator in operators.items():
        model = model.with_experiment(label, replace(model.experiments[label], operator=operator))
    return model.measured - model.torque(values)


def _scaled(fit: Fit, scaled: Array, values: Array, amount: float) -> Array:
    return fit.model.measured - (1 + amount * scaled) * fit.model.torque(values)


def _beside(fit: Fit, misfit: Misfit, values: Array, amount: float) -> Array:
    return fit.model.measured - fit.model.torque(values) - amount * misfit.signature.astype(float)


# ---- what is said of it


def _told(found: Diagnostic, *_: float) -> Diagnostic:
    return found


def _nothing(*_: float) -> None:
    return None


def _clock(late_s: float, deviation: float) -> Diagnostic:
    late, code = 1000 * late_s, CLOCK_LATE if late_s > 0 else CLOCK_EARLY
    text = f"The log seems to be stamped {abs(late):.3g} ± {1000 * deviation:.1g} ms {'late' if late > 0 else 'early'}."
    return Diagnostic(code, text, "", late, np.copysign(1000 * SURE * deviation, late), "ms")


def _delay(period_ms: float, samples: float, deviation: float) -> Diagnostic:
    text = (
        f"The command seems to act {samples:.2g} ± {deviation:.1g} control periods ({samples * period_ms:.3g} ms) "
        "later than in the model."
    )
    return Diagnostic(COMMAND_DELAY, text, "", samples, SURE * deviation, "control periods")


def _scale(joint: int, is_virtual: bool, amount: float, deviation: float) -> Diagnostic:
    seems = f"{1 + amount:.3g} ± {deviation:.1g} times"
    if joint or is_virtual:
        text = f"{'The torque seems' if joint else 'All torques seem'} to be {seems} what it should be."
        place, bound = f"joint {joint}" if joint else "", 1 + float(np.copysign(SURE * deviation, amount))
        return Diagnostic(TORQUE_SCALE, text, place, 1 + amount, bound, "1")
    text = (
        f"All torques seem to be {seems} what they should be, or the gains of the controller {seems} those of the case."
    )
    advice = "Check unit, gear ratio and torque constant of the log, and the gains of the controller."
    bound = 1 + float(np.copysign(SURE * deviation, amount))
    return Diagnostic(TORQUE_SCALE, text, "", 1 + amount, bound, "1", advice)


def _of_description(misfit: Misfit, code: Code, amount: float, deviation: float) -> Diagnostic:
    stated = misfit.load.stated
    text = f"The robot seems to have {misfit.what}, by {amount:.3g} ± {deviation:.1g} {stated.unit}."
    place = f"joint {misfit.load.joint}" if code in (LINK_LENGTH, POSITION_ZERO) else "robot"
    return Diagnostic(code, text, place, amount, float(np.copysign(SURE * deviation, amount)), stated.unit)
