"""The judgement of a discovery: whether its answer and the values of the final model may be used."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, Diagnostic
from fmu_didim.base.errors import SimulationError
from fmu_didim.checks.channels import CHANNEL_OFF, like_a_wrong_sensor
from fmu_didim.checks.held_out import WORSE_HELD_OUT, Residual, held_out_diagnostics
from fmu_didim.checks.held_out_channels import held_out_channel_diagnostics
from fmu_didim.checks.judgement import Judgement, judgement
from fmu_didim.checks.motion.dependence import DEPENDS_ON_MOTION
from fmu_didim.checks.motion.misfits import Misfits
from fmu_didim.checks.motion.tested import MotionTests
from fmu_didim.checks.validation import validated_channels
from fmu_didim.discovery.selection.rounds import Discovery
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.gap import channel_gaps, joint_gaps, part_of_gap
from fmu_didim.model.loop_model import EffectAtJoint, LoopModel
from fmu_didim.results.findings import Answer

REMAINDER = 0.6
"""[standard deviations] Gap of a joint, in units of its noise, above which the final model still counts as incomplete:
the clutter on clean plants of the blind benchmark reaches as far."""
SMALLEST_WHOLE = 0.4
"""[1] Part of the squared gap of a joint that all named effects together explain at least, where much is left and what
explains as much is in the set of one: what hides the larger part may have moved what explains the smaller. On blind
cases drive gains, ripples, constants and stops that stand for a coupling of two joints, or for a push, explain 0.11 to
0.39; the loss by load of a measured gear explains 0.44, and has no such rival."""
MUCH = 1.0
"""[standard deviations] Gap of a joint that is much: an error of the model as large as the noise."""

GAP_REMAINS = CATALOGUE(
    "gap-remains", DOUBT, rank=52,
    meaning="The final model still disagrees with the data by more than their noise: something is missing that no "
    "effect of the catalogue explains, or an effect has another form.",
    next_step="Look at where it disagrees in the report; add an effect of your own (--effect PACKAGE.MODULE:NAME).",
)  # fmt: skip


REMAINDER_FOLLOWS = CATALOGUE(
    "remainder-follows-motion", DOUBT, rank=62,
    meaning="What the final model leaves is small, but it depends on the motion, which noise does not: something else "
    "is missing that is too small for a name, or an effect has another form. The values absorb a part of it.",
    next_step="Take the values with wider intervals; a longer log, or one at a higher rate, may tell what it is.",
)  # fmt: skip


def judged(
    discovery: Discovery, unfinished: Diagnostic | None, before: Sequence[Diagnostic] = ()
) -> tuple[Judgement, Misfits]:
    """The judgement of the final model, and the misfits of its torque that were looked for, if any.

    Args:
        unfinished: the diagnostic of an unfinished search; before: doubts about the data.
    """
    final = discovery.final
    found, misfits = [*before, *(gaps := remaining_gaps(final)), *like_wrong_sensors(final)], Misfits()
    if unfinished is not None:
        found.append(unfinished)
    else:
        tests = MotionTests.of(final.torque_alone)
        misfits = tests.misfits
        found += _following(tests, gaps)
    return judgement([*found, *_held_out(final)], settled=unfinished is None), misfits


def answer_of(discovery: Discovery, judged: Judgement) -> Answer:
    """The answer of a complete search."""
    codes = {reason.code for reason in judged.reasons}
    if discovery.steps or discovery.refitted or has_external_torques(discovery.final.model):
        return "named_with_remainder" if GAP_REMAINS in codes else "named"
    if GAP_REMAINS in codes:
        return "unknown"
    return "disagreement" if WORSE_HELD_OUT in codes else "nothing"


def explains_little(discovery: Discovery, class_of: Callable[[EffectAtJoint], str]) -> str:
    """Why what was named is no answer, in words, or an empty string: it explains the smaller part of what the base
    model lacks, and something else explains as much of it.

    Args:
        class_of: the class of an effect.
    """
    rivals = [
        (step.effect_at, other) for step in discovery.steps for other, _ in step.ambiguous
        if other.joint != step.effect_at.joint or class_of(other) != class_of(step.effect_at)
    ]  # fmt: skip
    if not rivals:
        return ""
    own, rival = rivals[0]
    base, final = discovery.base, discovery.final
    part = part_of_gap(base, base, final, final.noise)
    if part >= SMALLEST_WHOLE or all((gap.value or 0.0) <= MUCH for gap in remaining_gaps(final)):
        return ""
    return (
        f"all that was named explains {100 * part:.0f} % of the gap of a joint, less than {100 * SMALLEST_WHOLE:g} %, "
        f"and leaves an error larger than the noise; {rival.text} explains as much in the place of {own.text}"
    )


def has_external_torques(model: LoopModel) -> bool:
    """Whether a fitted experiment has torques from outside."""
    return any(model.experiments[label].external_torques for label in model.estimation_labels)


def remaining_gaps(fit: Fit) -> list[Diagnostic]:
    """The joints on which a model leaves more than noise."""
    torque = fit.torque_alone
    gaps = joint_gaps(torque.residual, torque.noise)
    return [
        Diagnostic(
            GAP_REMAINS, f"The model error is {gaps[j]:.2g} times the noise.", f"joint {j + 1}", float(gaps[j]),
            REMAINDER, "1",
        )
        for j in np.flatnonzero(gaps > REMAINDER)
    ] + [
        Diagnostic(
            GAP_REMAINS, f"{label}: the error of {name} is {gap:.2g} times its noise beyond that.", name, gap,
            REMAINDER, "1",
        )
        for label, found in channel_gaps(fit).items() if label in fit.model.estimation_labels
        for name, gap in found.items() if gap > REMAINDER
    ]  # fmt: skip


def _following(tests: MotionTests, gaps: Sequence[Diagnostic]) -> list[Diagnostic]:
    """The joints on which a model leaves little that still depends on the motion, as the verdict of an identification
    asks; not those of which it is told that more remains."""
    told = {d.place for d in gaps}
    return [
        replace(found, code=REMAINDER_FOLLOWS)
        for found in tests.diagnostics
        if found.code is DEPENDS_ON_MOTION and found.place not in told
    ]


def like_wrong_sensors(fit: Fit) -> list[Diagnostic]:
    """Channels whose remaining error holds that of a sensor with an offset, another scale or a late clock."""
    found, gaps = [], channel_gaps(fit)
    for label in fit.model.estimation_labels if gaps else ():
        for name, channel in validated_channels(fit.simulation(label)).items():
            told = like_a_wrong_sensor(channel) if gaps[label].get(name, 0.0) > REMAINDER else ""
            if told:
                found.append(Diagnostic(CHANNEL_OFF, f"{label}: {name} {told}.", name))
    return found


def _held_out(fit: Fit) -> list[Diagnostic]:
    model, held, failures, channels = fit.model, {}, {}, {}
    for label in model.experiments.validation_labels:
        try:
            held[label] = Residual.of(model.experiments.measured_in(label), fit.simulation(label).torque())
            channels[label] = validated_channels(fit.simulation(label))
        except SimulationError as error:
            failures[label] = error.what
    fitted = Residual.of(model.measured, fit.torque)
    of_fit = [validated_channels(fit.simulation(label)) for label in model.estimation_labels] if any(
        channels.values()
    ) else []  # fmt: skip
    return [
        *held_out_diagnostics(model, fit.covariance, fitted, held, failures),
        *held_out_channel_diagnostics(model, fit.covariance, of_fit, channels),
    ]
