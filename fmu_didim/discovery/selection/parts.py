"""Effects of one joint that another one may stand for, where each of them alone explains too little.

A stop bends the torque over the position where it is touched. So does a spring at rest elsewhere than at zero, which is
a spring and a constant: gravity takes up most of either, and what both leave together is bent. Therefore such effects
are fitted together before a stop is named.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from fmu_didim.discovery.augmentation.places import Proposal
from fmu_didim.discovery.selection.candidates import FittedCandidate
from fmu_didim.discovery.selection.competition import Competition
from fmu_didim.discovery.selection.decide import Options, nearness, objection
from fmu_didim.discovery.selection.held_out import held_out_objection
from fmu_didim.discovery.selection.plausible import implausible
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
    competition: Competition, accepted: FittedCandidate, base: Fit, options: Options
) -> tuple[tuple[Part, ...], str]:
    """The effects to add instead of the accepted one, in this order, with a remark; none where it explains more.

    They are as good within the BIC difference that decides nothing: each of them is common, what stands for them is
    not.
    """
    parts = _fitted(competition, _missing(competition, accepted, options))
    if not parts:
        return (), ""
    whole, last = parts[-1].candidate.fit, parts[-1]
    gain = bic_gain(competition.fit, whole, sum(p.candidate.cost for p in parts), competition.fit.noise)
    ahead, near = gain - accepted.delta_bic, nearness(accepted.delta_bic, options)
    if ahead < -near or _objected(competition, [p.candidate.effect_at for p in parts], whole, options):
        return (), ""
    of_any_share = replace(options, smallest_share=0.0, smallest_part=0.0)  # what counts is what they explain together
    if objection(last.candidate, last.competition.fit, of_any_share, base=base):
        return (), ""
    name = f"{competition.builder.effect(accepted.effect_at).title} on joint {accepted.effect_at.joint}"
    return parts, AS_WELL.format(name, ahead) if ahead < near else ""


def _missing(competition: Competition, accepted: FittedCandidate, options: Options) -> list[EffectAtJoint]:
    """The effects that it may stand for; none where it is preferred, or where one of them is in the model or cannot be:
    the other one has had its chance."""
    if accepted.effect_at.effect in options.prefer:
        return []
    builder, joint = competition.builder, accepted.effect_at.joint
    parts = [EffectAtJoint(name, joint) for name in builder.effect(accepted.effect_at).stands_for]
    free = [
        a for a in parts
        if a.effect in builder.effects and a.effect not in options.forbid
        and a not in competition.fit.model.added_effects
        and builder.at(a).can_be_added and not builder.at(a).is_present
    ]  # fmt: skip
    return free if len(free) == len(parts) else []


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
