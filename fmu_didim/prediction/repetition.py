"""A motion that repeats need not be simulated to its end: after the transient every period gives the same torque."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmu_didim.master import SampleOperator
from fmu_didim.prediction import thresholds as limits
from fmu_didim.prediction.experiment import Experiment
from fmu_didim.prediction.noise import period_in_ticks
from fmu_didim.signals import Array


@dataclass(frozen=True)
class Repetition:
    """How a log repeats.

    Attributes:
        period: samples in a period; settled: first sample from which the simulated torque repeats.
        operator: from ticks to the first samples alone, up to the end of the overlap.
        count: samples in the whole log.
    """

    period: int
    settled: int
    operator: SampleOperator
    count: int

    def continued(self, begin: Array) -> Array | None:
        """(count, n) from the first samples (N', n); None if these do not repeat."""
        again = self.settled + self.period
        twice = begin[again:] - begin[self.settled : begin.shape[0] - self.period]
        size = np.sqrt(np.mean(begin**2))
        if not np.abs(twice).max() <= limits.REPEATS_COLUMN * size:
            return None
        place = np.arange(self.count)
        late = place >= again
        place[late] = self.settled + (place[late] - self.settled) % self.period
        return np.asarray(begin[place])


def repetition(experiment: Experiment, operator: SampleOperator, step: float, torque: Array) -> Repetition | None:
    """How a simulated torque (N, n) repeats; None if it does not, or not early enough to gain anything.

    Args:
        operator: from ticks to the samples; step: control period, s.
    """
    ticks = period_in_ticks(experiment.reference)
    samples = 0.0 if ticks is None else ticks * step * experiment.rate_hz
    period, count = round(samples), torque.shape[0]
    if period < 1 or abs(samples - period) > limits.WHOLE_SAMPLES or count < limits.FEWEST_PERIODS * period:
        return None
    change = np.abs(torque[period:] - torque[:-period]) > limits.REPEATS_TORQUE * np.sqrt(np.mean(torque**2, axis=0))
    restless = np.flatnonzero(change.any(axis=1))
    settled = int(restless[-1]) + 1 if restless.size else 0
    simulated = settled + period + round(limits.OVERLAP * period)
    if simulated > limits.WORTHWHILE * count:
        return None
    return Repetition(period, settled, operator.before(simulated), count)
