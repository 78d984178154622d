"""What all samples of long logs say beside the part of them that was judged.

The shape of a residual is asked of a part: of some stretches from the whole length. Of the rest it is asked what costs
little a sample: whether each block of all samples agrees with all others on the values, by the score test of
:mod:`fmu_didim.checks.agreement`; whether it leaves a larger residual than the stretches do; and what the log shows by
itself, single samples that are wrong among it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, REMARK, Diagnostic
from fmu_didim.checks.agreement import SIGNIFICANCE, parts_agree
from fmu_didim.checks.data.expected import Expected
from fmu_didim.checks.data.log import FEW_OUTLIERS, LOG_OUTLIERS, SAMPLES_MISSING, log_diagnostics
from fmu_didim.checks.data.outliers import outlying, told_outliers
from fmu_didim.checks.validation import Validation
from fmu_didim.cosim import Indices
from fmu_didim.data.signals import Array
from fmu_didim.fit.estimate import Estimate
from fmu_didim.fit.exploration.all_samples import AllSamples
from fmu_didim.fit.noise.noise import TINY

LARGER = 1.3
"""[1] Residual of a block of all samples over that of the loudest stretch that was judged, from which something acts
there that the stretches do not show: of eight tenths of the noise."""

JUDGED_ON_PART = CATALOGUE(
    "judged-on-part", REMARK, rank=66,
    meaning="A log is so long that the shape of its residual was looked at in stretches from its whole length: whether "
    "it follows the motion, and what a valid verdict excludes. Values and standard deviations come from all samples, "
    "and of all samples it was asked whether they agree on the values, whether the residual is as large as in the "
    "stretches, and whether single ones are wrong. Something smaller than the noise that acts between the stretches "
    "alone, and that no parameter is like, is not seen.",
    next_step="To have a part of the log judged sample by sample, identify it alone: from_s and to_s of the run.",
)  # fmt: skip
LOG_CHANGES = CATALOGUE(
    "log-changes", DOUBT, rank=62,
    meaning="A part of a long log does not agree with the others on the values: something changed while it was "
    "recorded, as friction does in a gear that becomes warm, or the model lacks something that counts more in one "
    "motion than in another. The values are between those of the parts.",
    next_step="If nothing else is told that explains it, identify the parts by themselves, as runs with from_s and "
    "to_s, with values of their own for what changed (own: [...]).",
)  # fmt: skip
REST_LARGER = CATALOGUE(
    "residual-larger-in-rest", DOUBT, rank=63,
    meaning="In a part of a long log the residual is larger than in the stretches whose shape was looked at: something "
    "acts there that was not judged.",
    next_step="Look at the residual there in the report; identify that part alone (from_s, to_s), or leave it out.",
)  # fmt: skip


def with_all_samples(
    estimate: Estimate, validations: Sequence[Validation], before: Sequence[Diagnostic]
) -> list[Diagnostic]:
    """What was found of the data, and what is found in all samples; the former alone where all were judged.

    Args:
        validations: of all experiments; before: what was found of the data of the part, in whose place comes what all
            samples show of the same; gaps between its stretches are none.
    """
    told = estimate.all_samples
    if told is None:
        return list(before)
    found = [*_judged_part(told), *_changes(estimate, told), *_larger(estimate, told)]
    for validation in validations:
        if validation.label in told.spans and not validation.failure:
            found += _of_log(estimate, told, validation)
    again = {(_kind(d), d.place) for d in found}
    again |= {(SAMPLES_MISSING.name, label) for label in told.spans}
    return [*(d for d in before if (_kind(d), d.place) not in again), *found]


def _kind(found: Diagnostic) -> str:
    """Its code; the same for all outliers."""
    return LOG_OUTLIERS.name if found.code is FEW_OUTLIERS else found.code.name


def _judged_part(told: AllSamples) -> Iterator[Diagnostic]:
    stretches = sum(len(spans) for spans in told.spans.values())
    text = (
        f"Of {told.count} samples, {told.judged} in {stretches} stretches were looked at for the shape of the "
        "residual; values and standard deviations come from all of them."
    )
    yield Diagnostic(JUDGED_ON_PART, text, "", float(told.judged), None, "samples")


def _changes(estimate: Estimate, told: AllSamples) -> Iterator[Diagnostic]:
    """The block of each log that agrees least with the others, where it does not."""
    results = parts_agree(estimate.names, told.blocks)
    pairs = list(zip(told.blocks, results, strict=True))
    for label in dict.fromkeys(block.label for block, _ in pairs):
        own = [pair for pair in pairs if pair[0].label == label]
        apart = [pair for pair in own if not pair[1].agrees]
        if not apart:
            continue
        block, result = min(apart, key=lambda pair: pair[1].p_value)
        text = (
            f"{len(apart)} of {len(own)} parts do not agree with the others on the values, least that from "
            f"{block.begin_s:.6g} s to {block.end_s:.6g} s (p = {result.p_value:.1e}): {result.differs_most} would "
            f"differ most there, by {result.change_in_std:.1f} standard deviations."
        )
        yield Diagnostic(LOG_CHANGES, text, label, result.p_value, SIGNIFICANCE / len(told.blocks), "1")


def _larger(estimate: Estimate, told: AllSamples) -> Iterator[Diagnostic]:
    """The block and joint of each log whose residual is most beyond that of the stretches."""
    for label in dict.fromkeys(block.label for block in told.blocks):
        blocks = [block for block in told.blocks if block.label == label]
        for j in range(estimate.model.joint_count):
            worst = max(blocks, key=lambda block: float(block.rms[j]))
            ratio = float(worst.rms[j] / max(float(told.rms[j]), TINY))
            if ratio > LARGER:
                text = (
                    f"From {worst.begin_s:.6g} s to {worst.end_s:.6g} s the residual is {ratio:.3g} times as large as "
                    "in the stretches that were judged."
                )
                yield Diagnostic(REST_LARGER, text, f"{label}: joint {j + 1}", ratio, LARGER, "1")


def _of_log(estimate: Estimate, told: AllSamples, found: Validation) -> Iterator[Diagnostic]:
    """What a whole log shows by itself, and its outliers in the residual of the fit."""
    experiment = estimate.model.experiments[found.label]
    rate_hz = 1 / estimate.model.loop.systems[found.label].step_size
    given = Expected(found.measured, found.simulated)
    yield from log_diagnostics(experiment, found.label, given, rate_hz, with_outliers=False)
    residual = found.measured - found.simulated
    for j in range(residual.shape[1]):
        speed = found.motion.get(f"dq{j + 1}")
        rows = outlying(
            residual[:, j], np.zeros(len(residual)) if speed is None else np.abs(speed), found.measured[:, j]
        )
        if not rows.size:
            continue
        is_held_out = found.role == "validation"
        moved = 0.0 if is_held_out else _moved(told, found.label, j, rows, residual[rows, j])
        text = (
            "The run is held out: they move no value." if is_held_out
            else f"They move the values by {moved:.2g} standard deviations, all together."
        )  # fmt: skip
        place, noise = f"{found.label}: joint {j + 1}", float(np.delete(residual[:, j], rows).std())
        yield told_outliers(place, rows, residual[:, j], found.time, noise, moved, text)


def _moved(told: AllSamples, label: str, j: int, rows: Indices, errors: Array) -> float:
    """Standard deviations by which errors (k,) of samples of joint ``j`` (from 0) move the values, all together;
    infinite where there are more of them than are known."""
    far = told.far[label, j]
    if not np.isin(rows, far.rows).all():
        return np.inf
    change = far.influence[np.searchsorted(far.rows, rows)].T @ errors
    gram = np.asarray(sum(block.gram for block in told.blocks))
    return float(np.sqrt(change @ gram @ change))
