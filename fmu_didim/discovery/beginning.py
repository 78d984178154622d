"""What is looked for where data begin, and what of that the data after it must say, too.

In the simulation a gear begins in the middle of its play and without load, and what it does from there shows its play
best: the load comes on at once. Gears are looked for there where the data after it name nothing
and either disagree less than those or lack held-out data that confirm a gear, and where they name a gear but do not
tell whether it has play. What only the beginning tells rests on that start, which is a doubt. A limit of the torque is
mostly reached where a loop comes to its motion: it is looked for there, too, but holds only with the value that the
data after it ask for.

A start in another state than the simulation's is another transient, and may pass for effects that change how the loop
comes to its motion, such as gains of the controller. So these are asked for there only if the data after the start tell
them, but too little to be named, and hold there only with the values that those data ask for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, Diagnostic
from fmu_didim.data.signals import Array
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.selection.competition import Competition, fitted_proposal
from fmu_didim.discovery.selection.decide import BIC, TOO_SMALL, Step
from fmu_didim.discovery.selection.held_out import FAILS_HELD_OUT
from fmu_didim.discovery.selection.rivals import EFFECT_AMBIGUOUS
from fmu_didim.discovery.selection.rounds import Discovery
from fmu_didim.dynamics.effects import Effect
from fmu_didim.fit.fit import Fit
from fmu_didim.model.loop_model import EffectAtJoint, LoopModel

FIRST_S = 0.25
"""[s] Left out at the beginning of each experiment: the initial state of the machine is not known (gears in their
play, friction's deflection, the loop before the first sample)."""
GEAR_BY_START = CATALOGUE(
    "gear-by-start", DOUBT, rank=56,
    meaning="A gear is named by what it does where the data begin, and the data after it do not tell it. There the "
    "simulation has it in the middle of its play and without load, and that of a machine need not be.",
    next_step="Run a motion that loads the gear both ways again and again, and analyse both logs together.",
)  # fmt: skip
SAME_VALUES = 3.0
"""[standard deviations] By which the values of an effect may differ by data with their start and by those after it."""


def after_start(model: LoopModel) -> LoopModel:
    """The model with its experiments from ``FIRST_S`` on."""
    for label, experiment in model.experiments.items():
        model = model.with_experiment(label, experiment.after(FIRST_S))
    return model


def always_at_start(effects: Mapping[str, Effect]) -> set[str]:
    """Names of what starts in a known state, such as gears, and of limits, which have none and show most there."""
    limits = {name for name, effect in effects.items() if effect.pre_check is not None and effect.shows_at_start}
    return limits | {name for name, effect in effects.items() if effect.known_at_start}


def at_start(discovery: Discovery, effects: Mapping[str, Effect]) -> set[str]:
    """Names of the effects that a search without the start of the data has refused for their size alone, and that show
    most there."""
    small = {a.effect for a, reason in discovery.refused if reason.startswith(TOO_SMALL)}
    return {name for name in small if effects[name].shows_at_start}


def unconfirmed_gears(discovery: Discovery, effects: Mapping[str, Effect]) -> bool:
    """Whether a search without the start of the data has refused a gear on account of held-out data alone: with their
    start both logs say more."""
    gears = (reason for a, reason in discovery.refused if effects[a.effect].known_at_start)
    return any(reason.startswith(FAILS_HELD_OUT) for reason in gears)


def untold_gears(steps: Sequence[Step], effects: Mapping[str, Effect]) -> dict[EffectAtJoint, EffectAtJoint]:
    """The gears that were found -> another kind of gear on their joint that explains the data after the start as
    well."""
    return {
        step.effect_at: rival
        for step in steps if effects[step.effect_at.effect].known_at_start
        for rival, _ in step.rivals
        if rival.joint == step.effect_at.joint and effects[rival.effect].known_at_start
    }  # fmt: skip


def is_settled_by_start(
    untold: Mapping[EffectAtJoint, EffectAtJoint], later: Sequence[Step], of_start: Sequence[Step]
) -> bool:
    """Whether a search with the start of the data names the rivals of such gears, with nothing else that explains them
    as well, beside all else that the data after it have told."""
    named = {step.effect_at: step for step in of_start}
    others = {step.effect_at for step in later} - set(untold)
    instead = [named.get(rival) for rival in untold.values()]
    return bool(untold) and others <= set(named) and all(s is not None and not s.rivals for s in instead)


@dataclass(frozen=True)
class AfterStart:
    """What the data after their start say of what a search with their start names.

    Attributes:
        competition: beside the base model for those data; untold: as of :func:`untold_gears`, of what was found there.
    """

    competition: Competition
    untold: Mapping[EffectAtJoint, EffectAtJoint] = field(default_factory=dict)

    def diagnostics(self, of_start: Discovery, builder: LoopModelBuilder) -> list[Diagnostic]:
        """The doubts about gears that the start alone tells, or tells from another kind."""
        found, instead = [], {rival: first for first, rival in self.untold.items()}
        for step in of_start.steps:
            effect, place = builder.effect(step.effect_at), step.effect_at.text
            if not effect.known_at_start:
                continue
            where = f"the gear of joint {step.effect_at.joint} begins in the middle of its play and without load"
            if (first := instead.get(step.effect_at)) is not None:
                text = f"{builder.effect(first).title} explains the data after their start as well; the start tells "
                found.append(Diagnostic(EFFECT_AMBIGUOUS, f"{text}{effect.title.lower()} from it if {where}.", place))
            elif not is_told_later(step, of_start, self.competition):
                text = f"The data after their start do not tell it; with their start they do if {where}."
                found.append(Diagnostic(GEAR_BY_START, text, place))
        return found


def is_told_later(step: Step, of_start: Discovery, later: Competition) -> bool:
    """Whether the data after their start tell an effect that was found with it, with the same values.

    Args:
        step: of the search with the start of the data, ``of_start``.
        later: beside the base model for the data after it.
    """
    effect_at = step.effect_at
    fit = later.refit(fitted_proposal(of_start.final, effect_at))
    if fit is None or later.assess(effect_at, fit).delta_bic < BIC:
        return False
    (values, deviations), (others, of_others) = (_values(one, effect_at) for one in (of_start.final, fit))
    return bool((np.abs(values - others) <= SAME_VALUES * np.hypot(deviations, of_others)).all())


def _values(fit: Fit, effect_at: EffectAtJoint) -> tuple[Array, Array]:
    """(k,) values of an effect and (k,) their standard deviations."""
    index = fit.model.added_effects.index(effect_at)
    own = [i for i, p in enumerate(fit.model.free_parameters) if p.effect == index]
    return fit.values[own], np.sqrt(np.diag(fit.covariance)[own])
