"""What else explains the data as well as an effect that was found, or better, beside all others that were found.

The set of an effect is that of its round, in which others were still missing, and where the fit of a rival with many
minima, such as play in a gear, may have ended in a poor one; and an effect that was the best beside the base alone
stays for a rest of what another one explains better. So when no further effect is accepted, each effect meets its
rivals once more in its place: those of its set of another class, or on another joint, those of many minima from their
whole range, and what promises more than it explains beside all others:

    lead = gain in BIC of the rival beside all others - gain of the effect beside the same

A rival to which nothing can be objected is named instead where it leads by more than what is ambiguous; where it is
as good, nothing tells which of the two acts, and the verdict doubts the name.

Source: A. J. Miller, Subset selection in regression, 2nd edition, 2002, on sequential replacement.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import partial

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, Diagnostic
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.harmonics import OF_ONE_PERIOD
from fmu_didim.discovery.progress import Progress
from fmu_didim.discovery.screening.catalogue import SignatureCatalogue
from fmu_didim.discovery.selection.beside_others import (
    by_importance,
    fit_without,
    fitted_to_minimum,
    shifts_log,
    without_superfluous,
)
from fmu_didim.discovery.selection.candidates import FittedCandidate, ScreenedCandidate
from fmu_didim.discovery.selection.competition import LEADING, Competition, proposal_of
from fmu_didim.discovery.selection.decide import NEAR_STATED, Options, Step, nearness, objection, step_of, with_in_set
from fmu_didim.discovery.selection.gears import hardened, hardening_instead, harder, inside_objection, other_gears
from fmu_didim.discovery.selection.parts import Part, gain_of, parts_of_named, together_like
from fmu_didim.discovery.selection.plausible import MAY_BE_ABSENT, repeats
from fmu_didim.discovery.selection.wide_search import searched_widely
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.gap import joint_gaps
from fmu_didim.model.loop_model import EffectAtJoint

EFFECT_AMBIGUOUS = CATALOGUE(
    "effect-ambiguous", DOUBT, rank=53,
    meaning="Another effect, of another kind or on another joint, explains these data as well as the one that is "
    "named, beside all else that was found. Which of them acts is not told, and what to do about them differs: play is "
    "taken up, an elastic gear is not.",
    next_step="Do what the report names with the finding to split them, a motion or another sensor, and analyse both "
    "logs together.",
)  # fmt: skip
PROMISED = 2
"""[candidates] Fitted in the place of an effect beside the rivals of its set: the first of those that promise more than
it explains beside all others."""
IN_ITS_PLACE = "{0} on joint {1} was accepted first; beside all others {2} explains {3:.0f} more in BIC in its place."
"""Remark on an effect that is named in the place of another one."""
AS_MACHINES_HAVE = (
    "{0} on joint {1} was accepted first, but {2}; beside all others {3} explains nearly as much in its place, {4:.0f} "
    "of {5:.0f} in BIC."
)
"""The same where it explains a little less."""
SIMPLER = "{0} on joint {1} was accepted first; beside all others {2} explains as much in its place, with fewer values."
"""The same where it is simpler and as good."""
HARDER = "{0}: beside {1} it explains more than {2} in the place of that."
"""Remark on what acts in a gear in the place of which another one would be named."""
OTHERS_INSTEAD = "{0} on joint {1} was accepted first; {2} {3} in its place, beside all others."
"""Remark on the first of those that are named in the place of an effect that may stand for them, or they for it."""


class Standing(Enum):
    """How a rival stands to the effect that is named."""

    BEHIND = "behind"
    AS_GOOD = "as good"
    AHEAD = "ahead"


def standing(lead: float, near: float, objected: str) -> Standing:
    """Of a rival with this lead in BIC, where differences up to ``near`` decide nothing, and this objection to it.

    That it may be absent says that its form is not sure, not that the effect which is named is the right one: an
    elastic gear is play of no width, and a rival that leads all the same explains something that the effect does not.
    """
    if objected.startswith(MAY_BE_ABSENT):
        return Standing.AS_GOOD if lead > 0 else Standing.BEHIND
    if objected or lead < -near:
        return Standing.BEHIND
    return Standing.AHEAD if lead > near else Standing.AS_GOOD


@dataclass(frozen=True)
class Contest:
    """An effect and its rivals, each fitted in its place beside all others.

    Attributes:
        beside: the others; named: the effect; rivals: those that were fitted, the best first, with the objection to
            each.
        is_nested: whether one of them is another one with a value of zero, as gears in which the same acts.
    """

    beside: Competition
    named: FittedCandidate
    rivals: tuple[tuple[FittedCandidate, str], ...]
    is_nested: bool = False

    def standings(self, options: Options) -> list[tuple[FittedCandidate, float, Standing]]:
        """Each rival with its lead in BIC and how it stands.

        What the case states, such as gains of the controller, is not doubted for what it is confounded with unless that
        explains far less, and an effect with values that hardly any machine has gives way to what explains nearly as
        much, as in the decision of a round; what the user prefers is not replaced. Of those that are as good the one
        with the fewest parameters is named, as there. Play is kept, of which the start of a log may tell more, unless
        the same acts in both gears, so that one is the other with a value of zero.
        """
        return [
            (rival, rival.delta_bic - self.named.delta_bic, self._how(rival, why, options))
            for rival, why in self.rivals
        ]

    def _how(self, rival: FittedCandidate, why: str, options: Options) -> Standing:
        named, builder = self.named, self.beside.builder
        of_rival, of_named = builder.effect(rival.effect_at), builder.effect(named.effect_at)
        gives_way = of_named.name in of_rival.confounded_with
        lead = rival.delta_bic - named.delta_bic
        far = not why and lead > NEAR_STATED * rival.delta_bic
        how = standing(lead, nearness(max(named.delta_bic, rival.delta_bic), options), why)
        if of_rival.is_stated and gives_way:
            how = Standing.AHEAD if far else Standing.BEHIND
        elif named.unusual and not rival.unusual:
            alike = not why and of_rival.name in of_named.confounded_with
            how = Standing.AHEAD if alike and lead > -NEAR_STATED * named.delta_bic else how
        elif how is Standing.AHEAD and rival.unusual and not named.unusual and gives_way and not far:
            how = Standing.AS_GOOD
        is_simpler = not why and rival.cost < named.cost and not rival.unusual
        if how is Standing.AS_GOOD and is_simpler and (self.is_nested or not of_named.has_minima):
            how = Standing.AHEAD
        is_kept = named.effect_at.effect in options.prefer
        return Standing.AS_GOOD if how is Standing.AHEAD and is_kept else how


Contests = dict[tuple[frozenset[EffectAtJoint], EffectAtJoint], Contest | None]
"""Effects of a model and the one of them that is contested -> the contest, so that none is run twice."""


@dataclass(frozen=True)
class Rivalry:
    """The contests of a search.

    Attributes:
        builder: of its models; base: its first fit; contests: those that were run. What has lost one does not come
            back. divided: effects of a model in whose place two were looked for; hardened: gears of a model that were
            fitted with what may act in them.
    """

    builder: LoopModelBuilder
    base: Fit
    options: Options
    progress: Progress
    contests: Contests = field(default_factory=dict)
    divided: set[tuple[frozenset[EffectAtJoint], EffectAtJoint]] = field(default_factory=set)
    hardened: set[tuple[frozenset[EffectAtJoint], EffectAtJoint]] = field(default_factory=set)

    def instead(
        self, fit: Fit, steps: Sequence[Step], catalogue: SignatureCatalogue
    ) -> tuple[Fit, list[Step]] | None:  # fmt: skip
        """The model and its steps with a rival in the place of an effect that it is ahead of; None if there is none.
        What explains least beside all others is contested first.

        Args:
            catalogue: the signatures of all candidates.
        """
        builder, lost = self.builder, {effect_at for added, effect_at in self.contests if effect_at not in added}
        for step in reversed(by_importance(steps, fit, builder)):
            found = self._contest(fit, step, catalogue)
            ahead = [] if found is None else [
                (c, lead) for c, lead, how in found.standings(self.options)
                if how is Standing.AHEAD and c.effect_at not in lost
            ]  # fmt: skip
            if found is None or not ahead:
                inside = self._hardened(fit, steps, step)
                if inside is not None:
                    return inside
                parts = self._parts(fit, step, catalogue)
                if parts is not None:
                    return self._with_parts(*parts, steps, step)
                continue
            inside = self._inside_instead(fit, steps, step, *ahead[0])
            if inside is not None:
                return inside
            rival, lead = fitted_to_minimum(builder, ahead[0][0]), ahead[0][1]
            self.progress.say(f"{rival.effect_at.text} instead of {step.effect_at.text}")
            self.contests[frozenset(rival.fit.model.added_effects), step.effect_at] = None
            effect, other = builder.effect(step.effect_at), builder.effect(rival.effect_at)
            remark = _remark(found.named, effect.title, other.title.lower(), lead)
            new = step_of(rival, (rival, found.named), found.beside, self.options)
            new = replace(new, remark=" ".join(filter(None, (new.remark, remark))))
            others = [replace(s, without=None) for s in steps if s is not step]
            return without_superfluous(builder, rival.fit, [*others, new], self.options, self.progress)
        return None

    def _beside(self, fit: Fit, step: Step) -> Competition | None:
        """The other effects of a model; None where it cannot be run without this one, or where others act in it."""
        without = fit_without(self.builder, fit, step)
        if without is None or len(fit.model.added_effects) - len(without.model.added_effects) > 1:
            return None
        return Competition(self.builder, without)

    def _parts(self, fit: Fit, step: Step, catalogue: SignatureCatalogue) -> tuple[tuple[Part, ...], float] | None:
        """Effects of one joint that an effect may stand for, or they for it, with their lead in BIC; looked for once in
        this model."""
        key, is_gear = (frozenset(fit.model.added_effects), step.effect_at), self.builder.effect(step.effect_at).elastic
        asked = is_gear or together_like(self.builder, step.effect_at)
        if key in self.divided or self.progress.is_time_up or not asked:
            return None
        self.divided.add(key)
        beside = self._beside(fit, step)
        if beside is None:
            return None
        named = beside.assess(step.effect_at, fit)
        parts = (
            hardening_instead(beside, named, self.base, self.options, self.progress) if is_gear
            else parts_of_named(beside, named, catalogue, self.base, self.options, self.progress)
        )  # fmt: skip
        return (parts, gain_of(beside, parts) - named.delta_bic) if parts else None

    def _with_parts(
        self, parts: Sequence[Part], lead: float, steps: Sequence[Step], step: Step
    ) -> tuple[Fit, list[Step]]:
        """The model and its steps with them in the place of an effect."""
        builder = self.builder
        candidates = [p.candidate for p in parts]
        candidates[-1] = fitted_to_minimum(builder, candidates[-1])
        names = " and ".join(c.effect_at.text for c in candidates)
        self.progress.say(f"{names} instead of {step.effect_at.text}")
        self.contests[frozenset(candidates[-1].fit.model.added_effects), step.effect_at] = None
        new = [step_of(c, (c,), p.competition, self.options) for c, p in zip(candidates, parts, strict=True)]
        titles = " and ".join(builder.effect(c.effect_at).title.lower() for c in candidates)
        verb = "together explain" if len(candidates) > 1 else "explains"
        much = "more" if lead > self.options.threshold else "as much"
        effect = builder.effect(step.effect_at)
        remark = OTHERS_INSTEAD.format(effect.title, step.effect_at.joint, titles, f"{verb} {much}")
        new[0] = replace(new[0], remark=remark)
        others = [replace(s, without=None) for s in steps if s is not step]
        return without_superfluous(builder, candidates[-1].fit, [*others, *new], self.options, self.progress)

    def _hardened(self, fit: Fit, steps: Sequence[Step], step: Step) -> tuple[Fit, list[Step]] | None:
        """The model and its steps with what acts in a gear, fitted together with that where its joint has a gap left,
        once in this model; None where the data do not support it."""
        builder, key = self.builder, (frozenset(fit.model.added_effects), step.effect_at)
        asked = builder.effect(step.effect_at).elastic and key not in self.hardened and not self.progress.is_time_up
        if not asked or _gap_of(fit, step.effect_at.joint) <= self.options.smallest_size:
            return None
        self.hardened.add(key)
        without = fit_without(builder, fit, step)
        if without is None:
            return None
        self.progress.say(f"{step.effect_at.text} together with what may act in it")
        inside = hardened(Competition(builder, without), fit, step.effect_at, self.options, self.progress)
        if inside is None or objection(inside, fit, self.options, base=self.base):
            return None
        inside = fitted_to_minimum(builder, inside)
        new = step_of(inside, (inside,), Competition(builder, fit), self.options)
        others = [replace(s, without=None) for s in steps]
        return without_superfluous(builder, inside.fit, [*others, new], self.options, self.progress)

    def _inside_instead(
        self, fit: Fit, steps: Sequence[Step], step: Step, rival: FittedCandidate, lead: float
    ) -> tuple[Fit, list[Step]] | None:
        """The model and its steps with what acts in a gear, where that explains more beside it than another gear does
        in its place; None if nothing does."""
        builder, within = self.builder, Competition(self.builder, fit)
        if not (builder.effect(step.effect_at).elastic and builder.effect(rival.effect_at).elastic):
            return None
        inside = harder(within, step.effect_at, rival.effect_at, self.options, self.progress)
        if inside is None or inside.delta_bic < lead or inside_objection(within, inside, self.base, self.options):
            return None
        self.progress.say(f"{inside.effect_at.text} beside {step.effect_at.text}, not {rival.effect_at.text}")
        inside = fitted_to_minimum(builder, inside)
        titles = [builder.effect(a).title for a in (inside.effect_at, step.effect_at, rival.effect_at)]
        new = step_of(inside, (inside,), within, self.options)
        remark = HARDER.format(f"{titles[0]} on joint {step.effect_at.joint}", titles[1].lower(), titles[2].lower())
        new = replace(new, remark=" ".join(filter(None, (new.remark, remark))))
        return without_superfluous(builder, inside.fit, [*steps, new], self.options, self.progress)

    def told(self, fit: Fit, steps: Sequence[Step]) -> tuple[Step, ...]:
        """The steps, each with the rivals that explain the data as well beside all others; where no contest can be run,
        with those of its set."""
        told = []
        for step in steps:
            found, is_other = self._contest(fit, step), partial(_is_other, self.builder, fit, step)
            if found is None:
                near = (r for r, behind in step.ambiguous if np.isfinite(behind) and is_other(r))
                told.append(replace(step, rivals=tuple((r, float("nan")) for r in near)))
                continue
            left = [
                (c, lead) for c, lead, how in found.standings(self.options)
                if how is not Standing.BEHIND and is_other(c.effect_at)
            ]  # fmt: skip
            told.append(with_in_set(replace(step, rivals=tuple((c.effect_at, lead) for c, lead in left)), left))
        return tuple(told)

    def _contest(self, fit: Fit, step: Step, catalogue: SignatureCatalogue | None = None) -> Contest | None:
        """The contest of an effect in this model, run once; None where the model cannot be run without it, where others
        act in it, or where the time is up."""
        key = frozenset(fit.model.added_effects), step.effect_at
        if key not in self.contests:
            self.contests[key] = self._held(fit, step, catalogue)
        return self.contests[key]

    def _held(self, fit: Fit, step: Step, catalogue: SignatureCatalogue | None) -> Contest | None:
        builder, options, progress = self.builder, self.options, self.progress
        if self._hardens(fit, step):
            return self._of_gears(fit, step)
        if len(fit.model.added_effects) == 1:
            catalogue = None  # its round has compared it with all others
        known = list(rivals_of(builder, fit, step, options))
        if progress.is_time_up or not (known or catalogue):
            return None
        beside = self._beside(fit, step)
        if beside is None:
            return None
        named, found = beside.assess(step.effect_at, fit), list[FittedCandidate | None]()
        for rival in known:
            progress.say(f"{rival.text} in the place of {step.effect_at.text}")
            found.append(fitted_rival(beside, rival, step, options, progress))
        promising = [] if catalogue is None else promising_instead(beside, catalogue, fit, named, options, known)
        if promising:
            progress.say(f"what else may be in the place of {step.effect_at.text}")
            found += map(beside.finished, beside.compare(promising, progress=progress, reach=np.inf).ranking)
        if progress.is_time_up:
            return None
        fitted = [from_where_named(beside, c, named) for c in found if c is not None]
        judged = [(c, objection(c, beside.fit, options, base=self.base)) for c in fitted]
        return Contest(beside, named, tuple(sorted(judged, key=lambda r: -r[0].delta_bic)))

    def _hardens(self, fit: Fit, step: Step) -> bool:
        """Whether a gear holds what may be confounded with another gear."""
        effects, joint = self.builder.effects, step.effect_at.joint
        inside = [effects[a.effect] for a in fit.model.added_effects if a.joint == joint]
        gears = {name for name, effect in effects.items() if effect.elastic}
        return effects[step.effect_at.effect].elastic and any(
            e.needs_elastic and gears.intersection(e.confounded_with) for e in inside
        )

    def _of_gears(self, fit: Fit, step: Step) -> Contest | None:
        """The contest of a gear with others in which the same acts."""
        without = None if self.progress.is_time_up else fit_without(self.builder, fit, step)
        if without is None:
            return None
        beside = Competition(self.builder, without)
        self.progress.say(f"other gears in the place of {step.effect_at.text}, with what acts in it")
        found = other_gears(beside, fit, step.effect_at, self.options, self.progress)
        if self.progress.is_time_up or not found:
            return None
        judged = [(c, objection(c, beside.fit, self.options, base=self.base)) for c in found]
        named = beside.assess(step.effect_at, fit)
        return Contest(beside, named, tuple(sorted(judged, key=lambda r: -r[0].delta_bic)), is_nested=True)


def _gap_of(fit: Fit, joint: int) -> float:
    """The gap that is left on a joint, counted from 1, over its noise."""
    return float(joint_gaps(fit.torque_alone.residual, fit.torque_alone.noise)[joint - 1])


def _remark(named: FittedCandidate, title: str, other: str, lead: float) -> str:
    """Why a rival is named in the place of an effect."""
    joint = named.effect_at.joint
    if lead > 0:
        return IN_ITS_PLACE.format(title, joint, other, lead)
    if not named.unusual:
        return SIMPLER.format(title, joint, other)
    return AS_MACHINES_HAVE.format(title, joint, named.unusual, other, named.delta_bic + lead, named.delta_bic)


def rivals_of(builder: LoopModelBuilder, fit: Fit, step: Step, options: Options) -> Iterator[EffectAtJoint]:
    """The rivals of an effect that are no form of it, and not in the model themselves: those of its set that were
    fitted, and those of many minima that it is confounded with, whose fit in a competition tells little."""
    for rival, behind in step.ambiguous:
        if np.isfinite(behind) and _is_other(builder, fit, step, rival):
            yield rival
    known, effect = {a for a, _ in step.ambiguous}, builder.effect(step.effect_at)
    for name in effect.confounded_with:
        rival = EffectAtJoint(name, step.effect_at.joint)
        allowed = name in builder.effects and name not in options.forbid and rival not in known
        if allowed and builder.effect(rival).has_minima and _is_other(builder, fit, step, rival):
            yield rival


def _is_other(builder: LoopModelBuilder, fit: Fit, step: Step, rival: EffectAtJoint) -> bool:
    """Whether a rival of an effect is of another class than all that was named on its joint, and can be added."""
    named = {(builder.effect(a).class_name, a.joint) for a in (*fit.model.added_effects, step.effect_at)}
    return (builder.effect(rival).class_name, rival.joint) not in named and builder.at(rival).can_be_added


def fitted_rival(
    beside: Competition, rival: EffectAtJoint, step: Step, options: Options, progress: Progress
) -> FittedCandidate | None:
    """A rival beside the others, from where its round has left it, and from its whole range if it has many minima."""
    known = next((p for p in step.members if p.effect_at == rival), None)
    found = None if known is None else beside.refit(known)
    candidate = None if found is None else beside.finished(beside.assess(rival, found))
    if not beside.builder.effect(rival).has_minima:
        return candidate
    widely = searched_widely(beside, rival, seed=options.seed, progress=progress, begin=found)
    return min((c for c in (candidate, widely) if c is not None), key=lambda c: c.fit.chi_square, default=None)


def from_where_named(beside: Competition, rival: FittedCandidate, named: FittedCandidate) -> FittedCandidate:
    """A rival behind the effect that is named, fitted once more with all else where that effect has led it, if that is
    better, and to its minimum where it is near: beside a base that is tilted an offset may end elsewhere from where the
    tilt stands for the offset, too."""
    if rival.fit.chi_square <= named.fit.chi_square or beside.builder.effect(rival.effect_at).has_minima:
        return rival
    led = dict(zip(named.fit.model.names, named.fit.values, strict=True))
    begin = np.array([led[name] for name in beside.fit.model.names])
    found = beside.refit(proposal_of(rival), begin=begin)
    if found is not None and found.chi_square < rival.fit.chi_square:
        rival = beside.finished(beside.assess(rival.effect_at, found))
    if rival.delta_bic < LEADING * named.delta_bic or rival.fit.chi_square <= named.fit.chi_square:
        return rival
    return beside.assess(rival.effect_at, fitted_to_minimum(beside.builder, rival).fit)


def promising_instead(
    beside: Competition, catalogue: SignatureCatalogue, fit: Fit, named: FittedCandidate, options: Options,
    known: Sequence[EffectAtJoint],
) -> list[ScreenedCandidate]:  # fmt: skip
    """The first of those candidates that promise more beside the others than an effect of a fit, ``named``, explains or
    promises itself there; without the rivals that are known, and what may only stand for another effect that was found.

    A promise is linear, about the fit of the others alone: where these have taken up much of an effect that is not
    among them, it is a fraction of what a fit gains, of this effect and of its rivals alike.
    What an effect with values that hardly any machine has is confounded with is asked where it promises nearly as much.
    """
    if shifts_log(beside.fit) != shifts_log(catalogue.fit):  # its signatures are at other samples
        return []
    screened = beside.screen(catalogue)
    own = (s.predicted for s in screened if s.effect_at == named.effect_at)
    least = min(named.delta_bic, next(own, np.inf))
    odd = beside.builder.effect(named.effect_at).confounded_with if named.unusual else ()
    alike = {EffectAtJoint(name, named.effect_at.joint) for name in odd}
    near, least = (1 - NEAR_STATED) * least, least + nearness(least, options)
    others, taken = beside.fit.model.added_effects, {*fit.model.added_effects, *known}
    found = [
        s for s in screened
        if s.effect_at not in taken and s.predicted > (near if s.effect_at in alike else least)
        and beside.builder.has_place(s.effect_at, others)
        and not _may_stand_for_named(beside.builder, s.effect_at, fit)
    ]  # fmt: skip
    return sorted(found, key=lambda s: -s.predicted)[:PROMISED]


def _may_stand_for_named(builder: LoopModelBuilder, effect_at: EffectAtJoint, fit: Fit) -> bool:
    """Whether an effect may only stand for what a model has on its joint, as a stop for a spring, or that is its simple
    form."""
    named = {a.effect for a in fit.model.added_effects if a.joint == effect_at.joint}
    effect = builder.effect(effect_at)
    has_simple = bool(effect.simple_form) and named >= set(effect.simple_form)
    return has_simple or bool(named & set(effect.stands_for))


def ambiguities(builder: LoopModelBuilder, steps: Sequence[Step]) -> list[Diagnostic]:
    """The doubts about effects of which rivals explain the data as well."""
    found = []
    for step in steps:
        names = [_named(builder, rival, lead) for rival, lead in step.rivals]
        if names:
            text = f"{' and '.join(names)} {'explain' if len(names) > 1 else 'explains'} the data as well"
            found.append(Diagnostic(EFFECT_AMBIGUOUS, f"{text}.", step.effect_at.text))
    return found


def of_one_period(builder: LoopModelBuilder, fit: Fit) -> list[Diagnostic]:
    """The doubts about errors of a gear that repeat as a ripple of the same joint does.

    Effects of the catalogue that repeat act on the motor. What acts on the link, behind a gear that gives way, is seen
    at the motor through its resonance, and so is an error of its teeth: beside a ripple of the motor it looks alike.
    """
    effects = fit.model.added_effects
    seen = {a: repeats(fit, i, builder.effect(a)) for i, a in enumerate(effects) if builder.effect(a).frequency}
    found = []
    for inside in (a for a in seen if builder.effect(a).needs_elastic):
        ripples = (a for a in seen if a.joint == inside.joint and not builder.effect(a).needs_elastic)
        for ripple in (a for a in ripples if abs(seen[a] - seen[inside]) < OF_ONE_PERIOD):
            text = (
                f"It repeats as often as the {builder.effect(ripple).title.lower()} there: one ripple that acts on "
                "the link, behind the gear, may explain both."
            )
            found.append(Diagnostic(EFFECT_AMBIGUOUS, text, inside.text))
    return found


def _named(builder: LoopModelBuilder, rival: EffectAtJoint, lead: float) -> str:
    title = f"{builder.effect(rival).title} on joint {rival.joint}"
    if not np.isfinite(lead):
        return title
    return f"{title} (BIC {abs(lead):.0f} {'ahead' if lead > 0 else 'behind'})"
