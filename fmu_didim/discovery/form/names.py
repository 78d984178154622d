"""What a curve of one variable makes of the names on its joint: which are kept, doubted or taken back.

Names are taken back where effects only imitate a curve: where it explains as much as several of them, or more, and
predicts held-out data on another motion better for certain. What together has the form of something else along one
motion has it less along another, while effects that are there predict as well as a curve that follows them all. Where
no held-out data tell, it must explain far more. A single effect that leaves little keeps its name, and what is kept
though a curve explains more is doubted: its form is another one. A spring and the constant of its rest are a single
effect.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, Diagnostic
from fmu_didim.base.errors import SimulationError
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.augmentation.places import Proposal
from fmu_didim.discovery.form.curve import FoundCurve, fitted_curve, tried_curves
from fmu_didim.discovery.judge import REMAINDER
from fmu_didim.discovery.ladder.facts import new_in
from fmu_didim.discovery.ladder.motions import MOSTLY_NEW
from fmu_didim.discovery.progress import Progress
from fmu_didim.discovery.rest import rests
from fmu_didim.discovery.selection.beside_others import beside_others
from fmu_didim.discovery.selection.competition import proposal_of
from fmu_didim.discovery.selection.decide import Options, nearness
from fmu_didim.discovery.selection.held_out import HELD_OUT, unconfirmed
from fmu_didim.discovery.selection.rounds import Discovery
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.gap import bic_gain, held_out_ratio, joint_gaps
from fmu_didim.fit.solver.least_squares import minimise
from fmu_didim.fit.solver.termination import Stopping
from fmu_didim.model.loop_model import EffectAtJoint, LoopModel

FORM_DIFFERS = CATALOGUE(
    "form-differs", DOUBT, rank=56,
    meaning="A curve of one variable explains far more than the effect that was named on its joint, or more than "
    "several together, but that leaves little, or held-out data do not prefer the curve for certain: an effect has "
    "another form than that of the catalogue, or something else looks like it. A curve that held-out data refuse is "
    "not shown: the fitted log has something that they have not.",
    next_step="Look at the curve in the report, whose robot description has it in the place of the effect; without "
    "one, at what happened in the fitted log alone.",
)  # fmt: skip
LEAD = 1.2
"""[1] Gain in BIC of a curve over that of several effects named on its joint, from which it explains far more: one
cause in the place of several, where no held-out data on another motion decide. On blind cases what imitates effects of
no catalogue is left behind by 1.01 to 8 times, two or three effects that are there by up to 2.6 times. The interval of
the held-out RMS with the curve over that with the names ends at 0.81 to 0.99 with the former, at 1.00 to 2.6 with the
latter."""
LEAD_ALONE = 1.3
"""[1] The same over that of a single effect: a curve follows what else depends on its variable, too. Hidden effects, in
forms of their own and beside clutter, are left behind by 0.01 to 1.23 times, a swell in time by 1.5 to 2.1 times."""
LEAD_SURE = 1.5
"""[1] The same from which a single effect of the machine that leaves much is none: a torque ripple beside another one
is left behind by 1.42 or 1.5 times, a hump or a notch called something else by 1.7 to 65 times; with the curve the RMS
of held-out data is 1.03 times that with such a ripple, and 0.60 to 0.92 times that with such an imitator."""


@dataclass(frozen=True)
class Forms:
    """What curves make of a discovery.

    Attributes:
        discovery: without the names that they take back; curves: that were found.
        doubts: about names that are kept; notes: where there is no curve.
    """

    discovery: Discovery
    curves: tuple[FoundCurve, ...] = ()
    doubts: tuple[Diagnostic, ...] = ()
    notes: tuple[str, ...] = ()


def with_curves(discovery: Discovery, builder: LoopModelBuilder, options: Options, progress: Progress) -> Forms:
    """Curves on each joint on which an effect was named, and on that with the largest remaining gap."""
    found = Forms(discovery)
    for joint in _joints(discovery, builder):
        if progress.is_time_up:
            break
        progress.say(f"the form of what is missing on joint {joint}")
        try:
            one = _on_joint(found.discovery, builder, options, joint)
        except SimulationError:
            continue
        both = ((*of, *further) for of, further in zip(_told(found), _told(one), strict=True))
        found = Forms(one.discovery, *both)
    return found


def instead_of_torques(
    builder: LoopModelBuilder, fit: Fit, joint: int, gain: float, *, seed: int
) -> tuple[bool, Diagnostic | None]:
    """Whether torques from outside on a joint, from 1, only imitate a curve, and the doubt that their form is another
    one, if they do not.

    A curve that holds on what was held out, too, is no event of one log: torques from outside have no beginning and no
    end then, which is all that would be said of them. Where it holds in the fitted log alone, they act once, as they
    are named, but their form is another one.

    Args:
        fit: without the torques; gain: theirs in BIC.
    """
    try:
        ranked = sorted(tried_curves(builder, fit, joint), key=lambda one: -one.delta_bic)
        if not ranked or ranked[0].delta_bic <= LEAD_ALONE * gain:
            return False, None
        curve = fitted_curve(builder, fit, ranked)
        if curve is None or curve.delta_bic <= LEAD_ALONE * gain:
            return False, None
        is_held_out = bool(fit.model.experiments.validation_labels)
        if is_held_out and not unconfirmed(fit, curve.fit, seed=seed):
            return True, None
    except SimulationError:
        return False, None
    text = (
        f"On the torques from outside a curve of {curve.tried.effect.variable} explains far more: BIC "
        f"{curve.delta_bic:.0f} against {gain:.0f}; {'what' if is_held_out else 'nothing'} was held out "
        f"{'does not' if is_held_out else 'that could'} have it."
    )
    return False, Diagnostic(FORM_DIFFERS, text, f"joint {joint}")


def _joints(discovery: Discovery, builder: LoopModelBuilder) -> list[int]:
    gap = joint_gaps(discovery.final.torque_alone.residual, discovery.final.torque_alone.noise)
    named = {step.effect_at.joint for step in discovery.steps if _of_machine(builder, step.effect_at)}
    left = {int(np.argmax(gap)) + 1} if gap.max() > REMAINDER else set()
    return sorted(named | left)


def _of_machine(builder: LoopModelBuilder, effect_at: EffectAtJoint) -> bool:
    return not builder.effect(effect_at).is_of_log


def _on_joint(discovery: Discovery, builder: LoopModelBuilder, options: Options, joint: int) -> Forms:
    final = discovery.final.torque_alone
    own = [s.effect_at for s in discovery.steps if s.effect_at.joint == joint and _of_machine(builder, s.effect_at)]
    constants = rests(own, builder)
    causes = [a for a in own if a not in constants]
    gap = joint_gaps(final.residual, final.noise)[joint - 1]
    before, named = final, 0.0
    if own:
        before = _without(builder, final, own)
        named = bic_gain(before, final, sum(builder.cost_in(final, a) for a in own), final.noise)
    ranked = sorted(tried_curves(builder, before, joint), key=lambda one: -one.delta_bic)
    if not ranked or ranked[0].delta_bic < _least(named, len(causes), options):
        tried = _listed([t.effect.variable for t in ranked])
        note = f"Joint {joint}: no curve of {tried} alone explains what remains."
        return Forms(discovery, notes=(note,) if ranked and not own and gap > REMAINDER else ())
    curve = fitted_curve(builder, before, ranked)
    if curve is None:
        return Forms(discovery)
    # What is too small for a name is fitted beside both, since a curve may follow it as well.
    small = _small_beside(discovery, builder, options, own) if own else []
    whole, named = _with(builder, small, final, named)
    beside, gain = _with(builder, small, curve.fit, curve.delta_bic)
    if gain < _least(named, len(causes), options):
        return Forms(discovery)
    variable = curve.tried.effect.variable
    is_far, is_ahead = gain > (LEAD if len(causes) > 1 else LEAD_ALONE) * named, gain >= named
    much = "far more" if is_far else "more" if is_ahead else "as much"
    told = f"explains {much}: BIC {gain:.0f} against {named:.0f}"
    if why := unconfirmed(before, curve.fit, seed=options.seed):
        note = (
            f"Joint {joint}: a curve of {variable} explains most of what was fitted, but not what was held out "
            f"({why}): it is not shown."
        )
        text = f"On {_all(own)} a curve of {variable} {told}; what was held out does not have it ({why})."
        doubts = (Diagnostic(FORM_DIFFERS, text, own[0].text),) if own and is_far else ()
        return Forms(discovery, doubts=doubts, notes=(note,) if is_ahead else ())
    lead, ratio = gain / named if named > 0 else np.inf, held_out_ratio(whole, beside, seed=options.seed)
    is_new = _is_other_motion(final.model)
    if own and ratio is not None:
        where = "" if is_new else ", on the motion of the fit, where either may be true"
        of_held_out = f"{ratio.value:.3f} times ({ratio.low:.3f} to {ratio.high:.3f})"
        told = f"{told}; the held-out RMS with it is {of_held_out} that with what was named{where}"
    predicts_better = ratio.high < HELD_OUT if ratio is not None and is_new else None
    are_external = [builder.effect(a).is_external for a in causes]
    if own and not imitates(are_external, gap, lead, predicts_better=predicts_better):
        if not is_ahead:
            return Forms(discovery)
        text = f"On {_all(own)} a curve of {variable} {told}."
        return Forms(discovery, (curve,), (Diagnostic(FORM_DIFFERS, text, own[0].text),))
    # What was found beside it, on other joints, may have filled the gaps that it leaves.
    left = [step for step in discovery.steps if step.effect_at not in own]
    filled = [s.effect_at for s in left if beside_others(builder, curve.fit, s.effect_at, options)[1]]
    final = _without(builder, before, filled) if filled else before
    nothing = f"beside a curve of {variable} on joint {joint} it explains nothing"
    taken = {**dict.fromkeys(own, f"a curve of {variable} {told}"), **dict.fromkeys(filled, nothing)}
    kept = tuple(step for step in left if step.effect_at in final.model.added_effects)
    refused = (*taken.items(), *discovery.refused)
    discovery = replace(discovery, final=final if taken else discovery.final, steps=kept, refused=refused)
    return Forms(discovery, (replace(curve, instead_of=tuple(taken)),))


def _least(named: float, causes: int, options: Options) -> float:
    """The least gain in BIC of a curve that may say something of what was named on its joint, by its gain."""
    return max(options.threshold, named - nearness(named, options) if causes > 1 else LEAD_ALONE * named)


def _small_beside(
    discovery: Discovery, builder: LoopModelBuilder, options: Options, own: Sequence[EffectAtJoint]
) -> list[Proposal]:
    """What is too small for a name on the joint of what was named: the best of what the last round refused for its
    size, and what bends the law of an effect that was named."""
    joint, named = own[0].joint, {a.effect for a in own}
    small = [proposal_of(c) for c in discovery.small if c.effect_at.joint == joint][:1]
    bends = [n for n, e in builder.effects.items() if e.bends in named and n not in named | options.forbid]
    return [*small, *(Proposal(EffectAtJoint(n, joint), {}) for n in bends)]


def _with(builder: LoopModelBuilder, small: Sequence[Proposal], fit: Fit, gain: float) -> tuple[Fit, float]:
    """A fit and its gain in BIC with those small effects that add to it."""
    for proposal in small:
        effect_at, added = proposal.effect_at, fit.model.added_effects
        if effect_at in added or not (builder.at(effect_at).can_be_added and builder.has_place(effect_at, added)):
            continue
        found = minimise(builder.build(fit.model, [proposal]), fit.noise, stopping=Stopping(updates=1))
        more = bic_gain(fit, found, builder.cost_in(found, effect_at), fit.noise)
        fit, gain = (found, gain + more) if more > 0 else (fit, gain)
    return fit, gain


def _is_other_motion(model: LoopModel) -> bool:
    """Whether all that was held out is on other motions than the fitted ones: on the same, a curve that also follows
    what else depends on its variable predicts better than effects that are there."""
    return all(new_in(model, label) >= MOSTLY_NEW for label in model.experiments.validation_labels)


def _without(builder: LoopModelBuilder, fit: Fit, effects: list[EffectAtJoint]) -> Fit:
    """The fit anew without some of its effects, and without what has no place beside the others."""
    model = fit.model
    for effect_at in effects:
        if effect_at in model.added_effects:
            model = builder.without(model, model.added_effects.index(effect_at))
    return minimise(model, fit.noise, stopping=Stopping(updates=1))


def imitates(are_external: Sequence[bool], gap: float, lead: float, *, predicts_better: bool | None) -> bool:
    """Whether effects on a joint that a curve leaves behind, or nearly so, only imitate it.

    Where held-out data on another motion tell, the curve must predict them better. Several effects imitate it then, or
    where nothing tells and it is far ahead; a single effect of the machine does if it is far behind and leaves much. A
    torque from outside is nothing but its beginning and its end: it imitates any curve that is far ahead.

    Args:
        are_external: of each cause, whether it stands for a torque from outside; gap: in units of the noise, that they
            leave; lead: gain in BIC of the curve over theirs, of several nearly one or more; predicts_better: whether
            the curve predicts held-out data better for certain, None where these do not tell.
    """
    if len(are_external) > 1:
        is_open = predicts_better is None or any(are_external)
        return predicts_better is True or (is_open and lead > LEAD)
    return any(are_external) or (gap > REMAINDER and lead > LEAD_SURE and predicts_better is not False)


def _told(found: Forms) -> tuple[tuple[Any, ...], ...]:
    return found.curves, found.doubts, found.notes


def _all(effects: Sequence[EffectAtJoint]) -> str:
    return " and ".join(one.text for one in effects)


def _listed(words: list[str]) -> str:
    return " or ".join(filter(None, (", ".join(words[:-1]), *words[-1:])))
