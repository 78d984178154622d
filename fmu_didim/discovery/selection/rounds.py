"""The rounds of discovery: compete, decide, add, refit, test backwards; until no further effect is accepted."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import partial
from itertools import islice

import numpy as np

from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.progress import Progress
from fmu_didim.discovery.screening.catalogue import SignatureCatalogue
from fmu_didim.discovery.selection.beside_others import (
    by_importance,
    fitted_to_minimum,
    shifts_log,
    without_superfluous,
)
from fmu_didim.discovery.selection.candidates import (
    FittedCandidate,
    Fruitless,
    Outcome,
    ScreenedCandidate,
    TriedCandidate,
)
from fmu_didim.discovery.selection.competition import Competition, proposal_of
from fmu_didim.discovery.selection.decide import Options, Step, decide, nearness, objection, step_of, too_small
from fmu_didim.discovery.selection.gears import gear_with_error
from fmu_didim.discovery.selection.held_out import FAILS_HELD_OUT, held_out_objection
from fmu_didim.discovery.selection.joints import on_further_joints, shared_remark
from fmu_didim.discovery.selection.missing_base import base_before, missing_base
from fmu_didim.discovery.selection.parts import parts_instead, simple_form
from fmu_didim.discovery.selection.plausible import MAY_BE_ABSENT
from fmu_didim.discovery.selection.pre_check import may_be_promising, pre_check
from fmu_didim.discovery.selection.refitted import Refitted
from fmu_didim.discovery.selection.rivals import Rivalry
from fmu_didim.discovery.selection.wide_search import searched_widely, wide_search_notes, worth_searching
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.solver.least_squares import minimise
from fmu_didim.fit.solver.termination import Stopping
from fmu_didim.model.loop_model import EffectAtJoint

PAIRED = 4
"""[candidates] The best ones that held-out data alone speak against, which are fitted two by two."""
VALLEY = 4.0
"""[chi-square] Of two fits of one effect that differ by less, both lie in the 95 % interval of any one value: where
held-out data speak against the lower one, the other is taken. A damping of a gear that the fitted motion does not show
ends anywhere between none and what it is, and makes other hits along another motion."""
TOGETHER = "{0}: held-out data confirm it only beside {1}, and {1} only beside it."
"""Remark on the first of two effects that are added together."""


class Ending(Enum):
    """The state of a search."""

    COMPLETE = "complete"
    RUNNING = "running"
    TIME_UP = "time up"


@dataclass(frozen=True)
class Discovery:
    """The result of the rounds.

    Attributes:
        base, final: fits without and with the effects; steps: one for each effect, in the end those first that explain
            most beside all others.
        refused: candidates of the last round that were not accepted, and why; small: those of them that change the
            torque by too little for a name, against which nothing else speaks, the best first.
        tried: the shortlisted candidates, round by round.
        refitted: shapes of the description that the data contradict, where no effect was found.
    """

    base: Fit
    final: Fit
    steps: tuple[Step, ...]
    refused: tuple[tuple[EffectAtJoint, str], ...] = ()
    tried: tuple[tuple[TriedCandidate, ...], ...] = ()
    ending: Ending = Ending.COMPLETE
    refitted: tuple[Refitted, ...] = ()
    small: tuple[FittedCandidate, ...] = ()


def run_rounds(
    builder: LoopModelBuilder,
    base: Fit,
    options: Options,
    progress: Progress,
    keep: Callable[[Discovery], None] = lambda discovery: None,
    *,
    begun: tuple[Fit, list[Step]] | None = None,
) -> Discovery:
    """Add effects to the base model as long as the data support them.

    Args:
        keep: called with the state before the first round and after each one.
        begun: a model with effects that were found already, and their steps, from which the rounds go on.
    """
    keep(Discovery(base, base, (), ending=Ending.RUNNING))
    candidates = _candidates(builder, options)
    if progress.is_time_up:
        checked = [name for name, effect in builder.effects.items() if effect.pre_check and name not in options.forbid]
        before = [EffectAtJoint(name, j) for name in checked for j in builder.joints(name)]
        return Discovery(base, base, (), tried=(_not_tried([*before, *candidates]),), ending=Ending.TIME_UP)
    fit, steps = pre_check(builder, base, options, progress) if begun is None else begun
    looked_at = fit
    candidates = [c for c in candidates if c not in fit.model.added_effects]
    if steps:
        keep(Discovery(base, fit, tuple(steps), ending=Ending.RUNNING))
    progress.say(f"signatures of {len(candidates)} candidates")
    catalogue = SignatureCatalogue(builder, fit, candidates=candidates, progress=progress)
    progress.say("competition of the candidates")
    refused: tuple[tuple[EffectAtJoint, str], ...] = ()
    small: tuple[FittedCandidate, ...] = ()
    tried: list[tuple[TriedCandidate, ...]] = []
    fruitless = Fruitless()
    rivalry = Rivalry(builder, base, options, progress)
    ending = Ending.COMPLETE
    while len(steps) < options.rounds:
        if catalogue.left:  # the best may be among them
            tried.append(_not_tried([c for c in candidates if c not in fit.model.added_effects]))
            ending = Ending.TIME_UP
            break
        competition = Competition(builder, fit, fruitless)
        found = _Round.of(competition, catalogue, base, options, progress)
        accepted, fruitless = found.accepted, found.fruitless
        tried.append(found.tried)
        if accepted is None:
            ending = Ending.TIME_UP
            break
        if isinstance(accepted, FittedCandidate):
            fit, steps = _with(competition, found.ranking, accepted, base, steps, options, progress)
        else:
            changed = _otherwise(competition, catalogue, found.ranking, rivalry, steps, checked=fit is looked_at)
            looked_at = fit
            if changed is None:
                refused, small = accepted, too_small(found.ranking, accepted, fit, options, base=base)
                ending = Ending.TIME_UP if progress.is_time_up else ending  # what was begun last may have been cut
                break
            fit, steps = changed
        fit = builder.settled(fit)
        keep(Discovery(base, fit, tuple(steps), tried=tuple(tried), ending=Ending.RUNNING))
        candidates = _candidates(builder, options, fit.model.added_effects)
        catalogue = _beside(builder, catalogue, fit, candidates, progress)
    ordered = by_importance(steps, fit, builder)
    if ending is Ending.COMPLETE:
        ordered = rivalry.told(fit, ordered)
    return Discovery(base, fit, ordered, refused, tuple(tried), ending, small=small)


def _otherwise(
    competition: Competition,
    catalogue: SignatureCatalogue,
    ranking: Sequence[FittedCandidate],
    rivalry: Rivalry,
    steps: list[Step],
    *,
    checked: bool,
) -> tuple[Fit, list[Step]] | None:
    """The model and its steps with another change than one more effect, where none is accepted; None if there is none.

    Args:
        checked: whether the pre-check has looked at this fit.
    """
    builder, fit, base, options, progress = (
        competition.builder, competition.fit, rivalry.base, rivalry.options, rivalry.progress
    )  # fmt: skip
    has_room = len(steps) + 2 <= options.rounds
    changed = _base_instead(competition, ranking, base, steps, options, progress)
    if changed is None and not checked:
        changed = _checked_again(builder, fit, steps, options, progress)
    if changed is None:
        changed = rivalry.instead(fit, steps, catalogue)
    again = _at_best_minima(competition, ranking, options, progress) if changed is None else []
    ranking = _ranked(ranking, *again) if again else ranking
    if changed is None and has_room:
        changed = _gear(competition, ranking, base, steps, options, progress)
    if changed is None:
        changed = _widely_searched(competition, ranking, again, base, steps, options, progress)
    if changed is None and has_room:
        changed = _pair(competition, ranking, base, steps, options, progress)
    return changed


Accepted = FittedCandidate | tuple[tuple[EffectAtJoint, str], ...] | None
"""The candidate to add, or the objections to all; None if the time was up before all were tried."""


@dataclass(frozen=True)
class _Round:
    """What a round has found.

    Attributes:
        ranking: the fitted candidates, the best first; tried: all of them; fruitless: in this round and before.
    """

    ranking: Sequence[FittedCandidate]
    tried: tuple[TriedCandidate, ...]
    accepted: Accepted
    fruitless: Fruitless

    @classmethod
    def of(
        cls, competition: Competition, catalogue: SignatureCatalogue, base: Fit, options: Options, progress: Progress
    ) -> _Round:
        """A round of these candidates beside the present model."""
        screened = competition.screen(catalogue)
        comparison = competition.compare(competition.shortlist(screened), progress=progress)
        ranking, tried = comparison.ranking, comparison.tried
        fruitless = competition.fruitless.and_then(comparison.fruitless)
        if comparison.is_cut:
            return cls(ranking, tried, None, fruitless)
        judge = partial(
            _judge(competition, base, options), held=partial(_with_shapes_held, competition, screened),
            at_harmonic=partial(_at_harmonic, competition, screened),
            may_be=lambda one, other: competition.may_be(one, other),
        )  # fmt: skip
        accepted = judge(ranking)
        if comparison.unfitted and not isinstance(accepted, FittedCandidate):
            comparison = competition.compare(comparison.unfitted, progress=progress, reach=float("inf"))
            again = {t.effect_at for t in comparison.tried}
            tried = (*(t for t in tried if t.effect_at not in again), *comparison.tried)
            if comparison.is_cut:
                return cls(ranking, tried, None, fruitless)
            ranking = tuple(sorted((*ranking, *comparison.ranking), key=lambda c: -c.delta_bic))
            accepted = judge(ranking)
        named = accepted if isinstance(accepted, FittedCandidate) else None
        if (untold := simple_form(competition, ranking, named, base, options)) is not None:
            return cls(ranking, tried, untold, fruitless)
        if not isinstance(accepted, FittedCandidate):
            return cls(ranking, tried, accepted, fruitless)
        first = base_before(
            competition, ranking, accepted, nearness(accepted.delta_bic, options),
            lambda candidate: isinstance(judge((candidate,)), FittedCandidate),
        )  # fmt: skip
        if first is not accepted:
            ranking = tuple(c for c in ranking if c.delta_bic <= first.delta_bic)
        best = _at_best_minimum(competition, first, base, options, progress)
        return cls(ranking if best is first else _ranked(ranking, best), tried, best, fruitless)


def _judge(
    competition: Competition, base: Fit, options: Options
) -> Callable[..., FittedCandidate | tuple[tuple[EffectAtJoint, str], ...]]:
    """The decision between candidates for the next effect: a ranking -> the one to add, or the objections to all."""
    return partial(
        decide, fit=competition.fit, options=options, base=base, finished=competition.finished,
        class_of=lambda effect_at: competition.builder.effect(effect_at).class_name,
        rivals_of=partial(_rivals, competition),
    )  # fmt: skip


def _rivals(competition: Competition, candidate: FittedCandidate) -> frozenset[str]:
    """Names of the effects that one is confounded with, if it has values that hardly any machine has; those of other
    classes, if it changes what the case states."""
    effects, effect = competition.builder.effects, competition.builder.effect(candidate.effect_at)
    others = (n for n in effect.confounded_with if n in effects and (effect.is_stated or candidate.unusual))
    return frozenset(n for n in others if candidate.unusual or effects[n].class_name != effect.class_name)


def _ranked(ranking: Sequence[FittedCandidate], *instead: FittedCandidate) -> tuple[FittedCandidate, ...]:
    """A ranking with other fits of some candidates."""
    again = {c.effect_at for c in instead}
    return tuple(sorted((*instead, *(c for c in ranking if c.effect_at not in again)), key=lambda c: -c.delta_bic))


def _at_best_minimum(
    competition: Competition, accepted: FittedCandidate, base: Fit, options: Options, progress: Progress
) -> FittedCandidate:
    """An effect that is accepted, at a better one of its minima, if it has many and nothing speaks against that one."""
    if not competition.builder.effect(accepted.effect_at).has_minima:
        return accepted
    found = searched_widely(
        competition, accepted.effect_at, seed=options.seed, progress=progress, begin=accepted.fit
    )  # fmt: skip
    is_better = found is not None and found.fit.chi_square < accepted.fit.chi_square
    if found is None or not is_better or objection(found, competition.fit, options, base=base):
        return accepted
    return found


def _at_best_minima(
    competition: Competition, ranking: Sequence[FittedCandidate], options: Options, progress: Progress
) -> list[FittedCandidate]:
    """Where nothing was accepted, the effects of many minima at a better one than they have in the ranking, on joints
    with a gap: the fit of one minimum tells nothing of the others."""
    asked = _of_many_minima(competition.builder, competition.fit, options)
    if not asked:
        return []
    tried = (searched_widely(competition, a, seed=options.seed, progress=progress) for a in asked)
    known = {c.effect_at: c.fit.chi_square for c in ranking}
    return [c for c in tried if c is not None and c.fit.chi_square < known.get(c.effect_at, np.inf)]


def _of_many_minima(builder: LoopModelBuilder, fit: Fit, options: Options) -> list[EffectAtJoint]:
    candidates = _candidates(builder, options, fit.model.added_effects)
    return worth_searching(builder, fit, candidates, options.smallest_size)


def not_widely_searched(builder: LoopModelBuilder, discovery: Discovery, options: Options) -> list[str]:
    """Notes on effects of many minima that were looked for from a few starts alone."""
    if discovery.ending is not Ending.COMPLETE:
        return []  # what was not done then is told in other words
    final = discovery.final
    return wide_search_notes(builder, final, _of_many_minima(builder, final, options))


def _widely_searched(
    competition: Competition,
    ranking: Sequence[FittedCandidate],
    again: Sequence[FittedCandidate],
    base: Fit,
    steps: list[Step],
    options: Options,
    progress: Progress,
) -> tuple[Fit, list[Step]] | None:
    """The model and its steps with an effect of many minima at a better one; None if none is accepted there.

    Args:
        again: these effects at that minimum, which the ranking holds.
    """
    if not again:
        return None
    in_order = sorted(again, key=lambda c: -c.delta_bic)
    accepted = decide(in_order, competition.fit, options, base=base, finished=competition.finished)
    if not isinstance(accepted, FittedCandidate):
        return None
    return _with(competition, ranking, accepted, base, steps, options, progress)


def _with(
    competition: Competition,
    ranking: Sequence[FittedCandidate],
    accepted: FittedCandidate,
    base: Fit,
    steps: list[Step],
    options: Options,
    progress: Progress,
) -> tuple[Fit, list[Step]]:
    """The model and its steps with the accepted effect, or with those that it would stand for, and with the same on
    further joints where joints have it in common."""

    def at_minimum(candidate: FittedCandidate) -> FittedCandidate:
        lowest = fitted_to_minimum(competition.builder, candidate).fit
        return replace(candidate, fit=_along_valley(competition.fit, candidate, lowest, options))

    parts, remark = parts_instead(competition, accepted, base, options)
    if parts:
        candidates = [*(p.candidate for p in parts[:-1]), at_minimum(parts[-1].candidate)]
        added = [step_of(c, (c,), p.competition, options) for c, p in zip(candidates, parts, strict=True)]
        added[0] = replace(added[0], remark=" ".join(filter(None, (added[0].remark, remark))))
    else:
        candidates = [at_minimum(accepted)]
        added = [step_of(candidates[0], ranking, competition, options)]
        room = options.rounds - len(steps) - 1
        if further := on_further_joints(competition, ranking, candidates[0], base, options, room):
            own = [*(p.candidate for p in further[:-1]), at_minimum(further[-1].candidate)]
            added += [step_of(c, (c,), p.competition, options) for c, p in zip(own, further, strict=True)]
            shared = shared_remark(competition.builder.effect(accepted.effect_at).title, candidates[0], further)
            added[1] = replace(added[1], remark=" ".join(filter(None, (shared, added[1].remark))))
            candidates += own
    for step in added:
        progress.say(f"added: {step.effect_at.effect} on joint {step.effect_at.joint}")
    return without_superfluous(competition.builder, candidates[-1].fit, [*steps, *added], options, progress)


def _along_valley(before: Fit, candidate: FittedCandidate, lowest: Fit, options: Options) -> Fit:
    """The lower one of two fits with an effect, or the first where the data hardly tell them apart and held-out data
    speak against the lower one alone."""
    first, lenience = candidate.fit, options.lenience(hits=candidate.has_minima)

    def objected(fit: Fit) -> str:
        return held_out_objection(before, fit, seed=options.seed, lenience=lenience)

    if first.chi_square - lowest.chi_square >= VALLEY or not objected(lowest):
        return lowest
    return lowest if objected(first) else first


def _base_instead(
    competition: Competition,
    ranking: Sequence[FittedCandidate],
    base: Fit,
    steps: list[Step],
    options: Options,
    progress: Progress,
) -> tuple[Fit, list[Step]] | None:
    """The model and its steps with an effect of every base model, which a black box lacks, instead of an effect on its
    joint that it makes superfluous; None if there is none.

    Where the base fit has gone astray, another effect may lead out of it when the right one does not. Beside it the
    right one then explains a part of the first gap that is too small for an effect of its own.
    """
    builder, of_any_part = competition.builder, replace(options, smallest_part=0.0)
    missing = [a for j in {step.effect_at.joint for step in steps} for a in missing_base(competition, j)]
    for candidate in (c for c in ranking if missing and c.effect_at in missing):
        judged = decide((candidate,), competition.fit, of_any_part, base=base, finished=competition.finished)
        if not isinstance(judged, FittedCandidate):
            continue
        whole = minimise(judged.fit.model, competition.fit.noise, stopping=Stopping(updates=1, exact=True))
        step = step_of(replace(judged, fit=whole), ranking, competition, options)
        fit, left = without_superfluous(builder, whole, [*steps, step], options, progress)
        if len(left) > len(steps):
            continue
        progress.say(f"added instead: {step.effect_at.effect} on joint {step.effect_at.joint}")
        if left == [step]:  # all that it explains is its own
            from_base = Competition(builder, base)
            alone = from_base.assess(step.effect_at, fit)
            left = [step_of(alone, (alone,), from_base, options)]
        return fit, left
    return None


def _checked_again(
    builder: LoopModelBuilder, fit: Fit, steps: list[Step], options: Options, progress: Progress
) -> tuple[Fit, list[Step]] | None:
    """The model and its steps with an effect of the pre-check that the effects found since have laid bare: before them
    it was a small part of the gap; None if there is none, and without a look where they have closed the gap."""
    if not may_be_promising(fit):
        return None
    fit, found = pre_check(builder, fit, options, progress)
    return without_superfluous(builder, fit, [*steps, *found], options, progress) if found else None


def _pair(
    competition: Competition,
    ranking: Sequence[FittedCandidate],
    base: Fit,
    steps: list[Step],
    options: Options,
    progress: Progress,
) -> tuple[Fit, list[Step]] | None:
    """The model and its steps with two effects, each of which held-out data confirm beside the other alone; None if
    there are none.

    What one lacks where the other is missing moves its size, and its prediction, along another motion.
    """
    whole_fits = (competition.finished(c) for c in ranking if c.delta_bic >= options.threshold)
    failing = (c for c in whole_fits if _fails_held_out(c, competition.fit, base, options))
    hopeful = sorted(islice(failing, PAIRED), key=lambda c: bool(c.unusual))
    for i, first in enumerate(hopeful):
        beside = Competition(competition.builder, first.fit)
        for second in hopeful[i + 1 :]:
            found = beside.refit(proposal_of(second)) if _differ(competition, first, second) else None
            if found is None:
                continue
            candidate = beside.finished(beside.assess(second.effect_at, found))
            whole = candidate.fit
            if objection(candidate, first.fit, options, base=base) or any(
                held_out_objection(before, whole, seed=options.seed) for before in (second.fit, competition.fit)
            ):
                continue
            names = [f"{c.effect_at.effect} on joint {c.effect_at.joint}" for c in (first, second)]
            progress.say(f"added together: {' and '.join(names)}")
            whole = minimise(whole.model, whole.noise, stopping=Stopping(updates=1, exact=True))
            candidate = replace(candidate, fit=whole)
            added = [
                replace(step_of(first, (first,), competition, options), remark=TOGETHER.format(*names)),
                step_of(candidate, (candidate,), beside, options),
            ]
            return without_superfluous(competition.builder, whole, [*steps, *added], options, progress)
    return None


def _gear(
    competition: Competition,
    ranking: Sequence[FittedCandidate],
    base: Fit,
    steps: list[Step],
    options: Options,
    progress: Progress,
) -> tuple[Fit, list[Step]] | None:
    """The model and its steps with an elastic gear and what acts in it, neither of which shows alone; None if there is
    none."""
    found = gear_with_error(competition, ranking, base, options, progress)
    if found is None:
        return None
    return without_superfluous(competition.builder, found[0], [*steps, *found[1]], options, progress)


def _differ(competition: Competition, first: FittedCandidate, second: FittedCandidate) -> bool:
    """Whether two candidates are no two forms of one effect: another class, or another joint."""
    one, other = (competition.builder.effect(c.effect_at).class_name for c in (first, second))
    return one != other or first.effect_at.joint != second.effect_at.joint


def _fails_held_out(candidate: FittedCandidate, fit: Fit, base: Fit, options: Options) -> bool:
    """Whether held-out data alone speak against a candidate."""
    return objection(candidate, fit, options, base=base).startswith(FAILS_HELD_OUT)


def _beside(
    builder: LoopModelBuilder, catalogue: SignatureCatalogue, fit: Fit, candidates: Sequence[EffectAtJoint],
    progress: Progress,
) -> SignatureCatalogue:  # fmt: skip
    """The signatures beside the effects of a fit: anew where the log has moved, else those of what acts in elastic
    gears, which ring otherwise with each effect."""
    left = [c for c in candidates if c not in fit.model.added_effects]
    if shifts_log(fit) != shifts_log(catalogue.fit):  # signatures at other samples
        return SignatureCatalogue(builder, fit, candidates=left, progress=progress)
    in_gears = [c for c in left if builder.effect(c).needs_elastic]
    if not in_gears:
        return catalogue
    progress.say(f"signatures of what acts in elastic gears, at {len(in_gears)}")
    return catalogue.extended(fit, in_gears, progress)


def _not_tried(candidates: Sequence[EffectAtJoint]) -> tuple[TriedCandidate, ...]:
    return tuple(TriedCandidate(effect_at, Outcome.NOT_TRIED) for effect_at in candidates)


def _with_shapes_held(
    competition: Competition, screened: Sequence[ScreenedCandidate], candidate: FittedCandidate
) -> Iterator[FittedCandidate]:
    """A candidate with its shapes held: outside the torque balance where held-out data alone speak against it, in the
    balance where its amplitude may be absent.

    There a shape that is free may make it one of many: beside viscous and Coulomb friction, a power of the velocity of
    nearly one fits with any amplitude, and so does a small one of another power. That a friction between them is there
    is a matter of the gain in BIC, and of its size with one of these powers.
    """
    effect_at = candidate.effect_at
    wanted = next(s for s in screened if s.effect_at == effect_at)
    may_be_absent = candidate.implausible.startswith(MAY_BE_ABSENT)
    if competition.builder.at(effect_at).shapes and (wanted.others is None) == may_be_absent:
        yield from competition.with_shapes_held(wanted)


def _at_harmonic(
    competition: Competition, screened: Sequence[ScreenedCandidate], candidate: FittedCandidate
) -> FittedCandidate | None:
    """A candidate at a harmonic of the motor of its joint."""
    return competition.at_harmonic(next(s for s in screened if s.effect_at == candidate.effect_at))


def _candidates(
    builder: LoopModelBuilder, options: Options, added: Sequence[EffectAtJoint] = ()
) -> list[EffectAtJoint]:
    """The candidates beside effects that were added; for a black box also the effects of every base model, which the
    box may lack."""
    anything = builder.description is None
    names = [
        name
        for name, effect in builder.effects.items()
        if (effect.is_proposed or (anything and effect.is_base)) and name not in options.forbid
    ]
    candidates = (EffectAtJoint(name, j) for name in names for j in builder.joints(name))
    return [a for a in candidates if not builder.at(a).is_present and builder.has_place(a, added)]
