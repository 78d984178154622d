"""The ladders of all that a discovery has found, and the doubt where a rung contradicts."""

from __future__ import annotations

from collections.abc import Sequence

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, REMARK, Diagnostic
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.ladder.evidence import evidence_in, scale_deviation
from fmu_didim.discovery.ladder.facts import RunFacts, facts_of
from fmu_didim.discovery.ladder.rungs import ladder_of
from fmu_didim.discovery.request import Request
from fmu_didim.discovery.selection.beside_others import fit_without
from fmu_didim.discovery.selection.candidates import Outcome
from fmu_didim.discovery.selection.decide import Step
from fmu_didim.discovery.selection.rounds import Discovery, Ending
from fmu_didim.results.findings import FindingResult, RungResult

CONTRADICTED = CATALOGUE(
    "effect-contradicted", DOUBT, rank=53,
    meaning="A named effect is not there where these data could show it: on a held-out motion, with another load, gain "
    "or speed, or on another unit or day. It may be another effect that looks alike along one motion, or the runs "
    "differ.",
    next_step="Look at the evidence of the finding in the report, and at what else differs in that run.",
)  # fmt: skip
OTHER_SIZE = CATALOGUE(
    "effect-of-other-size", REMARK, rank=66,
    meaning="A named effect is there in another run, too, with another size than in the fit by more than noise: its "
    "form is not quite that of the catalogue, or the runs differ. The intervals of its values count noise alone, so "
    "that a valid verdict is one of motions like the fitted ones.",
    next_step="Fit that run, too, or choose another form of the effect.",
)  # fmt: skip
NO_TIME = ("the time was up before it was looked at", "Run it again with more time.")
NOT_RUN = (
    "the model without it cannot be run",
    "Look at whether the effect stands for a plant that is wrong otherwise.",
)
"""Why nothing is known of the rungs above the fit, and what to do about it."""
EVENT = "an event of this run, which no other run can show again"
ANOTHER_SIZE = (
    "It has another size than in the fit, {0}, by more than noise: its form is not quite that of the catalogue, or "
    "the runs differ. The intervals of its values count noise alone."
)
Ladder = list[RungResult]


def ladders_of(discovery: Discovery, builder: LoopModelBuilder, request: Request) -> list[Ladder]:
    """The ladder of each effect that was found: shapes that were fitted anew first, then the steps; none while the
    search goes on."""
    if discovery.ending is Ending.RUNNING or not (discovery.steps or discovery.refitted):
        return []
    facts, seed = facts_of(discovery.base), request.options.seed
    tried = {t.effect_at for comparison in discovery.tried for t in comparison if t.outcome is Outcome.FITTED}
    found = []
    for one in discovery.refitted:
        seen = _seen(one.delta_bic, one.share)
        evidence = {k: evidence_in(k, one.held, discovery.final, seed=seed) for k in facts}
        found.append(ladder_of(seen, facts, evidence, joint=one.joint, candidates=len(tried)))
    for step in discovery.steps:
        request.progress.say(f"evidence of {step.effect_at.effect} on joint {step.effect_at.joint}")
        found.append(_of_step(step, discovery, builder, request, facts, len(tried)))
    return found


def _of_step(
    step: Step, discovery: Discovery, builder: LoopModelBuilder, request: Request, facts: dict[str, RunFacts],
    candidates: int,
) -> Ladder:  # fmt: skip
    effect, final = builder.effect(step.effect_at), discovery.final
    seen, joint = _seen(step.delta_bic, step.share), None if effect.is_of_log else step.effect_at.joint
    without = None if request.progress.is_time_up else fit_without(builder, final, step)
    if without is None:
        why, next_step = NO_TIME if request.progress.is_time_up else NOT_RUN
        unknown = {"state": "open", "text": why, "next_step": next_step}
        found = ladder_of(seen, facts, {}, joint=joint)
        return [one if one.rung == "fit" else one.model_copy(update=unknown) for one in found]
    deviation = scale_deviation(final, final.model.added_effects.index(step.effect_at), effect.neutral)
    evidence = {k: evidence_in(k, without, final, deviation=deviation, seed=request.options.seed) for k in facts}
    return ladder_of(seen, facts, evidence, joint=joint, candidates=candidates)


def _seen(gain: float, share: float) -> str:
    return f"it gains {gain:.0f} in BIC and closes {100 * share:.0f} % of the gap"


def of_event(finding: FindingResult) -> Ladder:
    """The ladder of a torque from outside: it belongs to one run."""
    seen = _seen(finding.delta_bic, finding.share_of_gap)
    return [RungResult(level=1, rung="fit", state="climbed", text=f"{seen}: {EVENT}")]


def contradictions(discovery: Discovery, ladders: Sequence[Ladder]) -> list[Diagnostic]:
    """The doubts about effects that some rung contradicts."""
    return [
        Diagnostic(CONTRADICTED, f"{rung.text}.", place)
        for place, ladder in zip(_places(discovery), ladders, strict=False) for rung in ladder
        if rung.state == "contradicted"
    ]  # fmt: skip


def of_other_size(discovery: Discovery, ladders: Sequence[Ladder]) -> list[Diagnostic]:
    """The remarks on effects that have another size in some run than in the fit, on which a valid verdict rests."""
    found = []
    for place, ladder in zip(_places(discovery), ladders, strict=False):
        sizes = {one.experiment: one.size for rung in ladder for one in rung.evidence if one.differs}
        if sizes:
            there = ", ".join(
                f"{size:.2f} times as large in {label}" for label, size in sizes.items() if size is not None
            )
            rests = f"{place} is asked for along motions like the fitted ones alone ({there})"
            found.append(Diagnostic(OTHER_SIZE, ANOTHER_SIZE.format(there), place, condition=rests))
    return found


def _places(discovery: Discovery) -> list[str]:
    """The names of what was found, in the order of the ladders."""
    return [
        *(one.parameter.name for one in discovery.refitted),
        *(step.effect_at.text for step in discovery.steps),
    ]
