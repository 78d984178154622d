"""Logs that show the size of the torque alone: that its signs are given, and a log that seems to be one."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, PROBLEM, REMARK, Diagnostic
from fmu_didim.checks.data.expected import Expected
from fmu_didim.estimators.starts.signs import best_values
from fmu_didim.fit.estimate import Estimate

UNSURE = 2.0
"""[standard deviations] Of the noise, within which of zero the sign of a sample may be wrong."""
LEAST_LEFT = 0.3
"""[1] Of the error of base parameters that signs must leave at most, for a log to be one without them."""
BOTH_WAYS = 0.02
"""[1] Of the samples that must have either sign then."""

SIGNS_GIVEN = CATALOGUE(
    "signs-given", REMARK, rank=68,
    meaning="The log shows the size of the torque alone, and has the signs of the simulated one, less what noise adds "
    "to sizes near zero.",
    next_step="",
)  # fmt: skip
LOG_UNSIGNED = CATALOGUE(
    "log-unsigned", PROBLEM, rank=1,
    meaning="The log never goes below zero, and base parameters explain it far better with signs that it does not "
    "have: it seems to show the size of the torque alone.",
    next_step="Say so: torque: {unsigned: true}; or log the torque with its sign.",
)  # fmt: skip


def signs_diagnostics(estimate: Estimate) -> Iterator[Diagnostic]:
    """What is said of the signs of each log that has none."""
    for label in estimate.model.estimation_labels:
        experiment = estimate.model.experiments[label]
        if experiment.is_unsigned:
            simulated = estimate.model.torque(estimate.value, label)
            unsure = int(np.sum(np.abs(simulated) < UNSURE * estimate.noise[: simulated.shape[1]]))
            text = (
                f"The log shows sizes alone; its signs are those of the simulated torque. {unsure} of {simulated.size} "
                "values are so near to zero that theirs may be wrong."
            )
            yield Diagnostic(SIGNS_GIVEN, text, label, float(unsure))


def unsigned_diagnostics(given: Expected, label: str) -> list[Diagnostic]:
    """A log whose columns never go below zero, which all vary, where signs explain it far better."""
    if (given.measured < 0).any() or not np.ptp(given.measured, axis=0).all():  # a constant column is told as one
        return []
    if given.fitted is None or given.columns is None:
        return []
    own = given.error(given.fitted)
    known = np.zeros_like(given.measured) if given.known is None else given.known
    signs = np.ones_like(known) if given.nominal is None else np.sign(given.nominal)
    flat = given.columns.reshape(-1, given.columns.shape[2])
    first = np.asarray(np.linalg.lstsq(flat, (signs * given.measured - known).ravel(), rcond=None)[0])
    theta = best_values(given.columns, known, given.measured, first)[0]
    torque = given.columns @ theta + known
    left = given.error(np.abs(torque))
    ways = min(float(np.mean(torque < 0)), float(np.mean(torque > 0)))
    if left > LEAST_LEFT * own or ways < BOTH_WAYS:
        return []
    text = (
        f"The log never goes below zero. With signs, base parameters leave {100 * left:.0f} % of its deviation along "
        f"the reference; as it stands {100 * own:.0f} %."
    )
    return [Diagnostic(LOG_UNSIGNED, text, label, left / own, LEAST_LEFT, "1")]
