"""The pre-check for effects to which linear screening is blind, such as a limit of the torque."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from fmu_didim.base.errors import SimulationError
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.augmentation.places import Proposal
from fmu_didim.discovery.progress import Progress
from fmu_didim.discovery.selection.candidates import FittedCandidate
from fmu_didim.discovery.selection.competition import Competition
from fmu_didim.discovery.selection.decide import Options, Step, objection, step_of
from fmu_didim.discovery.selection.held_out import FAILS_HELD_OUT, FEW_BLOCKS
from fmu_didim.dynamics.effects import PreCheck
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.gap import held_out_blocks, held_out_ratio, total_gap
from fmu_didim.model.loop_model import EffectAtJoint, LoopModel
from fmu_didim.model.workers import side_by_side

FITTED = 4
"""[trials] The best ones, whose joints are fitted."""
PROMISING = 0.9
"""[1] Fraction of the chi-square of the base model below which the best trial must come."""
WORSE = 1.02
"""[1] Held-out RMS ratio beyond which data that do not reach the value still contradict it; the base parameters, which
are fitted along, make a little of it."""


def pre_check(builder: LoopModelBuilder, base: Fit, options: Options, progress: Progress) -> tuple[Fit, list[Step]]:
    """The base model, or one with effects, with the effects of the pre-check, and a step for each of them.

    Values at upper quantiles of the measured torque of each joint are tried in full simulations.
    """
    fit, steps = base, []
    for name, effect in builder.effects.items():
        if effect.pre_check is None or name in options.forbid:
            continue
        progress.say(f"{'looked for again' if fit.model.added_effects else 'pre-check'}: {effect.class_name}")
        found = _checked(name, effect.pre_check, Competition(builder, fit), options, progress)
        if found is not None:
            step, fit = found
            steps.append(step)
    return fit, steps


def may_be_promising(fit: Fit) -> bool:
    """Whether the gap of a fit is so large that a trial may explain enough of its chi-square without explaining noise:
    of n samples of unit noise it is n (1 + gap^2), and n gap^2 at most can go."""
    gap = total_gap(fit.residual, fit.noise)
    return gap**2 >= (1 - PROMISING) * (1 + gap**2)


def _checked(
    name: str, check: PreCheck, competition: Competition, options: Options, progress: Progress
) -> tuple[Step, Fit] | None:
    """The effect on the joint where it explains most, with the model refitted; None if it is not accepted."""
    fit = competition.fit
    tried = _tried(name, check, competition)
    cost = float(np.sum((fit.residual * fit.noise.weight) ** 2))
    if not tried or tried[0][0] > PROMISING * cost:
        return None
    found: list[FittedCandidate] = []
    for effect_at in dict.fromkeys(a for _, a, _ in tried[:FITTED]):
        value = next(v for _, a, v in tried if a == effect_at)
        start = {check.parameter: value}
        fitted = competition.refit(Proposal(effect_at, start, start))
        if fitted is not None:
            found.append(competition.assess(effect_at, fitted))
    if not found:
        return None
    found.sort(key=lambda c: -c.delta_bic)
    best = found[0]
    reason, remark = objection(best, fit, options, base=fit), ""
    if reason.startswith(FAILS_HELD_OUT) and not _held_out_tells(best, competition, options):
        reason = ""
        remark = (
            f"{name} on joint {best.effect_at.joint}: the held-out experiment hardly reaches the {check.parameter} and "
            "neither confirms nor contradicts it; only the estimation data decided."
        )
    if reason:
        return None
    progress.say(f"added: {name} on joint {best.effect_at.joint}")
    step = step_of(best, found, competition, options)
    return (replace(step, remark=remark, untested=True) if remark else step), best.fit


def _tried(name: str, check: PreCheck, competition: Competition) -> list[tuple[float, EffectAtJoint, float]]:
    """Sum of squares, joint and value of each trial, the best first."""
    builder, fit = competition.builder, competition.fit
    measured = fit.model.measured

    def misfit(model: LoopModel) -> float | None:
        try:
            return float(np.sum((model.output_residual(model.start) * fit.noise.weight) ** 2))
        except SimulationError:
            return None

    candidates = (EffectAtJoint(name, joint) for joint in builder.joints(name))
    tried = [
        (effect_at, float(np.quantile(np.abs(measured[:, effect_at.joint - 1]), quantile)))
        for effect_at in candidates
        if builder.at(effect_at).can_be_added and effect_at not in fit.model.added_effects
        for quantile in check.quantiles
    ]
    models = [builder.build(fit.model, [Proposal(effect_at, {check.parameter: value})]) for effect_at, value in tried]
    misfits = side_by_side([partial(misfit, model) for model in models], fit.model.allowed_workers(fit.values))
    trials = [(square, *trial) for square, trial in zip(misfits, tried, strict=True) if square is not None]
    return sorted(trials, key=lambda t: t[0])


def _held_out_tells(candidate: FittedCandidate, competition: Competition, options: Options) -> bool:
    """Whether the held-out experiment reaches the value, so often that the effect must show there, or contradicts it:
    reached a few times, it may not show for sure, but the prediction must be better."""
    fit = competition.fit
    ratio = held_out_ratio(fit, candidate.fit, seed=options.seed)
    if competition.change_without(candidate.effect_at, candidate.fit, held_out=True) < options.smallest_size:
        return ratio is None or ratio.low > WORSE
    return ratio is None or ratio.value >= 1 or held_out_blocks(fit, candidate.fit) >= FEW_BLOCKS
