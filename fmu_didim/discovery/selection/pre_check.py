"""The pre-check for effects to which linear screening is blind, such as a limit of the torque."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from fmu_didim.base.errors import SimulationError
from fmu_didim.data.signals import Array
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.augmentation.places import Proposal
from fmu_didim.discovery.progress import Progress
from fmu_didim.discovery.selection.candidates import FittedCandidate
from fmu_didim.discovery.selection.competition import Competition
from fmu_didim.discovery.selection.decide import Options, Step, nearness, objection, step_of, with_in_set
from fmu_didim.discovery.selection.held_out import FAILS_HELD_OUT, FEW_BLOCKS
from fmu_didim.dynamics.effects import PreCheck
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.gap import held_out_blocks, held_out_ratio, total_gap
from fmu_didim.fit.solver.least_squares import minimise
from fmu_didim.fit.solver.termination import Stopping
from fmu_didim.model.loop_model import EffectAtJoint, LoopModel
from fmu_didim.model.motion import joint_reference
from fmu_didim.model.simulated_table import motion_at_samples, simulated_table
from fmu_didim.model.workers import side_by_side

FITTED = 4
"""[trials] The best ones, whose joints are fitted."""
WORTH_A_TRIAL = 0.002
"""[1] Fraction of the chi-square that clipping the simulated torque along a line must take away for full simulations.
On blind cases that hide such a limit it took away 0.004 to 0.07, because base parameters have made up for a part and
what a loop does after a limit is not in it; where no drive is at a limit 0 to 0.004."""
LINES = 4
"""[trials] Of limits that fall, on one joint: of those that promise most and of those on which most samples lie."""
ON_LINE = 2.0
"""[standard deviations] Of the noise within which a sample lies on a line: a drive at its limit logs the limit."""
STARTS = 4
"""[trials] From which a limit that falls is fitted: stall and speed lie in a valley, whose ground is not smooth where
samples come to the limit or leave it."""
APART = 1.25
"""[1] Ratio of the speeds of two of them."""
VALLEYS = 2
"""[fits] That go on to the end of the valley, the best ones."""
STEPS = 40
"""[steps] Of such a fit at most."""
ALONG_VALLEY = Stopping(iterations=STEPS, updates=None, exact=True)
PROMISING = 0.9
"""[1] Fraction of the chi-square of the base model below which the best trial must come."""
WORSE = 1.02
"""[1] Held-out RMS ratio beyond which data that do not reach the value still contradict it; the base parameters, which
are fitted along, make a little of it."""
HARDLY_REACHED = (
    "{0} on joint {1}: the held-out experiment hardly reaches the {2} and neither confirms nor contradicts it; only "
    "the estimation data decided."
)
NOT_TOLD = "{0}: held-out data do not tell it from {1}; the fitted data do, by a BIC difference of {2:.0f}."
"""Remark on a limit that falls with the speed where held-out data reach it at one speed, or hardly."""
CONFIRMED_BY_OTHER = (
    "{0} on joint {1}: held-out data confirm the limit only in its other form, {2}, from which they do not tell it; "
    "the fitted data prefer the constant one by a BIC difference of {3:.0f}."
)
"""Remark on a constant limit that explains the fitted data better than one that falls with the speed."""


@dataclass(frozen=True)
class Trial:
    """One limit that was tried.

    Attributes:
        square: weighted sum of squares of what is left with it; values: of its parameters, by their plain names.
    """

    square: float
    effect_at: EffectAtJoint
    values: Mapping[str, float]


def pre_check(builder: LoopModelBuilder, base: Fit, options: Options, progress: Progress) -> tuple[Fit, list[Step]]:
    """The base model, or one with effects, with the effects of the pre-check, and a step for each of them.

    Constant limits at upper quantiles of the measured torque of each joint are tried in full simulations; limits that
    fall with the speed where they promise something. Effects of one class compete.
    """
    fit, steps = base, []
    classes: dict[str, dict[str, PreCheck]] = {}
    for name, effect in builder.effects.items():
        if effect.pre_check is not None and name not in options.forbid:
            classes.setdefault(effect.class_name, {})[name] = effect.pre_check
    for class_name, checks in classes.items():
        progress.say(f"{'looked for again' if fit.model.added_effects else 'pre-check'}: {class_name}")
        found = _checked(checks, Competition(builder, fit), options, progress)
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
    checks: Mapping[str, PreCheck], competition: Competition, options: Options, progress: Progress
) -> tuple[Step, Fit] | None:
    """The limit on the joint where it explains most, with the model refitted; None if none is accepted."""
    enough = PROMISING * _square(competition.fit.residual, competition.fit)
    tried = {name: _tried(name, check, competition) for name, check in checks.items() if not check.speed}
    limited = {t.effect_at.joint for trials in tried.values() for t in trials if t.square <= enough}
    tried |= {name: _tried(name, check, competition, limited) for name, check in checks.items() if check.speed}
    limited |= {t.effect_at.joint for trials in tried.values() for t in trials if t.square <= enough}
    found: list[FittedCandidate] = []
    for trials in tried.values():
        best = trials[:FITTED] if trials and trials[0].square <= enough else []
        # Whether one of the class may stand for another that is promising on a joint, only its fit tells.
        beside = (t for t in trials if len(tried) > 1 and t.effect_at.joint in limited)
        for effect_at in dict.fromkeys(t.effect_at for t in (*best, *beside)):
            fitted = _fitted(effect_at, [t for t in trials if t.effect_at == effect_at], competition)
            if fitted is not None:
                found.append(competition.assess(effect_at, fitted))
    found.sort(key=lambda c: -c.delta_bic)
    accepted = _accepted(found, competition, options)
    if accepted is None:
        return None
    progress.say(f"added: {accepted.candidate.effect_at.effect} on joint {accepted.candidate.effect_at.joint}")
    step = step_of(accepted.candidate, found, competition, options)
    if accepted.remark:
        step = replace(step, remark=" ".join(filter(None, (step.remark, accepted.remark))), untested=accepted.untested)
    if accepted.other_form is not None:
        step = with_in_set(step, [(accepted.other_form, accepted.other_form.delta_bic - accepted.candidate.delta_bic)])
    return step, accepted.candidate.fit


def _fitted(effect_at: EffectAtJoint, trials: Sequence[Trial], competition: Competition) -> Fit | None:
    """The model with a limit, fitted from its best trial; one that falls from several, and to the end of its valley."""
    check = competition.builder.effect(effect_at).pre_check
    if check is None or not check.speed:
        return competition.refit(Proposal(effect_at, trials[0].values, trials[0].values))
    proposals = (Proposal(effect_at, t.values, t.values) for t in apart(trials, check.speed))
    fits = [fit for fit in map(competition.refit, proposals) if fit is not None]
    fits.sort(key=lambda fit: fit.chi_square)
    fits += [minimise(fit.model, competition.fit.noise, stopping=ALONG_VALLEY) for fit in fits[:VALLEYS]]
    return min(fits, key=lambda fit: fit.chi_square, default=None)


def apart(trials: Sequence[Trial], speed: str) -> list[Trial]:
    """The best trials of a limit that falls whose speeds are apart, from the best on."""
    found: list[Trial] = []
    for trial in trials:
        ratios = (trial.values[speed] / other.values[speed] for other in found)
        if len(found) < STARTS and all(max(ratio, 1 / ratio) >= APART for ratio in ratios):
            found.append(trial)
    return found


@dataclass(frozen=True)
class _Judged:
    """A limit with the objection to it, or a remark on why there is none; whether held-out data tell nothing of it; the
    other form of it, which fits worse, but from which held-out data do not tell it."""

    candidate: FittedCandidate
    reason: str = ""
    remark: str = ""
    untested: bool = False
    other_form: FittedCandidate | None = None


def _accepted(found: Sequence[FittedCandidate], competition: Competition, options: Options) -> _Judged | None:
    """The limit to add; None where all are refused.

    Of each effect the joint counts where it explains most. A limit that falls gives way to a constant one of its joint
    that explains the data as well, or that held-out data prefer. A constant one that explains the fitted data better
    need not be confirmed by itself: it is enough that held-out data confirm the other one and do not tell them apart.
    """
    best: dict[str, FittedCandidate] = {}
    for candidate in found:
        best.setdefault(candidate.effect_at.effect, candidate)
    judged = [_judged(candidate, competition, options) for candidate in best.values()]
    allowed = [one for one in judged if not one.reason]
    if not allowed:
        return None
    first = allowed[0]
    for other in found:
        if other.effect_at.joint == first.candidate.effect_at.joint and other.cost < first.candidate.cost:
            simpler, remark = _instead(first, other, competition, options)
            if simpler is not None:
                return simpler
            first = replace(first, remark=first.remark or remark)
    return first


def _instead(
    first: _Judged, other: FittedCandidate, competition: Competition, options: Options
) -> tuple[_Judged | None, str]:
    """The constant limit that is named in the place of one that falls, or None and a remark on the latter."""
    falls, simpler = first.candidate, _judged(other, competition, options)
    ahead, near = falls.delta_bic - other.delta_bic, nearness(falls.delta_bic, options)
    ratio = held_out_ratio(other.fit, falls.fit, seed=options.seed)
    titles = [competition.builder.effect(c.effect_at).title for c in (other, falls)]
    if simpler.reason:
        is_told = ratio is not None and ratio.high < 1
        if not simpler.reason.startswith(FAILS_HELD_OUT) or ahead >= -near or is_told:
            return None, ""
        remark = CONFIRMED_BY_OTHER.format(titles[0], other.effect_at.joint, titles[1].lower(), -ahead)
        return _Judged(other, "", remark, other_form=falls), ""
    if ahead <= near or (ratio is not None and ratio.low > 1):
        return simpler, ""
    is_open = ratio is not None and ratio.high >= 1
    return None, NOT_TOLD.format(falls.effect_at.text, titles[0].lower(), ahead) if is_open else ""


def _judged(candidate: FittedCandidate, competition: Competition, options: Options) -> _Judged:
    fit, at = competition.fit, candidate.effect_at
    reason = objection(candidate, fit, options, base=fit)
    if not reason.startswith(FAILS_HELD_OUT) or _held_out_tells(candidate, competition, options):
        return _Judged(candidate, reason)
    check = competition.builder.effect(at).pre_check
    assert check is not None  # it was looked for by it
    what = check.parameter if not check.speed else "limit"
    return _Judged(candidate, "", HARDLY_REACHED.format(at.effect, at.joint, what), untested=True)


def _square(residual: Array, fit: Fit) -> float:
    """Weighted sum of squares of a residual (M, m) or of its torque."""
    return float(np.sum((residual * fit.noise.weight) ** 2))


def _tried(name: str, check: PreCheck, competition: Competition, limited: Collection[int] = ()) -> list[Trial]:
    """The trials of a limit, the best first.

    Args:
        limited: joints on which a constant limit is promising, where one that falls is tried in any case.
    """
    builder, fit = competition.builder, competition.fit

    def misfit(model: LoopModel) -> float | None:
        try:
            return _square(model.output_residual(model.start), fit)
        except SimulationError:
            return None

    class_name = builder.effects[name].class_name
    named = {a.joint for a in fit.model.added_effects if builder.effect(a).class_name == class_name}
    candidates = (EffectAtJoint(name, joint) for joint in builder.joints(name) if joint not in named)
    possible = [effect_at for effect_at in candidates if builder.at(effect_at).can_be_added]
    speeds = _velocities(fit) if check.speed and possible else None
    proposals = [
        Proposal(effect_at, values)
        for effect_at in possible
        for values in _values(check, fit, effect_at.joint, speeds, asked=effect_at.joint in limited)
    ]
    models = [builder.build(fit.model, [proposal]) for proposal in proposals]
    misfits = side_by_side([partial(misfit, model) for model in models], fit.model.allowed_workers(fit.values))
    trials = [
        Trial(square, p.effect_at, p.values) for square, p in zip(misfits, proposals, strict=True) if square is not None
    ]
    return sorted(trials, key=lambda t: t.square)


def _values(check: PreCheck, fit: Fit, joint: int, velocities: Array | None, *, asked: bool) -> list[dict[str, float]]:
    """The values of a limit that are worth a full simulation at a joint, counted from 1; see :class:`PreCheck`.

    Args:
        velocities: (N, n) of a limit that falls with the speed, None of a constant one.
        asked: whether the best lines are worth it, whatever they promise.
    """
    torque = np.abs(fit.model.measured[:, joint - 1])
    if velocities is None:
        return [{check.parameter: float(np.quantile(torque, quantile))} for quantile in check.quantiles]
    least = WORTH_A_TRIAL * _square(fit.residual, fit) / float(fit.noise.weight[joint - 1]) ** 2
    return lines(
        check, np.copysign(torque, fit.torque[:, joint - 1]), fit.torque[:, joint - 1], velocities[:, joint - 1],
        deviation=float(fit.noise.deviation[joint - 1]), least=-np.inf if asked else least,
    )  # fmt: skip


def lines(
    check: PreCheck, measured: Array, simulated: Array, velocity: Array, *, deviation: float, least: float
) -> list[dict[str, float]]:
    """Limits that fall with the speed, one for each speed that is tried, of those that promise most and of those along
    which most measured samples lie; none where clipping promises too little.

    Args:
        measured, simulated, velocity: (N,) at the samples of a joint; deviation: of the noise of the torque.
        least: part of the sum of squares that clipping the simulated torque along the best line must take away.
    """
    fastest = float(np.abs(velocity).max(initial=0.0))
    if check.speeds is None or fastest <= 0:
        return []
    before, found = float(np.sum((measured - simulated) ** 2)), list[tuple[float, int, dict[str, float]]]()
    for part in np.geomspace(check.speeds.lowest, check.speeds.highest, check.speeds.count).tolist():
        left = velocity / (part * fastest)
        drives = measured / (1 - left) > -measured / (1 + left)
        room = np.where(drives, 1 - left, 1 + left)
        at_rest = np.where(drives, measured, -measured) / room
        top = float(np.quantile(at_rest, check.quantiles[-1]))
        lies_on = np.abs(at_rest - top) * room < ON_LINE * deviation
        stalls = [*np.quantile(at_rest, check.quantiles), float(np.median(at_rest[lies_on])) if lies_on.any() else top]
        clipped = (np.clip(simulated, -stall * (1 + left), stall * (1 - left)) for stall in stalls)
        gains = [before - float(np.sum((measured - each) ** 2)) for each in clipped]
        best = int(np.argmax(gains))
        if stalls[best] > 0:
            limit = {check.parameter: float(stalls[best]), check.speed: part * fastest}
            found.append((gains[best], int(np.sum(lies_on)), limit))
    if max((gain for gain, *_ in found), default=0.0) < least:
        return []
    by_gain = sorted(range(len(found)), key=lambda i: -found[i][0])[:LINES]
    by_count = sorted(range(len(found)), key=lambda i: (-found[i][1], -found[i][0]))[:LINES]
    return [found[i][2] for i in dict.fromkeys((*by_gain, *by_count))]


def _velocities(fit: Fit) -> Array:
    """(N, n) velocities of the joints at the samples that are fitted: as simulated, else of the reference."""
    found = []
    for label in fit.model.estimation_labels:
        run = fit.simulation(label)
        motion = motion_at_samples(run, simulated_table(run, motion=("q", "dq")))
        time, reference = run.experiment.time, run.experiment.reference
        columns = (
            motion[f"dq{j}"]
            if f"dq{j}" in motion
            else np.interp(time, reference.time, joint_reference(reference, j)[1])
            for j in range(1, fit.model.joint_count + 1)
        )
        found.append(np.column_stack(list(columns)))
    return np.concatenate(found)


def _held_out_tells(candidate: FittedCandidate, competition: Competition, options: Options) -> bool:
    """Whether the held-out experiment reaches the value, so often that the effect must show there, or contradicts it:
    reached a few times, it may not show for sure, but the prediction must be better."""
    fit = competition.fit
    ratio = held_out_ratio(fit, candidate.fit, seed=options.seed)
    if competition.change_without(candidate.effect_at, candidate.fit, held_out=True) < options.smallest_size:
        return ratio is None or ratio.low > WORSE
    return ratio is None or ratio.value >= 1 or held_out_blocks(fit, candidate.fit) >= FEW_BLOCKS
