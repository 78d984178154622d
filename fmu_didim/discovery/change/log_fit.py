"""What one log shows: its fit, what each effect promises to explain of it, and the fit of an effect in its closed loop.

The slope of a gear that is stiff says little of a soft one, and that of play in it little of its rattling: gears start
from several softnesses and sizes, of which the loop itself says which are nearest to the log.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fmu_didim.base.errors import SimulationError
from fmu_didim.data.signals import Array
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.augmentation.places import Proposal
from fmu_didim.discovery.beginning import after_start
from fmu_didim.discovery.change.difference import CHANGED, chance_of_sizes
from fmu_didim.discovery.progress import Progress
from fmu_didim.discovery.screening.catalogue import SignatureCatalogue
from fmu_didim.discovery.selection.competition import FURTHER, SIZES, Competition, fitted_proposal
from fmu_didim.discovery.selection.plausible import implausible
from fmu_didim.discovery.selection.wide_search import searched_widely, wide_search_notes
from fmu_didim.dynamics.effects import Effect
from fmu_didim.dynamics.prior import Prior
from fmu_didim.dynamics.robot import RobotDescription
from fmu_didim.estimators.initial_states import with_forgotten_held
from fmu_didim.fit.fit import Fit, prior_squares
from fmu_didim.fit.fit_uncertainty import fit_uncertainty
from fmu_didim.fit.gap import bic_gain
from fmu_didim.fit.log_noise import residual_noise
from fmu_didim.fit.noise.noise import Noise, effective_fraction
from fmu_didim.fit.solver.accuracy import with_fitting_substeps
from fmu_didim.fit.solver.least_squares import minimise
from fmu_didim.fit.solver.termination import Stopping
from fmu_didim.model.loop_model import EffectAtJoint, LoopModel

SOFTER = (1.0, 0.3, 0.1, 0.03, 0.01, 0.003)
"""[1] Of the stiffness that the slope of a stiff gear promises, or of the largest that is searched for where that is
less, tried as starts of the fit."""
GEAR_STARTS = 4
"""[starts] From which a gear is fitted: of eight near the log, on a gear with play, two end in a minimum of four times
the misfit."""
SAME_GAIN = 6
"""[digits] Of two promises that are one."""
LEFT_OVER = 1e-6
"""[1] Of a signature, below which the values absorb it whole."""
UPDATES = 3
"""[sensitivities] Taken anew in the fit of an effect: the first ones are those of values that may be far off."""
SETTLED = 12
"""[sensitivities] At most, taken anew in the fit of the best effect: play in a gear needs six to ten."""
SEED = 0
"""[1] Of a search in a whole range: both logs, and each comparison, are searched alike."""
RELATIVE_RANK = 1e-12
"""[1] Smallest eigenvalue of a correlation over the largest, below which it is rounding."""
BASE_FIT = Stopping(exact=True)
DECIDE = ("UPDATES", "SETTLED", "SOFTER", "GEAR_STARTS")
"""Those of these numbers on which an answer depends."""


@dataclass(frozen=True)
class LogFit:
    """A log with the model that was identified from it, fitted.

    Attributes:
        fit: of the torque; builder: of the model with effects.
    """

    fit: Fit
    builder: LoopModelBuilder

    @staticmethod
    def of(model: LoopModel, description: RobotDescription | None, effects: Mapping[str, Effect]) -> LogFit:
        """From a model with the identified values as its start; the start of the log, where the state of the machine is
        not known, is left out: a gear whose play is taken up then leaves what looks like a second effect. So are values
        of a start that was identified, as far as the rest of the log does not show them."""
        model = after_start(model.torque_alone)
        spread = np.maximum(np.std(model.measured, axis=0), np.finfo(float).tiny)
        fit = minimise(model, Noise(spread, np.zeros(spread.size), "residual"), stopping=BASE_FIT)
        kept = with_forgotten_held(model, fit)
        values = fit.values[[model.names.index(name) for name in kept.names]]
        outputs = fit.outputs if kept is model else None
        fit = minimise(kept.with_values(values), residual_noise(fit), stopping=BASE_FIT, outputs=outputs)
        return LogFit(fit, LoopModelBuilder(fit.model, description, effects))

    @cached_property
    def competition(self) -> Competition:
        """With one more effect."""
        return Competition(self.builder, self.fit)

    def candidates(self) -> list[EffectAtJoint]:
        """Effects that the model lacks."""
        names = [name for name, effect in self.builder.effects.items() if effect.is_proposed]
        found = (EffectAtJoint(name, j) for name in names for j in self.builder.joints(name))
        added = self.fit.model.added_effects
        free = (a for a in found if not self.builder.at(a).is_present and a not in added)
        return [a for a in free if self.builder.has_place(a, added)]


@dataclass(frozen=True)
class Known:
    """What is known of the values of one log: names, (p,) values and (p, p) covariance of those that are compared."""

    names: tuple[str, ...]
    value: Array
    covariance: Array


@dataclass(frozen=True)
class Promise:
    """What an effect would explain of a log to first order.

    Attributes:
        effect_at: which; gain: chi-square less what its values cost; starts: of its fit, the best first.
    """

    effect_at: EffectAtJoint
    gain: float
    starts: tuple[Proposal, ...]


def fitted(side: LogFit, starts: Sequence[Proposal], *, if_nearer: bool = False) -> Fit | None:
    """A log with an effect, the best fit from these starts; None where it cannot be simulated, is no machine's, or does
    nothing to this log.

    Args:
        if_nearer: whether a gear is fitted only where the loop comes nearer to the log from one of these starts.
    """
    effect_at = starts[0].effect_at
    is_gear = side.builder.effect(effect_at).elastic
    tried = _in_the_loop(side, starts, least=0 if if_nearer else 1) if is_gear else starts[:1]
    fits = [_refitted(side, start) for start in tried]
    found = min((fit for fit in fits if fit is not None), key=lambda fit: fit.chi_square, default=None)
    if found is None or found.given_up or not np.abs(found.jacobian).max(axis=(0, 1)).all():
        return None
    return None if side.competition.assess(effect_at, found).implausible else found


def at_best_minimum(side: LogFit, found: Fit | None, effect_at: EffectAtJoint, progress: Progress) -> Fit | None:
    """A log with an effect of many minima, from the best values in the whole range of its parameters, where the loop
    comes nearer to the log with these than in the fit that is there; else that."""
    if not side.builder.effect(effect_at).has_minima:
        return found
    wide = searched_widely(side.competition, effect_at, seed=SEED, progress=progress, begin=found)
    if wide is None or wide.implausible or (found is not None and wide.fit.chi_square >= found.chi_square):
        return found
    return wide.fit


def louder(sides: tuple[LogFit, LogFit]) -> tuple[set[int], set[int]]:
    """Joints whose residual is larger in each log than in the other one, beyond what noise does."""
    sizes = [np.sqrt(np.mean(side.fit.residual**2, axis=0)) for side in sides]
    freedom = [
        np.maximum(len(r := side.fit.residual) * effective_fraction(r) - side.fit.values.size / r.shape[1], 1.0)
        for side in sides
    ]  # fmt: skip
    found: tuple[set[int], set[int]] = (set(), set())
    for j, (first, second) in enumerate(zip(*sizes, strict=True)):
        if chance_of_sizes(first, second, (freedom[0][j], freedom[1][j])) < CHANGED / sizes[0].size:
            found[int(second > first)].add(j + 1)
    return found


def not_widely_searched(sides: tuple[LogFit, LogFit], named: Collection[str]) -> list[str]:
    """Notes on effects of many minima that were not looked for in their whole range, as that takes too long, on joints
    whose residual is larger in one of two logs; without those of ``named`` kinds."""
    notes: dict[str, None] = {}
    for side, joints in zip(sides, louder(sides), strict=True):
        asked = [
            a for a in side.candidates()
            if a.joint in joints and a.effect not in named and side.builder.effect(a).has_minima
        ]  # fmt: skip
        notes |= dict.fromkeys(wide_search_notes(side.builder, side.fit, asked))
    return list(notes)


def _refitted(side: LogFit, start: Proposal) -> Fit | None:
    """A log with an effect, from one start; None where the loop fails on the way, which other starts need not."""
    try:
        return side.competition.refit(start, updates=UPDATES)
    except SimulationError:
        return None


def _in_the_loop(side: LogFit, starts: Sequence[Proposal], *, least: int) -> list[Proposal]:
    """Starts of a gear: of each shape the softness, or the play, with which the loop is nearest to the log, as far as
    it is nearer than without the gear; ``least`` in any case. The loop alone does not say which shape is best: play
    that rattles has many minima."""
    competition, own = side.competition, max(GEAR_STARTS // len(starts), 1)
    tried = [
        sorted(((competition.misfit(size), place, size) for place, size in enumerate(_sizes(side, start))))[:own]
        for start in starts
    ]  # fmt: skip
    ordered = sorted((cost, i, k, size) for i, every in enumerate(tried) for k, (cost, _, size) in enumerate(every))
    whole = competition.misfit()
    return [size for place, (cost, _, _, size) in enumerate(ordered) if cost < whole or place < least]


def _sizes(side: LogFit, start: Proposal) -> list[Proposal]:
    """A start of a gear, softer or with more and less play."""
    neutral, placed = side.builder.effect(start.effect_at).neutral, side.builder.at(start.effect_at)
    own = [v.name for v in placed.amplitudes if v.name in start.values]
    stiff = {name for name in own if np.isinf(neutral.get(name, 0.0))}
    largest = {name: placed.search[name].highest for name in stiff if name in placed.search}
    values = {name: min(start.values[name], largest.get(name, np.inf)) for name in own}
    sizes = SOFTER if stiff else SIZES
    return [
        start,
        *(replace(start, values={**start.values, **{n: part * v for n, v in values.items()}}) for part in sizes),
    ]


def promised(
    side: LogFit, other: Known, covered: frozenset[tuple[str, int]], progress: Progress
) -> tuple[list[Promise], list[Promise]]:
    """What each effect lowers the misfit of a log to first order, the best first: with the values of the other log as
    they are known, and with all values free, as where they have changed, too."""
    fit = side.fit
    places = [fit.model.names.index(name) for name in other.names]
    root = np.zeros((len(places), len(fit.model.names)))
    root[:, places] = _root(other.covariance)
    weight = 1 / fit.deviation[:, None]
    table = (fit.jacobian * weight).reshape(-1, fit.values.size)
    residual = (fit.residual / fit.deviation).ravel()
    free = _Rows.of(table, residual)
    tied = _Rows.of(
        np.vstack([table, root]), np.append(residual, root[:, places] @ (other.value - fit.values[places]))
    )  # fmt: skip
    found: tuple[dict[EffectAtJoint, list[tuple[float, Proposal]]], ...] = ({}, {})
    candidates = [a for a in side.candidates() if (a.effect, a.joint) not in covered]
    for signature in SignatureCatalogue(side.builder, fit, candidates=candidates, progress=progress):
        rows = (signature.columns * weight).reshape(-1, signature.columns.shape[2])
        cost = side.builder.at(signature.effect_at).cost * float(np.log(residual.size))
        for own, kind in zip(found, (tied, free), strict=True):
            if (promise := kind.gain(rows)) is not None:
                shapes = own.setdefault(signature.effect_at, [])
                shapes.append((promise[0] - cost, signature.proposal(promise[1])))
    first, second = (
        sorted((_promise(a, shapes) for a, shapes in own.items()), key=lambda each: -each.gain) for own in found
    )
    return first, second


def _promise(effect_at: EffectAtJoint, shapes: Sequence[tuple[float, Proposal]]) -> Promise:
    """Of an effect at its best shapes; some may be one, as shares of a motor whose inertia is known."""
    ordered = sorted(shapes, key=lambda each: -each[0])
    distinct = {round(gain, SAME_GAIN): proposal for gain, proposal in reversed(ordered)}
    return Promise(effect_at, ordered[0][0], tuple(reversed(distinct.values()))[: 1 + FURTHER])


@dataclass(frozen=True)
class _Rows:
    """What is left of the rows of a linear problem beside the values of the model: an orthonormal basis (N, p) of what
    these can do, and the rest (N,) of the right side."""

    basis: Array
    rest: Array

    @staticmethod
    def of(table: Array, right: Array) -> _Rows:
        basis, _ = np.linalg.qr(table / np.maximum(np.linalg.norm(table, axis=0), np.finfo(float).tiny))
        return _Rows(basis, right - basis @ (basis.T @ right))

    def gain(self, rows: Array) -> tuple[float, Array] | None:
        """By how much columns (M, k), the first M of the rows, lower the sum of squares, and with which amounts; None
        where the values absorb one of them."""
        columns = np.vstack([rows, np.zeros((self.rest.size - len(rows), rows.shape[1]))])
        left = columns - self.basis @ (self.basis.T @ columns)
        if not (np.linalg.norm(left, axis=0) > LEFT_OVER * np.linalg.norm(columns, axis=0)).all():
            return None
        amounts = np.linalg.lstsq(left, self.rest, rcond=None)[0]
        return float(np.sum((left @ amounts) ** 2)), np.asarray(amounts)


def gain(side: LogFit, found: Fit, through: Fit | None = None) -> float:
    """By how much a log is explained better, as a chi-square, less what the values of effects are off from those of
    another log with which they are one.

    Args:
        through: of a part of the effects. What the others explain more counts by the colour of what both leave: else
            all that the first ones explain would count anew, because what is left is less coloured.
    """
    if through is not None:
        return gain(side, through) + gain(LogFit(through, side.builder), found)
    off = prior_squares(found.model.prior, found.values) - prior_squares(side.fit.model.prior, side.fit.values)
    return bic_gain(side.fit, found, 0.0, side.fit.noise) - off


def in_common(side: LogFit, other: Fit, effect_at: EffectAtJoint) -> Fit | None:
    """A log with an effect of the values that another log knows it by, as far as that knows them; None where it cannot
    be simulated with it.

    To first order both logs with one effect e have the misfit  chi_1^2 + chi_2^2(e) + |W (e - e_1)|^2,  W'W = C_1^-1,
    with the values e_1 of that log and their covariance C_1: whether it is absent here is a question to this log, not
    to what a free fit makes of an effect that it hardly shows.
    """
    index = other.model.added_effects.index(effect_at)
    names = [p.name for p in other.model.free_parameters if p.effect == index]
    there = known(other, names)
    model = side.builder.build(side.fit.model, [fitted_proposal(other, effect_at)])
    model = replace(model.with_values(np.clip(model.start, *model.free_parameters.limits)), workers=1)
    if not set(names) <= set(model.names):
        return None
    model = replace(model, prior=_with_known(model.prior, there, model.names))
    if model.loop.own_states > side.fit.model.loop.own_states:
        model = with_fitting_substeps(model, model.start, side.fit.noise.deviation)
    try:
        return minimise(model, side.fit.noise, stopping=Stopping(updates=UPDATES, check_all=False))
    except SimulationError:
        return None


def _with_known(prior: Prior | None, there: Known, names: Sequence[str]) -> Prior:
    """Rows of values that are known from another log, below those that are there already."""
    places = [names.index(name) for name in there.names]
    rows = np.zeros((len(places), len(names)))
    rows[:, places] = _root(there.covariance)
    target, mean, spread = rows[:, places] @ there.value, np.zeros(len(names)), np.full(len(names), np.inf)
    mean[places], spread[places] = there.value, np.sqrt(np.diag(there.covariance))
    if prior is not None:
        rows, target = np.vstack([prior.padded(len(names)), rows]), np.append(prior.target, target)
        mean[: prior.mean.size] += prior.mean
        spread[: prior.deviation.size] = np.minimum(spread[: prior.deviation.size], prior.deviation)
    return Prior(rows, target, mean, spread, "another log", {})


def _root(covariance: Array) -> Array:
    """(p, p) W with W' W = C^-1."""
    deviation = np.maximum(np.sqrt(np.diag(covariance)), np.finfo(float).tiny)
    sizes, vectors = np.linalg.eigh(covariance / np.outer(deviation, deviation))
    return np.asarray((vectors / np.sqrt(np.maximum(sizes, RELATIVE_RANK * sizes[-1]))).T / deviation)


