"""Torques from outside, written down as a finding and as windows of time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from fmu_didim.discovery.document import gap_pair, values_found
from fmu_didim.discovery.external_torques.fit import Pushed, push_knobs
from fmu_didim.discovery.findings import FindingResult, GapPair, Rival, ValueFound, WindowResult
from fmu_didim.discovery.selection.decide import HELD_OUT
from fmu_didim.effects import EFFECTS
from fmu_didim.errors import SimulationError
from fmu_didim.prediction.external_torque import PUSH
from fmu_didim.prediction.least_squares import Fit, minimise
from fmu_didim.prediction.loop_model import Knob
from fmu_didim.prediction.noise import Noise

NAME = "external_force"
LISTED = 3
"""Number of pushes up to which all are listed as parameters; the windows list them in any case."""


def refitted(pushed: Pushed, final: Fit, noise: Noise) -> tuple[Fit, Fit]:
    """The final model with the pushes fitted once more, and the same with them as its last knobs."""
    model, run = final.model, final.model.runs["train"]
    count = len(model.knobs)
    try:
        knobs = (*model.knobs, *push_knobs(final, run.pushes))
        free = minimise(replace(model, knobs=knobs), noise, iterations=6, renew=1)
    except SimulationError:
        return final, pushed.free
    held = replace(run, pushes=free.model.pushes(free.values))
    model = replace(model, runs={**model.runs, "train": held}).with_values(free.values[:count])
    fixed = Fit(model, free.values[:count], free.torque, free.jacobian[:, :, :count], free.chi_square)
    return fixed, free


def push_finding(pushed: Pushed, base: Fit, free: Fit, noise: Noise) -> FindingResult:
    """The finding: times and torques of the pushes with their intervals."""
    effect = EFFECTS[NAME]
    pushes = free.model.runs["train"].pushes
    first = pushes[0]
    where = "It was added to the command, so that the torque log shows it." if first.is_logged else ""
    return FindingResult(
        effect=NAME,
        title=effect.title,
        class_=effect.class_name,
        joint=first.joint,
        place="command" if first.is_logged else effect.place,
        equation=f"F[i] from t_on[i] to t_off[i], i = 1 to {len(pushes)}, positive along the joint. {where}".strip(),
        parameters=_summary(free, noise),
        share_of_gap=pushed.share,
        delta_bic=pushed.delta_bic,
        ambiguous=[
            Rival(effect=name, title=EFFECTS[name].title, joint=first.joint, bic_behind=None)
            for name in effect.confounded_with
        ],
        experiment=effect.experiment,
        gap=_gaps(base, pushed.fit, noise),
        ratio_interval=None,
    )


def push_windows(free: Fit, noise: Noise) -> list[WindowResult]:
    """One window for each push; its score is its torque in standard deviations."""
    deviation = {v.name: v.std for v in values_found(free, noise, _is_push)}
    return [
        WindowResult(
            joint=p.joint,
            begin_s=p.begin_s,
            end_s=p.end_s,
            torque=p.torque,
            score=abs(p.torque) / max(deviation.get(f"F[{i}]") or 0.0, 1e-12),
            experiment="train",
        )
        for i, p in enumerate(free.model.pushes(free.values), start=1)
    ]


def _is_push(knob: Knob) -> bool:
    return knob.owner == PUSH


def _summary(free: Fit, noise: Noise) -> list[ValueFound]:
    """Everything about a few pushes; of many their mean torque, with its spread, and the first one's times."""
    values = values_found(free, noise, _is_push)
    torques = np.array([v.value for v in values if v.name.startswith("F[")])
    if torques.size <= LISTED:
        return values
    mean, std = float(torques.mean()), float(torques.std(ddof=1) / np.sqrt(torques.size))
    unit = next(v.unit for v in values if v.name.startswith("F["))
    both = ValueFound(name="F", unit=unit, value=mean, std=std, interval=(mean - 1.96 * std, mean + 1.96 * std))
    return [both, *(v for v in values if v.name.endswith("[1]"))]


def _gaps(before: Fit, after: Fit, noise: Noise) -> Mapping[str, GapPair]:
    """On the training data, and on the held-out ones, which the better base parameters help too."""
    result = {}
    for label in ("train", HELD_OUT):
        if label not in before.model.runs:
            continue
        try:
            pair = [f.model.residual(f.values, label) for f in (before, after)]
        except SimulationError:
            continue
        result[label] = gap_pair(pair[0], pair[1], noise)
    return result


__all__ = ["push_finding", "push_windows", "refitted"]
