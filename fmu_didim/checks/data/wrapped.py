"""Logs of counts that wrapped: beyond the largest number of its integer type, a channel goes on at the smallest one.

Where a torque x passes the end of a range of width W, the log shows x - W. A step between two samples over most of the
range of the log is such a passage; beside what the torque moves anyhow, (d_(i-1) + d_(i+1)) / 2 of the steps before and
after, it is W long. So W is the median of those lengths, x follows from the log but for whole multiples of W, and base
parameters along the reference explain it if that is what happened.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, PROBLEM, Diagnostic
from fmu_didim.checks.data.expected import Expected
from fmu_didim.data.signals import Array

PASSAGE = 0.6
"""[1] Of the range of a log, from which a step between two samples may be a passage."""
FEWEST = 2
"""[passages] That tell their length: there and back."""
SPIKE = 2
"""[samples] Between a passage and the way back, up to which they may be outliers instead."""
ALIKE = 0.15
"""[1] Of the width, within which most passages must be of one length, from one end of the range to the other: a load
that comes and goes steps from where the torque is."""
WITHIN = 75.0
"""[%] Of the passages, of which that is asked: a reversal of friction may be one."""
LEAST_LEFT = 0.5
"""[1] Of the error of base parameters that a log without wraps must leave at most, joint by joint. Where friction
reverses within a sample its steps look like passages, but the log without them is explained worse."""
MULTIPLES = (-1, 0, 1)
"""[widths] By which the first sample may itself be beyond the range."""

LOG_WRAPPED = CATALOGUE(
    "log-wrapped", PROBLEM, rank=1,
    meaning="A torque column jumps from one end of its range to the other, and base parameters explain it far better "
    "without these jumps: its counts seem to have wrapped, as an integer that is too small for them does.",
    next_step="Take the jumps out before the counts are scaled, such as by numpy.unwrap(counts, period=65536) of 16 "
    "bits, or log with more bits or a larger unit.",
)  # fmt: skip


@dataclass(frozen=True)
class Wraps:
    """The passages of a column.

    Attributes:
        width: W; count: of the passages.
    """

    width: float
    count: int


def wraps(values: Array) -> Wraps | None:
    """The passages of a column (N,) from one end of its range to the other; None where there are none of one length."""
    steps = np.diff(values)
    is_far = np.abs(steps) > PASSAGE * np.ptp(values)
    far = np.flatnonzero(is_far)
    if far.size < FEWEST:
        return None
    back = (np.diff(far) <= SPIKE) & (np.diff(np.sign(steps[far])) != 0)
    far = far[~(np.append(back, False) | np.append(False, back))]
    if far.size < FEWEST:
        return None
    near = np.where(is_far, 0.0, steps)
    around = (near[np.maximum(far - 1, 0)] + near[np.minimum(far + 1, steps.size - 1)]) / 2
    lengths = np.abs(steps[far] - around)
    width = float(np.median(lengths))
    ends = np.sort(np.stack([values[far], values[far + 1]]), axis=0) - [[values.min()], [values.max()]]
    off = np.maximum(np.abs(lengths - width), np.abs(ends).max(axis=0))
    return Wraps(width, int(far.size)) if np.percentile(off, WITHIN) <= ALIKE * width else None


def wrapped_diagnostics(given: Expected, label: str) -> list[Diagnostic]:
    """The columns whose counts wrapped, in one experiment."""
    if given.fitted is None:
        return []
    found = []
    for j in range(given.measured.shape[1]):
        one = wraps(given.measured[:, j])
        if one is None:
            continue
        own, left = _error(given, j), min(_error(_unwrapped(given, j, one.width, k), j) for k in MULTIPLES)
        if left <= LEAST_LEFT * own:
            text = (
                f"The log jumps {one.count} times by {one.width:.4g}, over most of its range. Without these jumps base "
                f"parameters leave {left:.4g} of it along the reference, as it stands {own:.4g} (root mean squares)."
            )
            found.append(Diagnostic(LOG_WRAPPED, text, f"{label}: joint {j + 1}", left / own, LEAST_LEFT, "1"))
    return found


def _unwrapped(given: Expected, j: int, width: float, multiple: int) -> Expected:
    measured = given.measured.copy()
    measured[:, j] = np.unwrap(measured[:, j], period=width) + multiple * width
    return replace(given, measured=measured)


def _error(given: Expected, j: int) -> float:
    """Root mean square of what base parameters leave of a joint."""
    assert given.fitted is not None
    return float(np.sqrt(np.mean((given.measured[:, j] - given.fitted[:, j]) ** 2)))
