"""What each effect of a model explains beside all others: whether it is needed, and in which order effects are named.

The effect that is found first explains most beside the base alone. It may have stood for what another one explains
better, and stay for a rest of that: beside one factor of a command a lag makes up what two gains need that are off by
different factors. Such a rest goes if it is superfluous, gives way to an effect that explains more in its place, and
else is named after what explains more.

Source of the exchange: A. J. Miller, Subset selection in regression, 2nd edition, 2002, on sequential replacement.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from fmu_didim.base.errors import SimulationError
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.progress import Progress
from fmu_didim.discovery.screening.catalogue import SignatureCatalogue
from fmu_didim.discovery.selection.candidates import FittedCandidate
from fmu_didim.discovery.selection.competition import Competition
from fmu_didim.discovery.selection.decide import Options, Step, nearness, step_of
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.gap import bic_gain, explained_gap
from fmu_didim.fit.solver.least_squares import minimise
from fmu_didim.fit.solver.termination import Stopping
from fmu_didim.model.free_parameter import LOG
from fmu_didim.model.loop_model import EffectAtJoint, LoopModel

KEPT_GAIN = 0.5
"""[1] Fraction of the smallest gain that an effect must still have beside later ones."""
EXCHANGED = 2
"""[candidates] Fitted in the place of an effect: the first of those that promise more than it explains beside all
others."""
INSTEAD = "{0}: beside all others it explains more than {1}, which was found first, by a BIC difference of {2:.0f}."
"""Remark on an effect that has taken the place of another one."""


def fit_of_smaller(smaller: LoopModel, fit: Fit) -> Fit | None:
    """A model with some of the parameters of a fit, fitted from there; None where it cannot be simulated."""
    kept = [i for i, name in enumerate(fit.model.names) if name in smaller.names]
    try:
        return minimise(smaller, fit.noise, jacobian=fit.jacobian[:, :, kept], stopping=Stopping(updates=1))
    except SimulationError:
        return None


def fitted_to_minimum(builder: LoopModelBuilder, candidate: FittedCandidate) -> FittedCandidate:
    """A candidate that is added, at the minimum of its model, from which the next round starts: the fits of a
    competition are short. That of an elastic gear lies in a valley of its stiffness and the inertia of its motor."""
    is_long = any(builder.effect(a).elastic for a in candidate.fit.model.added_effects)
    stopping = Stopping(exact=True) if is_long else Stopping(updates=1, exact=True)
    return replace(candidate, fit=minimise(candidate.fit.model, candidate.fit.noise, stopping=stopping))


def fit_without(builder: LoopModelBuilder, fit: Fit, step: Step) -> Fit | None:
    """The fit without the effect of a step and what has no place without it, the known one where it lacks just that;
    None where it cannot be simulated."""
    smaller = builder.without(fit.model, fit.model.added_effects.index(step.effect_at))
    known = step.without
    if known is not None and set(known.model.added_effects) == set(smaller.added_effects):
        return known
    return fit_of_smaller(smaller, fit)


def beside_others(
    builder: LoopModelBuilder, fit: Fit, effect_at: EffectAtJoint, options: Options
) -> tuple[Fit | None, bool]:
    """The fit without one of its effects and what has no place without it, None where that cannot be simulated; and
    whether all else in the model has made them superfluous."""
    smaller = builder.without(fit.model, fit.model.added_effects.index(effect_at))
    without = fit_of_smaller(smaller, fit)
    if without is None:
        return None, False
    gone = [a for a in fit.model.added_effects if a not in smaller.added_effects]
    gain = bic_gain(without, fit, sum(builder.at(a).cost for a in gone), fit.noise)
    size, _ = explained_gap(without, fit, fit.noise)
    return without, gain < options.threshold or size < KEPT_GAIN * options.smallest_gain


def without_superfluous(
    builder: LoopModelBuilder, fit: Fit, steps: list[Step], options: Options, progress: Progress
) -> tuple[Fit, list[Step]]:
    """The fit and its steps without the effects that the newest one has made superfluous."""
    for step in steps[:-1]:
        if step.effect_at not in fit.model.added_effects:
            continue
        without, is_superfluous = beside_others(builder, fit, step.effect_at, options)
        if without is None:
            continue
        if is_superfluous:
            progress.say(f"taken out again: {step.effect_at.effect} on joint {step.effect_at.joint}")
            fit = minimise(without.model, fit.noise)
            steps = [s for s in steps if s.effect_at in fit.model.added_effects]
        else:
            steps = [replace(s, without=without) if s is step else s for s in steps]
    return fit, steps


def shifts_log(fit: Fit) -> bool:
    """Whether the model of a fit shifts the clock of the log, so that it is compared at other instants."""
    return any(parameter.owner == LOG for parameter in fit.model.free_parameters)


def exchanged(
    builder: LoopModelBuilder, catalogue: SignatureCatalogue, fit: Fit, steps: Sequence[Step],
    judge: Callable[[Competition], Callable[..., object]], options: Options, progress: Progress,
) -> tuple[Fit, list[Step]] | None:  # fmt: skip
    """The model and its steps with another effect in the place of one, which explains more beside all others; None if
    there is none.

    Args:
        catalogue: the signatures of all candidates; judge: what decides between candidates beside the model of a
            competition: a ranking -> the one to add, or the objections to all.
    """
    for step in reversed(by_importance(steps, fit, builder)) if len(steps) > 1 else ():
        without = fit_without(builder, fit, step)
        if without is None or len(without.model.added_effects) < len(fit.model.added_effects) - 1:
            continue
        if shifts_log(without) != shifts_log(catalogue.fit):  # its signatures are at other samples
            continue
        others = Competition(builder, without)
        named = others.assess(step.effect_at, fit)
        least = named.delta_bic + nearness(named.delta_bic, options)
        promising = [
            s for s in others.screen(catalogue)
            if s.effect_at not in fit.model.added_effects and s.predicted > least
            and builder.has_place(s.effect_at, without.model.added_effects)
            and not _may_stand_for_named(builder, s.effect_at, fit)
        ]  # fmt: skip
        if not promising or progress.is_time_up:
            continue
        progress.say(f"what may be in the place of {step.effect_at.effect} on joint {step.effect_at.joint}")
        comparison = others.compare(
            sorted(promising, key=lambda s: -s.predicted)[:EXCHANGED], progress=progress, reach=np.inf
        )
        ranking = sorted((named, *comparison.ranking), key=lambda c: -c.delta_bic)
        found = judge(others)(ranking)
        if not isinstance(found, FittedCandidate) or found.effect_at == step.effect_at or found.delta_bic <= least:
            continue
        found = fitted_to_minimum(builder, found)
        new = step_of(found, ranking, others, options)
        titles = (f"{builder.effect(a).title} on joint {a.joint}" for a in (found.effect_at, step.effect_at))
        remark = INSTEAD.format(*titles, found.delta_bic - named.delta_bic)
        new = replace(new, remark=" ".join(filter(None, (new.remark, remark))))
        progress.say(f"added instead: {found.effect_at.effect} on joint {found.effect_at.joint}")
        return without_superfluous(builder, found.fit, [*(s for s in steps if s is not step), new], options, progress)
    return None


def _may_stand_for_named(builder: LoopModelBuilder, effect_at: EffectAtJoint, fit: Fit) -> bool:
    """Whether an effect may only stand for what a model has on its joint, as a stop for a spring."""
    named = {a.effect for a in fit.model.added_effects if a.joint == effect_at.joint}
    return bool(named & set(builder.effect(effect_at).stands_for))


def by_importance(steps: Sequence[Step], fit: Fit, builder: LoopModelBuilder) -> tuple[Step, ...]:
    """The steps of a fit, those first without whose effect its BIC is worst, all else fitted anew; what cannot be
    simulated without comes before all."""
    if len(steps) < 2:
        return tuple(steps)

    def explained(step: Step) -> float:
        without = fit_without(builder, fit, step)
        if without is None:
            return np.inf
        gone = [a for a in fit.model.added_effects if a not in without.model.added_effects]
        return bic_gain(without, fit, sum(builder.at(a).cost for a in gone), fit.noise)

    return tuple(sorted(steps, key=explained, reverse=True))
