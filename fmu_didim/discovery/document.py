"""The outcome of discovery written down: the content of ``findings.json``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from fmu_didim.base.errors import SimulationError
from fmu_didim.checks.judgement import Judgement
from fmu_didim.checks.power.moves import with_power
from fmu_didim.data.signals import Array
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.form.curve import FoundCurve
from fmu_didim.discovery.friction import friction_curves
from fmu_didim.discovery.harmonics import origin
from fmu_didim.discovery.judge import answer_of, judged
from fmu_didim.discovery.localise import force_windows
from fmu_didim.discovery.request import Request
from fmu_didim.discovery.rest import part_of
from fmu_didim.discovery.selection.decide import Step
from fmu_didim.discovery.selection.refitted import Refitted
from fmu_didim.discovery.selection.rounds import Discovery, Ending
from fmu_didim.discovery.unfinished import unfinished_search
from fmu_didim.discovery.untried import EFFECTS_UNTRIED
from fmu_didim.dynamics.effects import EFFECTS
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.fit_uncertainty import fit_uncertainty
from fmu_didim.fit.gap import Ratio, channel_gaps, explained_gap, gaps, held_out_ratio, joint_gaps, total_gap
from fmu_didim.fit.noise.noise import Noise
from fmu_didim.fit.statistics import confidence_interval, relative_error_percent
from fmu_didim.model.experiment import Experiment
from fmu_didim.model.free_parameter import FreeParameter
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.results.findings import (
    ANSWER_TEXT,
    UNTRIED_TEXT,
    Answer,
    CandidateResult,
    ChannelResult,
    CurveResult,
    FindingResult,
    FindingsDocument,
    GapPair,
    NoiseResult,
    RegionResult,
    Rival,
    RungResult,
    ValueFound,
    WindowResult,
)

Residuals = dict[str, tuple[Array, Array]]
"""Label of each experiment -> residuals (N, n) of the base and of the final model."""


def findings_document(
    request: Request,
    discovery: Discovery,
    builder: LoopModelBuilder,
    *,
    ratio: Ratio | None,
    notes: Sequence[str],
    outside: Sequence[FindingResult],
    windows: Sequence[WindowResult],
    regions: Sequence[RegionResult],
    ladders: Sequence[Sequence[RungResult]] = (),
    curves: Sequence[FoundCurve] = (),
) -> FindingsDocument:
    """Everything that was found, with intervals and gaps.

    Args:
        ratio: of the held-out RMS of final and base model, None if nothing was added or held out.
        outside: torques from outside, which come first; windows: when they acted.
        regions: where the base model disagrees.
        ladders: of what was found, shapes that were fitted anew first; none while the search goes on.
        curves: of what is missing and has no name.
    """
    residuals = residuals_of(discovery.base, discovery.final)
    unfinished_diagnostic, unfinished = unfinished_search(discovery, request.progress.limit_s)
    judgement, misfits = judged(discovery, unfinished_diagnostic, request.doubts)
    answer: Answer = "unfinished" if unfinished is not None else answer_of(discovery, judgement)
    judgement, power = with_power(judgement.acknowledging(request.acknowledged), discovery.final.torque_alone, misfits)
    base, noise = discovery.base, discovery.base.torque_alone.noise
    is_untried = EFFECTS_UNTRIED in {doubt.code for doubt in request.doubts}
    return FindingsDocument(
        name=request.name,
        answer=answer,
        text=UNTRIED_TEXT if answer == "unknown" and is_untried else ANSWER_TEXT[answer],
        verdict=judgement.verdict,
        reasons=judgement.saved(request.case),
        acknowledged=judgement.saved_acknowledged(request.case),
        conditions=judgement.conditions,
        power=power,
        unfinished=unfinished,
        findings=[*outside, *_with_ladders(discovery, builder, ladders)],
        roles={label: e.role for label, e in base.model.experiments.items()},
        gap={label: gap_pair(before, after, noise) for label, (before, after) in residuals.items()},
        error_percent=_errors(discovery, residuals, request.whole),
        ratio_interval=(ratio.low, ratio.high) if ratio is not None else None,
        noise=_noise(noise),
        channels=_channels(discovery),
        regions=list(regions),
        windows=[*windows, *(() if discovery.ending is Ending.RUNNING else _windows(discovery, residuals))],
        refused=[(a.effect, a.joint, why) for a, why in discovery.refused],
        candidates=_candidates(discovery),
        base_parameters=values_found(discovery.final, lambda parameter: parameter.effect is None),
        base_fit=values_found(base, lambda parameter: parameter.effect is None),
        regrouping=base.model.parameters.relations(),
        friction=friction_curves(builder, base, discovery.final),
        curves=[_curve(curve, request.options.seed) for curve in curves],
        torque_unit=list(base.model.parameters.torque_units),
        seconds=0.0,
        notes=_notes(judgement, notes, discovery),
        files={},
        provenance={
            **request.provenance, "options": request.options.record(), "catalogue": sorted(builder.effects),
        },
    )  # fmt: skip


def _noise(noise: Noise) -> NoiseResult:
    """Of the base model."""
    return NoiseResult(
        source=noise.source, std=noise.deviation.tolist(), correlation=noise.correlation.tolist(),
        period_s=noise.period_s, periods=noise.periods,
    )  # fmt: skip


def _notes(judgement: Judgement, notes: Sequence[str], discovery: Discovery) -> list[str]:
    """What is worth knowing, in the order of the page."""
    of_steps = [step.remark for step in discovery.steps if step.remark]
    return [*judgement.acknowledged_remarks, *notes, *of_steps, *(str(remark) for remark in judgement.remarks)]


def _candidates(discovery: Discovery) -> list[CandidateResult]:
    """The outcome of each candidate, round by round."""
    last = {t.effect_at: number for number, comparison in enumerate(discovery.tried, start=1) for t in comparison}
    added = {step.effect_at for step in discovery.steps}
    return [
        CandidateResult(
            round=number, effect=t.effect_at.effect, joint=t.effect_at.joint, outcome=t.outcome.value,
            delta_bic=t.delta_bic, share_of_gap=t.share, parameters=t.cost, implausible=t.implausible,
            accepted=t.effect_at in added and last[t.effect_at] == number,  # afterwards it is no candidate any more
        )
        for number, comparison in enumerate(discovery.tried, start=1)
        for t in comparison
    ]  # fmt: skip


def _with_ladders(
    discovery: Discovery, builder: LoopModelBuilder, ladders: Sequence[Sequence[RungResult]]
) -> list[FindingResult]:
    """The findings, each with its ladder, where that is known."""
    found = [
        *(_smoothing(one, discovery) for one in discovery.refitted),
        *(_finding(step, discovery, builder) for step in discovery.steps),
    ]
    known = ladders or [[] for _ in found]
    return [f.model_copy(update={"ladder": list(own)}) for f, own in zip(found, known, strict=True)]


def _finding(step: Step, discovery: Discovery, builder: LoopModelBuilder) -> FindingResult:
    effect = builder.effect(step.effect_at)
    index = discovery.final.model.added_effects.index(step.effect_at)
    return FindingResult(
        effect=step.effect_at.effect,
        title=effect.title,
        class_=effect.class_name,
        joint=step.effect_at.joint,
        place=effect.place,
        equation=effect.equation,
        parameters=values_found(discovery.final, lambda free: free.effect == index, with_rest=effect.is_stated),
        share_of_gap=step.share,
        delta_bic=step.delta_bic,
        ambiguous=[
            Rival(effect=a.effect, title=builder.effect(a).title, joint=a.joint, bic_behind=behind)
            for a, behind in step.ambiguous
        ],
        experiment=effect.experiment,
        origin=origin(builder, discovery.final, step.effect_at),
        part_of=part_of(discovery.final, step.effect_at, [s.effect_at for s in discovery.steps], builder),
        gap={
            label: GapPair(
                before=_norm(before), after=_norm(step.after[label]),
                before_per_joint=before.tolist(), after_per_joint=step.after[label].tolist(),
            )
            for label, before in step.before.items()
        },
        ratio_interval=(step.ratio.low, step.ratio.high) if step.ratio is not None else None,
        channels=_channel_gaps(step.channels_before, step.channels_after),
    )  # fmt: skip


def _smoothing(found: Refitted, discovery: Discovery) -> FindingResult:
    """A smoothing velocity other than the description states, as a finding."""
    final, shape = discovery.final, found.parameter.key.partition("_")[0]
    effect = next(e for e in EFFECTS.values() if e.is_base and shape in {v.name for v in e.shapes("revolute")})
    noise = final.torque_alone.noise
    gaps = {}
    for label in final.model.experiments:
        try:
            gaps[label] = gap_pair(found.held.residual_in(label), final.residual_in(label), noise)
        except SimulationError:
            continue
    return FindingResult(
        effect=effect.name, title=f"Other smoothing of {effect.title}", class_=effect.class_name, joint=found.joint,
        place=effect.place,
        equation=f"{effect.equation}, v0 = {found.parameter.value:.4g} instead of {found.described:.4g}",
        parameters=values_found(final, lambda parameter: parameter.key == found.parameter.key),
        share_of_gap=found.share, delta_bic=found.delta_bic, ambiguous=[], experiment=effect.experiment, gap=gaps,
        ratio_interval=None,
    )  # fmt: skip


def _curve(found: FoundCurve, seed: int) -> CurveResult:
    effect, (at, torque, half_width) = found.tried.effect, found.drawn()
    before, after = gaps(found.before), gaps(found.fit)
    ratio = held_out_ratio(found.before, found.fit, seed=seed)
    return CurveResult(
        joint=found.tried.effect_at.joint, effect=effect.name, title=effect.title, variable=effect.variable,
        unit=found.tried.unit, at=at.tolist(), torque=torque.tolist(), half_width=half_width.tolist(),
        share_of_gap=explained_gap(found.before, found.fit, found.fit.noise)[1], delta_bic=found.delta_bic,
        rivals=list(found.rivals), instead_of=[(a.effect, a.joint) for a in found.instead_of],
        gap={
            label: GapPair(
                before=_norm(own), after=_norm(after[label]), before_per_joint=own.tolist(),
                after_per_joint=after[label].tolist(),
            )
            for label, own in before.items()
        },
        ratio_interval=None if ratio is None else (ratio.low, ratio.high),
    )  # fmt: skip


def _channel_gaps(
    before: Mapping[str, Mapping[str, float]], after: Mapping[str, Mapping[str, float]]
) -> dict[str, dict[str, GapPair]]:
    """Label -> name of each channel -> its gaps."""
    return {
        label: {
            name: GapPair(before=gap, after=after[label][name], before_per_joint=[], after_per_joint=[])
            for name, gap in own.items()
        }
        for label, own in before.items()
    }


def _channels(discovery: Discovery) -> dict[str, ChannelResult]:
    """What was looked at beside the torque: its noise, and its gaps with the base and with the final model."""
    base = discovery.base
    names, n = base.model.experiments.channels, base.model.joint_count
    if not names:
        return {}
    units = {c.name: c.unit for e in base.model.experiments.values() for c in e.channels}
    gaps = _channel_gaps(channel_gaps(base), channel_gaps(discovery.final))
    return {
        name: ChannelResult(
            unit=units[name], std=float(base.noise.deviation[k]), correlation=float(base.noise.correlation[k]),
            gap={label: own[name] for label, own in gaps.items() if name in own},
        )
        for k, name in enumerate(names, start=n)
    }  # fmt: skip


def gap_pair(before: Array, after: Array, noise: Noise) -> GapPair:
    """The gaps of two residuals (N, n), as they are saved."""
    return GapPair(
        before=total_gap(before, noise),
        after=total_gap(after, noise),
        before_per_joint=joint_gaps(before, noise).tolist(),
        after_per_joint=joint_gaps(after, noise).tolist(),
    )


def values_found(fit: Fit, wanted: Callable[[FreeParameter], bool], *, with_rest: bool = False) -> list[ValueFound]:
    """The wanted free parameters of a fit with their standard deviations and 95 % intervals.

    Args:
        with_rest: whether what the model leaves counts as well as the noise, with its size and its colour
            (:mod:`~fmu_didim.fit.uncertainty`): of values that are compared with those that the case states, as the
            gains of a controller, which somebody will change. What other parameters take up of what is missing shows in
            no residual, and counts in neither.
    """
    deviation = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    if with_rest:
        deviation = np.maximum(deviation, fit_uncertainty(fit).deviation)
    blocks = fit.model.experiments.blocks(fit.residual)  # samples that count as independent:
    samples = sum(own.shape[0] * float(fit.noise.of(columns).factor.sum()) for columns, own in blocks)
    free = fit.model.free_parameters
    found = with_intervals(free, fit.values, deviation, samples - fit.values.size)
    return [value for parameter, value in zip(free, found, strict=True) if wanted(parameter)]


def with_intervals(free: Sequence[FreeParameter], values: Array, deviation: Array, freedom: float) -> list[ValueFound]:
    """Free parameters with their values, standard deviations and 95 % intervals."""
    intervals = confidence_interval(values, deviation, freedom)
    return [
        ValueFound(name=p.name, unit=p.unit, value=float(v), std=float(s), interval=(float(low), float(high)))
        for p, v, s, (low, high) in zip(free, values, deviation, intervals, strict=True)
    ]


def residuals_of(base: Fit, final: Fit) -> Residuals:
    """Label of each experiment -> residuals of the base and of the final model; infinite where one cannot be run."""
    result = {}
    for label in base.model.experiments:
        pair = []
        for fit in (base, final):
            try:
                pair.append(fit.residual_in(label))
            except SimulationError:
                pair.append(np.full(base.model.experiments.measured_in(label).shape, np.inf))
        result[label] = (pair[0], pair[1])
    return result


def _errors(
    discovery: Discovery, residuals: Residuals, whole: Mapping[str, Experiment]
) -> dict[str, tuple[float | None, float | None]]:
    """Label -> torque errors of the base and of the final model, by all samples of an experiment where these are known,
    else by those of its residuals."""
    result = {}
    for label, residual_pair in residuals.items():
        model, pair = discovery.base.model, residual_pair
        if label in whole:
            model = _on_whole(model, label, whole[label])
            pair = (_residual(discovery.base, label, whole[label]), _residual(discovery.final, label, whole[label]))
        measured = model.experiments.measured_in(label)
        percent = [relative_error_percent(measured, measured - r)[0] if np.isfinite(r).all() else None for r in pair]
        result[label] = (percent[0], percent[1])
    return result


def _on_whole(model: LoopModel, label: str, whole: Experiment) -> LoopModel:
    return model.with_experiment(label, model.experiments[label].with_samples_of(whole))


def _residual(fit: Fit, label: str, whole: Experiment) -> Array:
    """(N, n) of all samples of an experiment; infinite where the model cannot be run on it."""
    model = _on_whole(fit.model, label, whole)
    try:
        return model.residual(fit.values, label)
    except SimulationError:
        return np.full(whole.torque.shape, np.inf)


def _windows(discovery: Discovery, residuals: Residuals) -> list[WindowResult]:
    """Intervals of time in which the residual of the final model shows a torque from outside."""
    final, noise = discovery.final, discovery.final.torque_alone.noise
    return [
        window
        for label, (_, residual) in residuals.items()
        if np.isfinite(residual).all()
        for window in force_windows(residual, final.model.experiments[label].time, noise, label)
    ]


def _norm(gaps: Array) -> float:
    return float(np.sqrt(np.mean(gaps**2)))
