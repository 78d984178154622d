"""What each effect of a model explains beside all others: whether it is needed, and in which order effects are named.

The effect that is found first explains most beside the base alone. It may have stood for what another one explains
better, and stay for a rest of that: beside one factor of a command a lag makes up what two gains need that are off by
different factors. Such a rest goes if it is superfluous, gives way to an effect that explains more in its place
(:mod:`~fmu_didim.discovery.selection.rivals`), and else is named after what explains more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fmu_didim.base.errors import SimulationError
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.progress import Progress
from fmu_didim.discovery.rest import rests
from fmu_didim.discovery.selection.candidates import FittedCandidate
from fmu_didim.discovery.selection.decide import Options, Step
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.gap import bic_gain, explained_gap
from fmu_didim.fit.solver.least_squares import minimise
from fmu_didim.fit.solver.termination import Stopping
from fmu_didim.model.free_parameter import LOG
from fmu_didim.model.loop_model import EffectAtJoint, LoopModel

KEPT_GAIN = 0.5
"""[1] Fraction of the smallest gain that an effect must still have beside later ones."""


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
    model = builder.settled(candidate.fit).model
    return replace(candidate, fit=minimise(model, candidate.fit.noise, stopping=stopping))


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
    gain = bic_gain(without, fit, sum(builder.cost_in(fit, a) for a in gone), fit.noise)
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


def by_importance(steps: Sequence[Step], fit: Fit, builder: LoopModelBuilder) -> tuple[Step, ...]:
    """The steps of a fit, those first without whose effect its BIC is worst, all else fitted anew; what cannot be
    simulated without comes before all, and what is only where another one rests comes after that."""
    if len(steps) < 2:
        return tuple(steps)

    def explained(step: Step) -> float:
        without = fit_without(builder, fit, step)
        if without is None:
            return np.inf
        gone = [a for a in fit.model.added_effects if a not in without.model.added_effects]
        return bic_gain(without, fit, sum(builder.cost_in(fit, a) for a in gone), fit.noise)

    return _rests_last(sorted(steps, key=explained, reverse=True), builder)


def _rests_last(steps: Sequence[Step], builder: LoopModelBuilder) -> tuple[Step, ...]:
    """The steps in this order, but where one rests only after the one that rests there."""
    named = [step.effect_at for step in steps]
    causes = rests(named, builder)

    def place(step: Step) -> tuple[int, bool]:
        own = named.index(step.effect_at)
        cause = named.index(causes.get(step.effect_at, step.effect_at))
        return max(own, cause), cause > own

    return tuple(sorted(steps, key=place))
