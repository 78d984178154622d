"""What a model alone lacks, written down: the content of ``findings.json``, and its judgement."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, Code, Diagnostic
from fmu_didim.base.errors import SimulationError
from fmu_didim.checks.held_out import WORSE_HELD_OUT
from fmu_didim.checks.judgement import Judgement, diagnostic_result, judgement
from fmu_didim.checks.outputs.following import OUTPUT_FOLLOWS
from fmu_didim.checks.residual import RESIDUAL_ABOVE_NOISE, RESIDUAL_SLOW
from fmu_didim.data.signals import Array
from fmu_didim.discovery.document import gap_pair, residuals_of, with_intervals
from fmu_didim.discovery.request import Request
from fmu_didim.discovery.selection.candidates import Outcome
from fmu_didim.discovery.signals.candidates import Candidate
from fmu_didim.discovery.signals.remainder import SLOW_REMAINDER, SLOW_TEXT, slow_remainders
from fmu_didim.discovery.signals.search import FittedSignal, SignalDiscovery, SignalStep, quick_noise
from fmu_didim.discovery.signals.windows import windows_of
from fmu_didim.discovery.unfinished import SEARCH_CUT
from fmu_didim.fit.estimate import Estimate
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.gap import channel_gaps, gaps, held_out_ratio
from fmu_didim.fit.noise.noise import TINY, Noise
from fmu_didim.fit.statistics import relative_error_percent
from fmu_didim.model.free_parameter import FreeParameter
from fmu_didim.results.findings import (
    ANSWER_TEXT,
    Answer,
    CandidateResult,
    ChannelResult,
    FindingResult,
    FindingsDocument,
    GapPair,
    NoiseResult,
    Rival,
    UnfinishedResult,
    ValueFound,
)

UNDECIDED = CATALOGUE(
    "effects-undecided", DOUBT, rank=3,
    meaning="Several things that a model may lack explain the data equally well, each with other values of all that is "
    "identified: none of them is named, and it may be one of them, or something else that does the same.",
    next_step="Rule them out by what you know of the machine (--forbid), or record what tells them apart.",
)  # fmt: skip
MISFITS = {OUTPUT_FOLLOWS, RESIDUAL_ABOVE_NOISE, RESIDUAL_SLOW, SLOW_REMAINDER}
"""What says that a model leaves more than noise."""
ONE_OF = "Several explain it equally well"
ABSORBED = (
    "Not looked for, as what is identified makes up for it whole, so that these data never show it: {}. If one of them "
    "is real, the identified values are off by it."
)


def signals_document(
    request: Request,
    found: SignalDiscovery,
    base: Estimate,
    final: Estimate,
    judged: Judgement,
    seconds: float,
) -> FindingsDocument:
    """Everything that was found, with intervals and gaps.

    Args:
        base, final: estimates without and with what was added; judged: the judgement of the final one.
    """
    found = replace(found, base=_at(base, found.base), final=_at(final, found.final))
    judged = _with_more(judged, slow_remainders(found.final))
    codes = {reason.code for reason in judged.reasons}
    unfinished = _unfinished(found, request.progress.limit_s)
    answer: Answer = "unfinished" if unfinished is not None else _answer(found, codes)
    told = SLOW_TEXT if answer == "unknown" and MISFITS & codes == {SLOW_REMAINDER} else ANSWER_TEXT[answer]
    judged = _with_more(judged, _left_open(found), settled=unfinished is None)
    judged = _with_more(judged, [] if unfinished is None else [unfinished], settled=unfinished is None)
    judged = judged.acknowledging(request.acknowledged)
    noise = _noise(found, is_whole=not (MISFITS & codes))
    shown = noise.of(slice(0, found.base.model.joint_count))
    ratio = held_out_ratio(found.base, found.final, seed=request.options.seed) if found.steps else None
    return FindingsDocument(
        name=request.name,
        answer=answer,
        text=told,
        verdict=judged.verdict,
        reasons=judged.saved(request.case),
        acknowledged=judged.saved_acknowledged(request.case),
        conditions=judged.conditions,
        unfinished=None if unfinished is None else _unfinished_result(found, unfinished),
        findings=[_finding(step, found, final, noise, request.options.seed) for step in found.steps],
        roles={label: e.role for label, e in base.model.experiments.items()},
        gap={label: gap_pair(*pair, shown) for label, pair in residuals_of(found.base, found.final).items()},
        error_percent=dict(_errors(found)),
        ratio_interval=(ratio.low, ratio.high) if ratio is not None else None,
        noise=NoiseResult(
            source=noise.source, std=shown.deviation.tolist(), correlation=[], period_s=None, periods=0
        ),
        channels=_channels(found, noise),
        regions=[],
        windows=windows_of(found.final),
        refused=[
            (t.candidate.name, 0, t.fitted.objection)
            for t in (found.tried[-1] if found.tried else ()) if t.fitted is not None and t.fitted.objection
        ],
        candidates=list(_candidates(found)),
        base_parameters=values_of(final, lambda p: p.effect is None),
        base_fit=values_of(base, lambda p: p.effect is None),
        torque_unit=list(base.model.parameters.torque_units),
        outputs=list(base.model.loop.output_names),
        seconds=seconds,
        notes=[*judged.acknowledged_remarks, *request.notes, *(str(d) for d in judged.remarks), *_absorbed(found)],
        files={},
        provenance={
            **request.provenance, "options": request.options.record(),
            "catalogue": sorted({t.candidate.kind.name for one in found.tried for t in one}),
        },
    )  # fmt: skip


def _at(estimate: Estimate, fit: Fit) -> Fit:
    """A fit at the values of an estimate of the same parameters."""
    model = fit.model.with_values(estimate.value)
    try:
        return replace(fit, model=model, values=estimate.value, outputs=model.outputs(estimate.value))
    except SimulationError:
        return fit


def _answer(found: SignalDiscovery, codes: set[Code]) -> Answer:
    """The answer of a complete search."""
    is_misfit = bool(MISFITS & codes)
    if found.steps:
        if any(step.rivals for step in found.steps):
            return "undecided"
        return "named_with_remainder" if is_misfit else "named"
    if is_misfit:
        return "unknown"
    return "disagreement" if WORSE_HELD_OUT in codes else "nothing"


def _with_more(judged: Judgement, more: Sequence[Diagnostic], *, settled: bool = True) -> Judgement:
    """The judgement with further diagnostics."""
    settled = settled and judged.verdict != "not_settled"
    return judgement([*more, *judged.reasons, *judged.remarks], settled=settled) if more else judged


def _left_open(found: SignalDiscovery) -> list[Diagnostic]:
    """What the search itself does not decide."""
    return [
        Diagnostic(UNDECIDED, f"{'; or '.join(f.candidate.title for f in (s.chosen, *s.rivals))}.")
        for s in found.steps if s.rivals
    ]  # fmt: skip


def _unfinished(found: SignalDiscovery, limit_s: float | None) -> Diagnostic | None:
    if not found.is_cut:
        return None
    left = [t.candidate.name for t in found.tried[-1] if t.outcome is Outcome.NOT_TRIED]
    text = (
        f"The time limit of {limit_s or 0.0:g} s ended the search in round {len(found.tried)}: {len(left)} of its "
        f"{len(found.tried[-1])} candidates were not tried."
    )
    return Diagnostic(SEARCH_CUT, text, value=limit_s, unit="s")


def _unfinished_result(found: SignalDiscovery, told: Diagnostic) -> UnfinishedResult:
    left = [(t.candidate.name, 0) for t in found.tried[-1] if t.outcome is Outcome.NOT_TRIED]
    return UnfinishedResult(
        code=told.code.name, text=told.text, next_step=diagnostic_result(told).next_step, rounds=len(found.steps),
        untried=left,
    )  # fmt: skip


def _absorbed(found: SignalDiscovery) -> list[str]:
    return [ABSORBED.format(", ".join(found.absorbed))] if found.absorbed else []


def _noise(found: SignalDiscovery, *, is_whole: bool) -> Noise:
    """The noise in whose deviations gaps are told: what the final model leaves, where that is noise; else what
    neighbouring samples show of it."""
    if not is_whole:
        return quick_noise(found.final)
    blocks = found.final.model.experiments.blocks(found.final.residual)
    square = np.concatenate([np.mean(own**2, axis=0) for _, own in blocks])
    return Noise(np.maximum(np.sqrt(square), TINY), np.zeros(square.size), "what the final model leaves")


def _finding(step: SignalStep, found: SignalDiscovery, final: Estimate, noise: Noise, seed: int) -> FindingResult:
    one, before, after = step.chosen, replace(step.before, noise=noise), replace(step.chosen.fit, noise=noise)
    candidate, ratio = one.candidate, held_out_ratio(step.before, one.fit, seed=seed)
    first, second = gaps(before), gaps(after)
    further, beyond = channel_gaps(before), channel_gaps(after)
    everything = (replace(one, fit=found.final), *step.rivals) if step.rivals else ()  # beside all that came later
    best = max((f.gain for f in everything), default=0.0)
    return FindingResult(
        effect="undecided" if step.rivals else candidate.kind.name,
        title=ONE_OF if step.rivals else candidate.title,
        class_=candidate.kind.name,
        joint=0,
        place=", ".join(dict.fromkeys(f.candidate.side for f in everything)) or candidate.side,
        equation="; or ".join(f.candidate.equation for f in everything) or candidate.equation,
        parameters=[] if step.rivals else values_of(final, _of(candidate)),
        share_of_gap=one.share,
        delta_bic=one.gain,
        ambiguous=[_rival(f, best) for f in everything],
        experiment=candidate.kind.experiment,
        gap={
            label: GapPair(
                before=_norm(own), after=_norm(second[label]), before_per_joint=own.tolist(),
                after_per_joint=second[label].tolist(),
            )
            for label, own in first.items()
        },
        ratio_interval=(ratio.low, ratio.high) if ratio is not None else None,
        channels={
            label: {n: GapPair(before=g, after=beyond[label][n], before_per_joint=[], after_per_joint=[])
                    for n, g in own.items()}
            for label, own in further.items()
        },
        side="" if step.rivals else candidate.side,
        signal="" if step.rivals else candidate.signal,
    )  # fmt: skip


def _norm(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _rival(one: FittedSignal, best: float) -> Rival:
    c = one.candidate
    deviation = np.sqrt(np.maximum(np.diag(one.fit.covariance), 0.0))
    samples, free = float(one.fit.model.output_counts.sum()), one.fit.model.free_parameters
    found = with_intervals(free, one.fit.values, deviation, samples - len(free))
    return Rival(
        effect=c.kind.name, title=c.title, joint=0, bic_behind=best - one.gain, side=c.side, signal=c.signal,
        parameters=[value for parameter, value in zip(free, found, strict=True) if _of(c)(parameter)],
    )  # fmt: skip


def _of(candidate: Candidate) -> Callable[[FreeParameter], bool]:
    """Whether a free parameter is one of a candidate."""
    names = {p.name for p in candidate.free({}, 0)}
    return lambda parameter: parameter.effect is not None and parameter.name in names


def values_of(estimate: Estimate, wanted: Callable[[FreeParameter], bool]) -> list[ValueFound]:
    """The wanted parameters of an estimate with their intervals."""
    free = estimate.model.free_parameters
    found = with_intervals(free, estimate.value, estimate.standard_deviation, estimate.freedom)
    return [value for parameter, value in zip(free, found, strict=True) if wanted(parameter)]


def _errors(found: SignalDiscovery) -> Iterator[tuple[str, tuple[float | None, float | None]]]:
    """Relative error of base and final model: of the outputs, about their means."""
    for label, pair in residuals_of(found.base, found.final).items():
        measured = found.base.model.experiments.measured_in(label)
        about = measured - measured.mean(axis=0)
        both = [relative_error_percent(about, about - r)[0] if np.isfinite(r).all() else None for r in pair]
        yield label, (both[0], both[1])


def _channels(found: SignalDiscovery, noise: Noise) -> dict[str, ChannelResult]:
    """The outputs with instants of their own."""
    base, n = found.base, found.base.model.joint_count
    units = {c.name: c.unit for e in base.model.experiments.values() for c in e.channels}
    before, after = (channel_gaps(replace(fit, noise=noise)) for fit in (base, found.final))
    return {
        name: ChannelResult(
            unit=units[name], std=float(noise.deviation[k]), correlation=0.0,
            gap={
                label: GapPair(before=own[name], after=after[label][name], before_per_joint=[], after_per_joint=[])
                for label, own in before.items() if name in own
            },
        )
        for k, name in enumerate(base.model.experiments.channels, start=n)
    }  # fmt: skip


def _candidates(found: SignalDiscovery) -> Iterator[CandidateResult]:
    """The outcome of each candidate that was fitted or not tried, round by round."""
    added = {step.chosen.candidate.name for step in found.steps}
    last = {t.candidate.name: number for number, tried in enumerate(found.tried, start=1) for t in tried}
    for number, tried in enumerate(found.tried, start=1):
        for t in tried:
            c, one = t.candidate, t.fitted
            yield CandidateResult(
                round=number, effect=c.kind.name, joint=0, outcome=t.outcome.value,
                delta_bic=None if one is None else one.gain, share_of_gap=None if one is None else one.share,
                parameters=None if one is None else float(c.cost), implausible="" if one is None else one.objection,
                accepted=c.name in added and last[c.name] == number, side=c.side, signal=c.signal,
            )  # fmt: skip
