"""An elastic gear and what acts in it: looked for together where neither shows alone, told from other gears together.

The error of a gear drives its link near the resonance. Where it is larger than what the elasticity does without it, a
fit of the elasticity alone has nothing to hold on to, and without elasticity the error has no place. So stiffnesses are
tried, and beside each of them the error with all its periods, to first order.

A gear that hardens is soft where its load is small, as one with play is: beside nothing else play explains more than an
elastic gear, which may have one stiffness only. So gears are compared with what acts in them: each other gear with all
that acts in one that is named, and an elastic gear that hardens with play alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from fmu_didim.base.errors import SimulationError
from fmu_didim.data.signals import Array
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.augmentation.places import Proposal
from fmu_didim.discovery.progress import Progress
from fmu_didim.discovery.screening.catalogue import RESOLVED, Signature, SignatureCatalogue
from fmu_didim.discovery.selection.candidates import FittedCandidate
from fmu_didim.discovery.selection.competition import Competition, fitted_proposal
from fmu_didim.discovery.selection.decide import Options, Step, nearness, objection, step_of
from fmu_didim.discovery.selection.held_out import held_out_objection
from fmu_didim.discovery.selection.parts import Part
from fmu_didim.fit.derivatives.torque_signature import search_grid
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.gap import bic_gain, joint_gaps
from fmu_didim.fit.solver.accuracy import with_fitting_substeps
from fmu_didim.fit.solver.least_squares import minimise
from fmu_didim.fit.solver.termination import Stopping
from fmu_didim.model.loop_model import EffectAtJoint

STIFFNESSES = 7
"""[1] Tried on the grid of a stiffness, without its ends: resonances a factor of 1.5 apart on three decades."""
EVERY = 2
"""[shapes] Of the grid of what acts in the gear one in so many is tried beside each stiffness; beside the best one all
that lie between."""
FAR = 3.0
"""[1] Times the sum of squares without a gear beyond which that of a gear alone says that it is far too soft: an error
of its teeth, which repeats along the joint, does not make up for it."""
STARTS = 2
"""[starts] Of a gear with what acts in it, from which all are fitted."""
SOFTER = (1.0, 0.5, 0.25)
"""[1] Of the stiffness of a gear, those from which one that hardens is fitted: without load it is softer than with."""
IN_IT = "{0}: it shows only beside {1}, which acts in it."
"""Remark on a gear."""


@dataclass(frozen=True)
class _Start:
    """A gear and what acts in it, to first order.

    Attributes:
        left: weighted sum of squares that they leave; gear, error: proposals.
    """

    left: float
    gear: Proposal
    error: Proposal


def gear_with_error(
    competition: Competition,
    ranking: Sequence[FittedCandidate],
    base: Fit,
    options: Options,
    progress: Progress,
) -> tuple[Fit, list[Step]] | None:
    """The model with an elastic gear and what acts in it, and their steps; None if there is none that the data
    support, both of them and each.

    Args:
        ranking: of the round, where none was accepted: what one effect alone explains as well needs no two.
    """
    for gear, error in _places(competition, options):
        if progress.is_time_up:
            return None
        starts = sorted(_starts(competition, gear, error, progress), key=lambda s: s.left)[:STARTS]
        whole = _fitted(competition, [(s.gear, s.error) for s in starts], until=progress.ends)
        found = None if whole is None else _judged(competition, ranking, whole, (gear, error), base, options)
        if found is not None:
            progress.say(f"added together: {gear.effect} and {error.effect} on joint {gear.joint}")
            return found
    return None


def _places(competition: Competition, options: Options) -> Iterator[tuple[EffectAtJoint, EffectAtJoint]]:
    """Gears that may be there, of the simplest kind, with what acts in them, on joints with a gap, the largest
    first."""
    builder, fit = competition.builder, competition.fit
    allowed = {n: e for n, e in builder.effects.items() if n not in options.forbid and e.is_proposed}
    inside = [name for name, effect in allowed.items() if effect.needs_elastic and effect.frequency]
    gaps = joint_gaps(fit.torque_alone.residual, fit.torque_alone.noise)
    for j in (np.argsort(-gaps) + 1).tolist():
        gears = _gears_on(builder, j, options)
        if gears and gaps[j - 1] > options.smallest_size:
            free = (EffectAtJoint(n, j) for n in inside)
            yield from ((gears[0], a) for a in free if not builder.has_place(a, fit.model.added_effects))


def _starts(competition: Competition, gear: EffectAtJoint, error: EffectAtJoint, progress: Progress) -> list[_Start]:
    """Stiffnesses with the errors beside each of them; nothing where the time is up before all are tried."""
    builder, base = competition.builder, competition.base
    places = builder.at(error)
    (name,) = (v.name for v in places.shapes)
    search = places.search[name]
    grid = np.linspace(search.lowest, search.highest, search.count)
    coarse = np.union1d(grid[::EVERY], search.known)

    def beside(there: Fit, proposal: Proposal, numbers: Array) -> list[_Start]:
        residual = base.rest_of(base.weighted(there.residual))
        signatures = SignatureCatalogue(builder, there, candidates=[]).of_shapes(error, [{name: n} for n in numbers])
        rests = base.rests_of(signature.columns for signature in signatures)
        return [_start(proposal, s, rest, residual) for s, (_, rest) in zip(signatures, rests, strict=True)]

    def left(fit: Fit) -> float:
        return float(np.sum(base.rest_of(base.weighted(fit.residual)) ** 2))

    what, most = f"{gear.effect} with {error.effect} on joint {gear.joint}", FAR * left(competition.fit)
    progress.say(what)
    gears = [(there, proposal) for there, proposal in _gears(competition, gear) if left(there) <= most]
    report, found = progress.counted(f"{what}: stiffness", len(gears)), list[list[_Start]]()
    for there, proposal in gears:
        if progress.is_time_up:
            return []
        found.append(beside(there, proposal, coarse))
        report("")
    if not any(found):
        return []
    place = min((i for i in range(len(found)) if found[i]), key=lambda i: min(s.left for s in found[i]))
    best = min(found[place], key=lambda s: s.left).error.values[name]
    near = np.abs(grid - best) <= EVERY * (grid[1] - grid[0])
    return [*chain(*found), *beside(*gears[place], np.setdiff1d(grid[near], coarse))]


def _start(gear: Proposal, signature: Signature, rest: Array, residual: Array) -> _Start:
    coefficients = np.asarray(np.linalg.lstsq(rest, residual, rcond=None)[0], dtype=float)
    left = float(np.sum((residual - rest @ coefficients) ** 2))
    return _Start(left, gear, signature.proposal(coefficients))


def _gears(competition: Competition, gear: EffectAtJoint) -> Iterator[tuple[Fit, Proposal]]:
    """The present model with stiffnesses from the grid, all else as it is, where it can be simulated with the other
    shapes in the middle of theirs or at their ends."""
    builder, fit = competition.builder, competition.fit
    placed = builder.at(gear)
    stiffness = _stiffness(builder, gear)
    search = placed.search[stiffness]
    for value in np.geomspace(search.lowest, search.highest, STIFFNESSES + 2)[1:-1]:
        for part in (0.5, 1.0, 0.0) if placed.shapes else (0.5,):
            grids = {v.name: placed.search[v.name] for v in placed.shapes}
            shapes = {name: float(g.lowest + part * (g.highest - g.lowest)) for name, g in grids.items()}
            proposal = Proposal(gear, {**shapes, stiffness: float(value)})
            model = builder.build(fit.model, [proposal])
            model = with_fitting_substeps(model, model.start, fit.noise.deviation, times_fewest=RESOLVED)
            try:
                outputs = model.outputs(model.start)
            except SimulationError:
                continue
            yield replace(fit, model=model, values=model.start, outputs=outputs), proposal
            break


def _fitted(competition: Competition, starts: Sequence[Sequence[Proposal]], *, until: float = np.inf) -> Fit | None:
    """The model with a gear and what acts in it, fitted from the best of these starts; None where none can be
    simulated, or comes below the model without them before the clock reads ``until``."""
    fit, found = competition.fit, None
    for proposals in starts:
        model = competition.builder.build(fit.model, proposals)
        low, high = model.free_parameters.limits
        model = model.with_values(np.clip(model.start, low, high))
        model = with_fitting_substeps(model, model.start, fit.noise.deviation)
        try:
            # Stiffness and inertia of the motor lie along a valley: a short fit ends ten deviations beside its bottom.
            stopping = Stopping(exact=True, give_up_above=fit.chi_square, until=until)
            fitted = minimise(model, fit.noise, stopping=stopping)
        except SimulationError:
            continue
        if not fitted.given_up and (found is None or fitted.chi_square < found.chi_square):
            found = fitted
    return found


def _judged(
    competition: Competition,
    ranking: Sequence[FittedCandidate],
    whole: Fit,
    both: tuple[EffectAtJoint, EffectAtJoint],
    base: Fit,
    options: Options,
) -> tuple[Fit, list[Step]] | None:
    """The fit and its steps, if the data support the two together and the second beside the first, better than any
    other effect alone."""
    builder, fit, (gear, error) = competition.builder, competition.fit, both
    gain = bic_gain(fit, whole, sum(builder.cost_in(whole, a) for a in both), fit.noise)
    candidate = replace(competition.assess(gear, whole), delta_bic=gain)
    best = max((c.delta_bic for c in ranking), default=0.0)
    if gain < best + options.threshold or objection(candidate, fit, options, base=base):
        return None
    smaller = builder.without(whole.model, whole.model.added_effects.index(error))
    try:
        beside = Competition(builder, minimise(smaller, fit.noise, stopping=Stopping(updates=1)))
    except SimulationError:
        return None
    second = beside.assess(error, whole)
    if objection(second, beside.fit, options, base=base):
        return None
    names = [f"{builder.effect(a).title} on joint {a.joint}" for a in both]
    first = replace(step_of(candidate, (candidate,), competition, options), remark=IN_IT.format(*names))
    return whole, [first, step_of(second, (second,), beside, options)]


def other_gears(
    beside: Competition, fit: Fit, gear: EffectAtJoint, options: Options, progress: Progress
) -> list[FittedCandidate]:
    """Each other gear in the place of one, with all that acts in that, fitted from where that is.

    Args:
        beside: the model without the gear and what acts in it; fit: with them.
    """
    builder, known = beside.builder, fitted_proposal(fit, gear).values
    others = set(beside.fit.model.added_effects)
    inside, found = _inside(beside, fit, gear), []
    for rival in _gears_on(builder, gear.joint, options):
        if rival == gear or rival in others or progress.is_time_up:
            continue
        searched = builder.at(rival).search
        kept = {name: value for name, value in known.items() if name in searched}
        left = search_grid({name: grid for name, grid in searched.items() if name not in known}, kept)
        whole = _fitted_from_best(beside, [(Proposal(rival, values), *inside) for values in left], progress)
        if whole is not None:
            found.append(beside.assess(rival, whole))
    return found


def hardened(
    beside: Competition, fit: Fit, gear: EffectAtJoint, options: Options, progress: Progress
) -> FittedCandidate | None:
    """A gear with what may act in it, too, and has no period, fitted together from softer gears and from the whole
    range of that; None where nothing can be fitted.

    A fit of one stiffness may end far from that without load, where to first order hardening promises nothing.

    Args:
        beside: the model without the gear and what acts in it; fit: with them.
    """
    builder, values, found = beside.builder, fitted_proposal(fit, gear).values, None
    stiffness, present = _stiffness(builder, gear), _inside(beside, fit, gear)
    for name, effect in builder.effects.items():
        inside = EffectAtJoint(name, gear.joint)
        is_asked = effect.needs_elastic and not effect.frequency and name not in options.forbid
        if not is_asked or inside in fit.model.added_effects or builder.at(inside).is_present:
            continue
        starts = [
            (Proposal(gear, {**values, stiffness: part * values[stiffness]}), *present, Proposal(inside, own))
            for part in SOFTER for own in search_grid(builder.at(inside).search, {})
        ]  # fmt: skip
        whole = _fitted_from_best(beside, starts, progress)
        if whole is not None and (found is None or whole.chi_square < found.fit.chi_square):
            found = Competition(builder, fit).assess(inside, whole)
    return found


def harder(
    competition: Competition, gear: EffectAtJoint, rival: EffectAtJoint, options: Options, progress: Progress
) -> FittedCandidate | None:
    """What acts in a gear of the model and may be confounded with another gear in its place, the best that can be
    fitted beside all else; None without any."""
    builder = competition.builder
    places = [
        EffectAtJoint(name, gear.joint) for name, effect in builder.effects.items()
        if effect.needs_elastic and rival.effect in effect.confounded_with and name not in options.forbid
    ]  # fmt: skip
    places = [a for a in places if a not in competition.fit.model.added_effects and not builder.at(a).is_present]
    if not places or progress.is_time_up:
        return None
    signatures = SignatureCatalogue(builder, competition.fit, candidates=places, progress=progress)
    ranking = competition.compare(competition.screen(signatures), progress=progress, reach=np.inf).ranking
    return competition.finished(ranking[0]) if ranking else None


def hardening_instead(
    beside: Competition, named: FittedCandidate, base: Fit, options: Options, progress: Progress
) -> tuple[Part, ...]:
    """A simpler gear and what acts in it, in the place of a gear, as an elastic one that hardens in the place of play;
    none where they do not explain more than it.

    Args:
        beside: all other effects of the model; named: the gear, fitted beside them.
    """
    builder, values = beside.builder, fitted_proposal(named.fit, named.effect_at).values
    if named.effect_at.effect in options.prefer:
        return ()
    for gear in _gears_on(builder, named.effect_at.joint, options):
        if builder.at(gear).cost >= named.cost or gear in beside.fit.model.added_effects or progress.is_time_up:
            continue
        kept, stiffness = {n: v for n, v in values.items() if n in builder.at(gear).search}, _stiffness(builder, gear)
        sizes = (part * kept[stiffness] for part in SOFTER[:STARTS])
        alone = _fitted(beside, [(Proposal(gear, {**kept, stiffness: k}),) for k in sizes], until=progress.ends)
        if alone is None:
            continue
        first, within = beside.assess(gear, alone), Competition(builder, alone)
        second = harder(within, gear, named.effect_at, options, progress)
        if second is None:
            continue
        gain = bic_gain(beside.fit, second.fit, first.cost + second.cost, beside.fit.noise)
        ahead = gain - named.delta_bic > nearness(gain, options)
        if ahead and not (inside_objection(within, second, base, options) or held_out_objection(
            beside.fit, second.fit, seed=options.seed
        )):  # fmt: skip
            return Part(beside, first), Part(within, second)
    return ()


def _inside(beside: Competition, fit: Fit, gear: EffectAtJoint) -> list[Proposal]:
    """What acts in a gear of a fit, with its values; beside: the model without them."""
    others = {gear, *beside.fit.model.added_effects}
    return [fitted_proposal(fit, a) for a in fit.model.added_effects if a not in others]


def _fitted_from_best(competition: Competition, starts: Sequence[Sequence[Proposal]], progress: Progress) -> Fit | None:
    """The model with several effects, fitted from the best of these starts."""
    tried = sorted((competition.misfit(*start), place) for place, start in enumerate(starts))[:STARTS]
    best = [starts[place] for misfit, place in tried if np.isfinite(misfit)]
    return None if progress.is_time_up else _fitted(competition, best, until=progress.ends)


def inside_objection(within: Competition, inside: FittedCandidate, base: Fit, options: Options) -> str:
    """Why what acts in a gear is not named where another gear would be named instead, or an empty string: that it is a
    small part of what the gear explains does not count there."""
    of_any_share = replace(options, smallest_share=0.0, smallest_part=0.0)
    return objection(inside, within.fit, of_any_share, base=base)


def _gears_on(builder: LoopModelBuilder, joint: int, options: Options) -> list[EffectAtJoint]:
    """Gears that may be there, those with the fewest parameters first."""
    allowed = (n for n, e in builder.effects.items() if e.elastic and e.is_proposed and n not in options.forbid)
    gears = [a for a in (EffectAtJoint(name, joint) for name in allowed) if builder.at(a).can_be_added]
    return sorted((a for a in gears if not builder.at(a).is_present), key=lambda a: builder.at(a).cost)


def _stiffness(builder: LoopModelBuilder, gear: EffectAtJoint) -> str:
    """The name of the stiffness of a gear: without the gear it is infinite."""
    effect, placed = builder.effect(gear), builder.at(gear)
    return next(v.name for v in (*placed.amplitudes, *placed.shapes) if np.isinf(effect.neutral.get(v.name, 0.0)))
