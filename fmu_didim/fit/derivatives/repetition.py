"""A motion that repeats need not be simulated to its end: after the transient every period gives the same torque."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fmu_didim.cosim import SampleOperator
from fmu_didim.data.signals import Array
from fmu_didim.fit.noise.noise import period_in_ticks
from fmu_didim.model.experiment import Experiment
from fmu_didim.model.loop_model import Simulation

REPEATS_TORQUE = 1e-5
"""[1] Two periods of a torque are the same when they differ by less than this fraction of its root mean square."""
MARGIN = 0.1
"""[1] Fraction of a period after which a column of sensitivities repeats, once the torque does."""
REPEATS_COLUMN = 1e-3
"""[1] The same for columns of sensitivities, which are differences."""
OVERLAP = 0.1
"""[1] Fraction of a period simulated twice, to see whether a column repeats like the torque."""
WHOLE_SAMPLES = 1e-6
"""[samples] A period that is farther from a whole number of samples is not continued."""
FEWEST_PERIODS = 1.5
"""[periods] A log of fewer is simulated to its end."""
WORTHWHILE = 0.8
"""[1] Fraction of a log up to which its first part is simulated alone: beyond, nothing is saved."""


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

    def continued(self, begin: Array, *, tolerance: float = REPEATS_COLUMN) -> Array | None:
        """(count, ...) from the first samples (N', ...); None if these do not repeat."""
        again = self.settled + self.period
        twice = begin[again:] - begin[self.settled : begin.shape[0] - self.period]
        size = np.sqrt(np.mean(begin**2, axis=(0, 1)))
        if not (np.abs(twice).max(axis=(0, 1)) <= tolerance * size).all():
            return None
        place = np.arange(self.count)
        late = place >= again
        place[late] = self.settled + (place[late] - self.settled) % self.period
        return np.asarray(begin[place])


@dataclass(frozen=True)
class Beginning:
    """The first part of an experiment, from which all of a change of its outputs follows where that repeats.

    Attributes:
        repetition: how the log repeats; outputs: (N, n) simulated torque, of all of it.
    """

    repetition: Repetition
    outputs: Array

    @staticmethod
    def of(run: Simulation, torque: Array) -> Beginning | None:
        """The first part of an experiment; None where its torque (N, n) does not repeat early enough, or more than the
        torque was measured, or its samples have scales of their own."""
        if run.model.experiments.channels or run.experiment.scale is not None:
            return None
        if run.model.experiments.low_pass is not None or "t_start" in {v.name for v in run.model.loop.plant.parameters}:
            return None  # the ends of a filtered log are not like its middle; a plant with a clock need not repeat
        found = repetition(run.experiment, run.experiment.operator, run.step_size, torque)
        return None if found is None else Beginning(found, torque)

    def cut(self, run: Simulation) -> Simulation:
        """A simulation of the experiment up to the first samples alone."""
        return run.on(replace(run.experiment, operator=self.repetition.operator))

    @property
    def first(self) -> Array:
        """(N', n) torque of the first samples."""
        return self.outputs[: self.repetition.operator.count]


def change_of_outputs(
    run: Simulation, outputs: Array, beginning: Beginning | None, *, tolerance: float = REPEATS_COLUMN
) -> Array:
    """(M, m) simulated outputs minus ``outputs``, from the beginning alone where the change repeats.

    Args:
        beginning: None where all of the experiment has to be simulated.
        tolerance: largest difference of two periods of the change, relative to its root mean square.
    """
    if beginning is not None:
        begun = beginning.cut(run).outputs() - beginning.first
        change = beginning.repetition.continued(begun, tolerance=tolerance)
        if change is not None:
            return change
    return np.asarray(run.outputs() - outputs)


def repetition(experiment: Experiment, operator: SampleOperator, step: float, torque: Array) -> Repetition | None:
    """How a simulated torque (N, n) repeats; None if it does not, or not early enough to gain anything.

    Args:
        operator: from ticks to the samples; step: control period, s.
    """
    ticks = period_in_ticks(experiment.reference)
    samples = 0.0 if ticks is None else ticks * step * experiment.rate_hz
    period, count = round(samples), torque.shape[0]
    if period < 1 or abs(samples - period) > WHOLE_SAMPLES or count < FEWEST_PERIODS * period:
        return None
    change = np.abs(torque[period:] - torque[:-period]) > REPEATS_TORQUE * np.sqrt(np.mean(torque**2, axis=0))
    restless = np.flatnonzero(change.any(axis=1))
    # Slopes take longer to forget the start than the torque itself.
    settled = (int(restless[-1]) + 1 if restless.size else 0) + round(MARGIN * period)
    simulated = settled + period + round(OVERLAP * period)
    if simulated > WORTHWHILE * count:
        return None
    return Repetition(period, settled, operator.before(simulated), count)