def shared(fit: Fit) -> frozenset[str]:
    """Names of the values of effects that are one with those of another log."""
    prior = fit.model.prior
    if prior is None:
        return frozenset()
    return frozenset(name for name, own in zip(fit.model.names, np.isfinite(prior.deviation), strict=False) if own)


def absent(side: LogFit, found: Fit, effects: Sequence[EffectAtJoint]) -> EffectAtJoint | None:
    """The first of these effects whose values in a fit say that it may be absent, or is no machine's; None of none."""
    for effect_at in effects:
        index, builder = found.model.added_effects.index(effect_at), side.builder
        if implausible(found, index, builder.effect(effect_at), builder.link_values(effect_at.joint)):
            return effect_at
    return None


def settled(fit: Fit | None) -> Fit | None:
    """A fit that has come to its end; as it is, where the loop fails on the way there."""
    if fit is None:
        return None
    stopping = Stopping(updates=SETTLED, check_all=False)
    try:
        return minimise(fit.model, fit.noise, stopping=stopping, jacobian=fit.jacobian, outputs=fit.outputs)
    except SimulationError:
        return fit


def known(fit: Fit, names: Sequence[str]) -> Known:
    places = [fit.model.names.index(name) for name in names]
    return Known(tuple(names), fit.values[places], fit_uncertainty(fit).covariance[np.ix_(places, places)])
