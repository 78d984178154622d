"""Discovery from end to end: prepare, localise, compete, and write down what was found."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fmu_didim.discovery.augment import Workshop
from fmu_didim.discovery.findings import (
    VERDICT_TEXT,
    FindingResult,
    FindingsDocument,
    GapPair,
    NoiseResult,
    RegionResult,
    Rival,
    ValueFound,
    Verdict,
    WindowResult,
)
from fmu_didim.discovery.fit import Fit, integrated
from fmu_didim.discovery.gap import gap_pair, joint_gaps
from fmu_didim.discovery.library import simulated_motion
from fmu_didim.discovery.localise import force_windows, regions
from fmu_didim.discovery.loop_model import Addition
from fmu_didim.discovery.noise import Noise
from fmu_didim.discovery.prepare import prepare
from fmu_didim.discovery.push_result import push_finding, push_windows, refitted
from fmu_didim.discovery.push_rivals import rivalled
from fmu_didim.discovery.pushes import find_pushes
from fmu_didim.discovery.rounds import HELD_OUT, Discovery, Options, Say, Step, held_out_ratio, run_rounds
from fmu_didim.effects import EFFECTS, Effect
from fmu_didim.errors import SimulationError
from fmu_didim.identification.problem import Problem
from fmu_didim.robot import RobotDescription
from fmu_didim.signals import Array
from fmu_didim.statistics import relative_error_percent

NO_HELD_OUT = (
    "There is no validation experiment: the held-out gate was left out, the information criterion alone decided."
)
BEGIN_S = 0.25
"""Left out at the begin of each experiment: the state in which the machine starts is not known (gears in their play,
friction's deflection, the loop before the first sample)."""
REMAINDER = 0.6
"""Gap of a joint, in units of its noise, above which a model that found no more effects still counts as incomplete."""


Residuals = dict[str, tuple[Array, Array]]
"""Label of each experiment -> residuals (N, n) of the base and of the final model."""


@dataclass(frozen=True)
class Found:
    """What :func:`discover` returns.

    Attributes:
        document: the content of ``findings.json``.
        discovery: base and final fit with the steps between; workshop: builds what was found; noise: of the data.
    """

    document: FindingsDocument
    discovery: Discovery
    workshop: Workshop
    noise: Noise


def discover(
    problem: Problem,
    held_out: Problem | None,
    *,
    description: RobotDescription | None,
    name: str,
    effects: Mapping[str, Effect] = EFFECTS,
    options: Options | None = None,
    provenance: Mapping[str, Any] | None = None,
    say: Callable[[str], None] = lambda text: None,
) -> Found:
    """Find the effects that a model lacks.

    Args:
        problem: loop, parameters and data; held_out: the same loop with other data, for the gate.
        description: the robot, None for a plant that is a black box.
        effects: the catalogue by name.

    Raises:
        InputError: the data are too few; SimulationError: the base model cannot be simulated.
    """
    begin = clock.perf_counter()
    options = options or Options()
    say("base model")
    problem = problem.on(problem.experiment.after(BEGIN_S))
    held_out = held_out.on(held_out.experiment.after(BEGIN_S)) if held_out is not None else None
    prepared = prepare(problem, {HELD_OUT: held_out} if held_out is not None else {})
    noise, base = prepared.noise, prepared.fit
    say(f"gap of the base model: {_list(joint_gaps(base.residual, noise))} of the noise")
    start = integrated(base, noise, coarse=True)  # for the search, with its hundreds of simulations
    workshop = Workshop(start.model, description, effects)
    pushed = None if "external_force" in options.forbid else find_pushes(start, noise, say=say)
    if pushed is not None and rivalled(pushed, start, noise, workshop, forbid=options.forbid, say=say):
        pushed = None
    if pushed is not None:
        start, noise, workshop = pushed.fit, pushed.noise, Workshop(pushed.fit.model, description, effects)
    motion = simulated_motion(workshop, base)
    run = base.model.runs["train"]
    ticks = _nearest_ticks(run.problem)
    units = problem.parameters.torque_units
    found_regions = regions(base.residual, motion, ticks, noise, units) if motion is not None else []
    discovery = run_rounds(workshop, start, noise, options, say)
    outside: list[FindingResult] = []
    windows: list[WindowResult] = []
    if pushed is not None:
        final, free = refitted(pushed, discovery.final, noise)
        discovery = replace(discovery, final=final)
        outside = [push_finding(pushed, base, free, noise)]
        windows = push_windows(free, noise)
    discovery = replace(discovery, base=base, final=_fully_integrated(base, discovery, noise))
    residuals = _residuals(discovery)
    verdict = _verdict(discovery, noise)
    ratio = held_out_ratio(base, discovery.final, noise, options) if discovery.steps else None
    document = FindingsDocument(
        name=name,
        verdict=verdict,
        text=VERDICT_TEXT[verdict],
        findings=[*outside, *(_finding(step, discovery, workshop, noise) for step in discovery.steps)],
        gap={label: gap_pair(before, after, noise) for label, (before, after) in residuals.items()},
        error_percent=_errors(discovery, residuals),
        ratio_interval=(ratio.low, ratio.high) if ratio is not None else None,
        noise=_noise(noise),
        regions=[
            RegionResult(
                joint=r.joint, quantity=r.quantity, unit=r.unit, low=r.low, high=r.high, mean=r.mean,
                share_of_gap=r.share, p_value=r.p_value,
            )
            for r in found_regions
        ],
        windows=[*windows, *_windows(discovery, residuals, noise)],
        refused=[(a.effect, a.joint, why) for a, why in discovery.refused],
        base_parameters=_values(discovery.final, noise, lambda knob: knob.effect is None),
        torque_unit=list(units),
        seconds=clock.perf_counter() - begin,
        notes=[*prepared.notes, *([] if held_out is not None else [NO_HELD_OUT])],
        files={},
        provenance={**(provenance or {}), "options": _options(options), "catalogue": sorted(effects)},
    )  # fmt: skip
    return Found(document, discovery, workshop, noise)


def _fully_integrated(base: Fit, discovery: Discovery, noise: Noise) -> Fit:
    """The final model as it will be run by others; the base where nothing was added."""
    final = discovery.final
    if not discovery.steps and not final.model.runs["train"].pushes:
        return base
    try:
        return integrated(final, noise, coarse=False)
    except SimulationError:
        return final


def _verdict(discovery: Discovery, noise: Noise) -> Verdict:
    remains = bool((joint_gaps(discovery.final.residual, noise) > REMAINDER).any())
    if discovery.steps or discovery.final.model.runs["train"].pushes:
        return "named_with_remainder" if remains else "named"
    return "unknown" if remains else "nothing"


def _finding(step: Step, discovery: Discovery, workshop: Workshop, noise: Noise) -> FindingResult:
    effect = workshop.effect(step.addition)
    index = discovery.final.model.additions.index(step.addition)
    return FindingResult(
        effect=step.addition.effect,
        title=effect.title,
        class_=effect.class_name,
        joint=step.addition.joint,
        place=effect.place,
        equation=effect.equation,
        parameters=_values(discovery.final, noise, lambda knob: knob.effect == index),
        share_of_gap=step.share,
        delta_bic=step.delta_bic,
        ambiguous=[_rival(a, behind, workshop) for a, behind in step.ambiguous],
        experiment=effect.experiment,
        gap={
            label: GapPair(
                before=_norm(step.before[label]),
                after=_norm(step.after[label]),
                before_per_joint=step.before[label].tolist(),
                after_per_joint=step.after[label].tolist(),
            )
            for label in step.before
        },
        ratio_interval=(step.ratio.low, step.ratio.high) if step.ratio is not None else None,
    )


def _rival(addition: Addition, behind: float, workshop: Workshop) -> Rival:
    title = workshop.effect(addition).title
    return Rival(effect=addition.effect, title=title, joint=addition.joint, bic_behind=behind)


def _values(fit: Fit, noise: Noise, wanted: Callable[[Any], bool]) -> list[ValueFound]:
    deviation = np.sqrt(np.maximum(np.diag(fit.covariance(noise)), 0.0))
    return [
        ValueFound(
            name=knob.name, unit=knob.unit, value=float(v), std=float(s),
            interval=(float(v - 1.96 * s), float(v + 1.96 * s)),
        )
        for knob, v, s in zip(fit.model.knobs, fit.values, deviation, strict=True)
        if wanted(knob)
    ]  # fmt: skip


def _residuals(discovery: Discovery) -> Residuals:
    """Label of each experiment -> residuals of the base and of the final model; infinite where one cannot be run."""
    result = {}
    for label, run in discovery.base.model.runs.items():
        pair = []
        for fit in (discovery.base, discovery.final):
            try:
                pair.append(fit.model.residual(fit.values, label))
            except SimulationError:
                pair.append(np.full(run.measured.shape, np.inf))
        result[label] = (pair[0], pair[1])
    return result


def _errors(discovery: Discovery, residuals: Residuals) -> dict[str, tuple[float | None, float | None]]:
    result = {}
    for label, pair in residuals.items():
        measured = discovery.base.model.runs[label].measured
        percent = [relative_error_percent(measured, measured - r)[0] if np.isfinite(r).all() else None for r in pair]
        result[label] = (percent[0], percent[1])
    return result


def _windows(discovery: Discovery, residuals: Residuals, noise: Noise) -> list[WindowResult]:
    """Intervals with a force of their own, in what the final model leaves: the drive must make up for it."""
    result = []
    for label, (_, residual) in residuals.items():
        if not np.isfinite(residual).all():
            continue
        run = discovery.final.model.runs[label]
        for w in force_windows(residual, run.problem.experiment.time, noise):
            result.append(
                WindowResult(
                    joint=w.joint, begin_s=w.begin_s, end_s=w.end_s, torque=-w.torque, score=w.score, experiment=label
                )
            )
    return result


def _noise(noise: Noise) -> NoiseResult:
    return NoiseResult(
        source=noise.source,
        std=noise.deviation.tolist(),
        correlation=noise.correlation.tolist(),
        period_s=noise.period_s,
        periods=noise.periods,
    )


def _nearest_ticks(problem: Problem) -> Array:
    reference, step = problem.experiment.reference, problem.system.step_size
    ticks = np.round((problem.experiment.time - reference.time[0]) / step - problem.experiment.operator.lag).astype(int)
    return np.asarray(np.clip(ticks, 0, reference.time.size - 1))


def _options(options: Options) -> dict[str, Any]:
    return {
        "forbid": sorted(options.forbid),
        "prefer": list(options.prefer),
        "rounds": options.rounds,
        "threshold": options.threshold,
        "smallest_size": options.smallest_size,
        "smallest_gain": options.smallest_gain,
        "smallest_share": options.smallest_share,
        "seed": options.seed,
    }


def _norm(gaps: Array) -> float:
    return float(np.sqrt(np.mean(gaps**2)))


def _list(values: Sequence[float] | Array) -> str:
    return ", ".join(f"{v:.2f}" for v in values)


__all__ = ["Found", "Options", "Say", "discover"]
