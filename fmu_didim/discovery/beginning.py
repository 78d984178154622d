"""What is looked for where data begin, beside gears, and what of that the data after it must say, too.

A start in another state than the simulation's is another transient, and may pass for effects that change how the loop
comes to its motion, such as gains of the controller. So these are asked for there only if the data after the start tell
them, but too little to be named, and hold there only with the values that those data ask for.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fmu_didim.data.signals import Array
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.selection.competition import Competition, fitted_proposal
from fmu_didim.discovery.selection.decide import BIC, TOO_SMALL, Step
from fmu_didim.discovery.selection.rounds import Discovery
from fmu_didim.dynamics.effects import Effect
from fmu_didim.fit.fit import Fit
from fmu_didim.model.loop_model import EffectAtJoint, LoopModel

FIRST_S = 0.25
"""[s] Left out at the beginning of each experiment: the initial state of the machine is not known (gears in their
play, friction's deflection, the loop before the first sample)."""
SAME_VALUES = 3.0
"""[standard deviations] By which the values of an effect may differ by data with their start and by those after it."""


def after_start(model: LoopModel) -> LoopModel:
    """The model with its experiments from ``FIRST_S`` on."""
    for label, experiment in model.experiments.items():
        model = model.with_experiment(label, experiment.after(FIRST_S))
    return model


def at_start(discovery: Discovery, effects: Mapping[str, Effect]) -> set[str]:
    """Names of the effects that a search without the start of the data has refused for their size alone, and that show
    most there."""
    small = {a.effect for a, reason in discovery.refused if reason.startswith(TOO_SMALL)}
    return {name for name in small if effects[name].shows_at_start}


def is_told_later(step: Step, of_start: Discovery, builder: LoopModelBuilder, later: Competition) -> bool:
    """Whether the data after their start tell an effect that was found with it, with the same values; what starts from
    a known state, such as a gear, need not show there.

    Args:
        step: of the search with the start of the data, ``of_start``, with its builder.
        later: beside the base model for the data after it.
    """
    effect_at = step.effect_at
    if builder.effect(effect_at).known_at_start:
        return True
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
