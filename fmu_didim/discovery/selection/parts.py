"""Effects of one joint that another one may stand for, where each of them alone explains too little.

A stop bends the torque over the position where it is touched. So does a spring at rest elsewhere than at zero, which is
a spring and a constant: gravity takes up most of either, and what both leave together is bent. Therefore such effects
are fitted together before a stop is named, and once more when nothing else is found: held-out data may have confirmed
them as little as anything while something else was missing. And a stop and a constant make a torque that rises with the
position, as a spring does: they are fitted together in the place of a spring that was named, once nothing else is
found. A spring and a constant are also the simple form of the gravity compensator, whose five values such data seldom
tell.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.augmentation.places import Proposal
from fmu_didim.discovery.progress import Progress
from fmu_didim.discovery.screening.catalogue import SignatureCatalogue
from fmu_didim.discovery.selection.beside_others import shifts_log
from fmu_didim.discovery.selection.candidates import FittedCandidate
from fmu_didim.discovery.selection.competition import Competition
from fmu_didim.discovery.selection.decide import Options, nearness, objection
from fmu_didim.discovery.selection.held_out import held_out_objection
from fmu_didim.discovery.selection.plausible import NOT_TOLD, implausible
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.gap import bic_gain
from fmu_didim.model.loop_model import EffectAtJoint

AS_WELL = "{0} explains these data as well: BIC difference {1:.0f}."
"""Remark on the first of the parts, where the effect that stands for them is not told from them."""


@dataclass(frozen=True)
class Part:
    """An effect fitted beside those before it; competition: of the model that lacks it."""

    competition: Competition
    candidate: FittedCandidate


def parts_instead(
    competition: Competition, accepted: FittedCandidate, base: Fit, options: Options, *, again: bool = False
) -> tuple[tuple[Part, ...], str]:
    """The effects to add instead of the accepted one, in this order, with a remark; none where it explains more.

    They are as good within the BIC difference that decides nothing: each of them is common, what stands for them is
    not.

    Args:
        again: whether it was named, and all else was found beside it: what of them is in the model stays there.
    """
    parts = _fitted(competition, _missing(competition, accepted, options, again=again))
    if not parts:
        return (), ""
    whole, last = parts[-1].candidate.fit, parts[-1]
    gain = gain_of(competition, parts)
    ahead, near = gain - accepted.delta_bic, nearness(accepted.delta_bic, options)
    if ahead < -near or _objected(competition, [p.candidate.effect_at for p in parts], whole, options):
        return (), ""
    of_any_share = replace(options, smallest_share=0.0, smallest_part=0.0)  # what counts is what they explain together
    if objection(last.candidate, last.competition.fit, of_any_share, base=base):
        return (), ""
    name = f"{competition.builder.effect(accepted.effect_at).title} on joint {accepted.effect_at.joint}"
    return parts, AS_WELL.format(name, ahead) if ahead < near else ""


def simple_form(
    competition: Competition, ranking: Sequence[FittedCandidate], accepted: FittedCandidate | None, base: Fit,
    options: Options,
) -> FittedCandidate | None:  # fmt: skip
    """The best candidate whose own form is not told, where effects that are a simple form of it explain as much; none
    where what is accepted explains nearly as much."""
    for candidate in ranking:
        near = nearness(candidate.delta_bic, options)
        if accepted is not None and candidate.delta_bic - near <= accepted.delta_bic:
            return None
        is_untold = candidate.implausible.startswith(NOT_TOLD)
        if is_untold and parts_instead(competition, candidate, base, options)[0]:
            return candidate
    return None


def parts_of_named(
    beside: Competition, named: FittedCandidate, catalogue: SignatureCatalogue, base: Fit, options: Options,
    progress: Progress,
) -> tuple[Part, ...]:  # fmt: skip
    """A constant and a stop, say, to name instead of a spring; none where it explains as much. What stands for others
    meets these again, which need not explain more.

    A spring that rests elsewhere than at zero has a constant, too, and one that hardens is linear besides: they must
    explain more than the spring does with that, by more than what decides nothing.

    Args:
        beside: all other effects of the model; named: the effect, fitted beside them.
        catalogue: the signatures of all candidates.
    """
    builder = beside.builder
    if _stands_for(builder, named.effect_at):
        return parts_instead(beside, named, base, options, again=True)[0]
    together = [] if named.effect_at.effect in options.prefer else together_like(builder, named.effect_at)
    if not together or shifts_log(beside.fit) != shifts_log(catalogue.fit):  # its signatures are at other samples
        return ()
    best: tuple[Part, ...] = ()
    for places in together:
        if all(_may_be_added(beside, a, options) for a in places) and not progress.is_time_up:
            found = _one_after_the_other(beside, places, catalogue, progress)
            best = max(best, found, key=lambda parts: -parts[-1].candidate.fit.chi_square if parts else -np.inf)
    if not best:
        return ()
    whole, last = best[-1].candidate.fit, best[-1]
    gain = gain_of(beside, best)
    least = gain - nearness(gain, options)
    others = [p.candidate.effect_at for p in best[:-1]]
    if least <= named.delta_bic or least <= _gain_with(beside, named, others, catalogue, progress):
        return ()
    of_any_share = replace(options, smallest_share=0.0, smallest_part=0.0)  # what counts is what they explain together
    if _objected(beside, [p.candidate.effect_at for p in best], whole, options) or objection(
        last.candidate, last.competition.fit, of_any_share, base=base
    ):
        return ()
    return best


def gain_of(beside: Competition, parts: Sequence[Part]) -> float:
    """Gain in BIC of effects together over the model without them."""
    return bic_gain(beside.fit, parts[-1].candidate.fit, sum(p.candidate.cost for p in parts), beside.fit.noise)


def _gain_with(
    beside: Competition, named: FittedCandidate, others: Sequence[EffectAtJoint], catalogue: SignatureCatalogue,
    progress: Progress,
) -> float:  # fmt: skip
    """The largest gain in BIC of an effect with others of its joint, fitted before or after it, or with one more of its
    class; 0 where none of them can be fitted."""
    builder, gains = beside.builder, [0.0]
    first = Part(beside, named)
    for further in (others, *_others_of_its_class(builder, named.effect_at)):
        after = _one_after_the_other(Competition(builder, named.fit), further, catalogue, progress)
        before = _one_after_the_other(beside, [*further, named.effect_at], catalogue, progress)
        gains += [gain_of(beside, parts) for parts in ((first, *after) if after else (), before) if parts]
    return max(gains)


def together_like(builder: LoopModelBuilder, effect_at: EffectAtJoint) -> list[list[EffectAtJoint]]:
    """Effects that together may look like one: those of its class that may stand for more than that class holds, each
    behind what else it may stand for."""
    own, found = builder.effect(effect_at).class_name, []
    for name, effect in builder.effects.items():
        others = [n for n in effect.stands_for if n in builder.effects and builder.effects[n].class_name != own]
        if effect.class_name == own and others:
            found.append([EffectAtJoint(n, effect_at.joint) for n in (*others, name)])
    return found


def _others_of_its_class(builder: LoopModelBuilder, effect_at: EffectAtJoint) -> list[list[EffectAtJoint]]:
    """Further effects of the class of one, each by itself, but for those that may stand for more than the class."""
    own = builder.effect(effect_at).class_name
    names = [
        n for n, e in builder.effects.items() if e.class_name == own and not e.stands_for and n != effect_at.effect
    ]
    found = (EffectAtJoint(name, effect_at.joint) for name in names)
    return [[a] for a in found if builder.at(a).can_be_added]


def _one_after_the_other(
    beside: Competition, places: Sequence[EffectAtJoint], catalogue: SignatureCatalogue, progress: Progress
) -> tuple[Part, ...]:
    """Effects fitted in this order, each from the best shapes of its signature beside those before it; none where one
    of them promises nothing or cannot be simulated."""
    found, here = list[Part](), beside
    for effect_at in places:
        screened = [s for s in here.screen(catalogue) if s.effect_at == effect_at]
        ranking = here.compare(screened, progress=progress, reach=np.inf).ranking
        if not ranking:
            return ()
        candidate = here.finished(ranking[0])
        found.append(Part(here, candidate))
        here = Competition(beside.builder, candidate.fit)
    return tuple(found)


def _stands_for(builder: LoopModelBuilder, effect_at: EffectAtJoint) -> tuple[str, ...]:
    """Names of the effects that, together on its joint, one may stand for, or that are a simple form of it."""
    effect = builder.effect(effect_at)
    return tuple(effect.stands_for or effect.simple_form)


def _missing(
    competition: Competition, accepted: FittedCandidate, options: Options, *, again: bool
) -> list[EffectAtJoint]:
    """The effects that it may stand for, of one that is named those that are not in the model; none where it is
    preferred, or where one of them cannot be added: the other one has had its chance."""
    if accepted.effect_at.effect in options.prefer:
        return []
    known = competition.fit.model.added_effects if again else ()
    names = _stands_for(competition.builder, accepted.effect_at)
    parts = [a for a in (EffectAtJoint(name, accepted.effect_at.joint) for name in names) if a not in known]
    return parts if all(_may_be_added(competition, a, options) for a in parts) else []


def _may_be_added(competition: Competition, effect_at: EffectAtJoint, options: Options) -> bool:
    builder = competition.builder
    return (
        effect_at.effect in builder.effects and effect_at.effect not in options.forbid
        and effect_at not in competition.fit.model.added_effects
        and builder.at(effect_at).can_be_added and not builder.at(effect_at).is_present
    )  # fmt: skip


def _fitted(competition: Competition, missing: Sequence[EffectAtJoint]) -> tuple[Part, ...]:
    """One after the other, always the one that explains most; none if one of them cannot be simulated."""
    found: list[Part] = []
    left, here = list(missing), competition
    while left:
        fits = [(effect_at, here.refit(Proposal(effect_at, {}))) for effect_at in left]
        tried = [here.assess(effect_at, fit) for effect_at, fit in fits if fit is not None]
        if len(tried) < len(left):
            return ()
        best = here.finished(max(tried, key=lambda c: c.delta_bic))
        found.append(Part(here, best))
        left.remove(best.effect_at)
        here = Competition(competition.builder, best.fit)
    return tuple(found)


def _objected(competition: Competition, parts: Sequence[EffectAtJoint], whole: Fit, options: Options) -> bool:
    """Whether one of them has impossible values beside the others, or held-out data speak against them together."""
    builder = competition.builder
    return any(
        implausible(whole, whole.model.added_effects.index(a), builder.effect(a), builder.link_values(a.joint))
        for a in parts
    ) or bool(held_out_objection(competition.fit, whole, seed=options.seed))
