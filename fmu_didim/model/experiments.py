"""The experiments of a loop by label, and tables over those that are fitted."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fmu_didim.data.low_pass import LowPass
from fmu_didim.data.signals import Array
from fmu_didim.model.experiment import Experiment


@dataclass(frozen=True, eq=False)
class Experiments(Mapping[str, Experiment]):
    """Experiments by label. Tables over several of them hold their samples one below the other.

    Attributes:
        by_label: label -> data, those for the estimation first.
        low_pass: filter of the torque and of the regressor.
    """

    by_label: Mapping[str, Experiment]
    low_pass: LowPass | None = None

    def __getitem__(self, label: str) -> Experiment:
        return self.by_label[label]

    def __iter__(self) -> Iterator[str]:
        return iter(self.by_label)

    def __len__(self) -> int:
        return len(self.by_label)

    @cached_property
    def estimation_labels(self) -> tuple[str, ...]:
        """Labels of the experiments that are fitted."""
        return tuple(label for label, e in self.items() if e.role == "estimation")

    @cached_property
    def validation_labels(self) -> tuple[str, ...]:
        """Labels of the experiments that are held out."""
        return tuple(label for label, e in self.items() if e.role == "validation")

    @property
    def first(self) -> str:
        """Label of the first experiment."""
        return next(iter(self))

    @property
    def rows(self) -> Mapping[str, slice]:
        """Label of each fitted experiment -> its rows in tables over all of them."""
        found, first = {}, 0
        for label in self.estimation_labels:
            count = self[label].time.size
            found[label] = slice(first, first + count)
            first += count
        return found

    @property
    def time(self) -> Array:
        """(N,) instants of the logs that are fitted, s."""
        return np.concatenate([self[label].time for label in self.estimation_labels])

    def measured_in(self, label: str) -> Array:
        """(N, n) torque that the prediction of one experiment is compared with: the log, filtered if asked for."""
        return self.filtered(self[label].torque, label)

    @property
    def measured(self) -> Array:
        """(N, n) the same of all experiments that are fitted."""
        return np.concatenate([self.measured_in(label) for label in self.estimation_labels])

    def filtered(self, values: Array, label: str) -> Array:
        """Values at the samples (N, ...) of an experiment, filtered if asked for."""
        return values if self.low_pass is None else self.low_pass.apply(values, self[label].rate_hz)

    def fitted(self, labels: Sequence[str]) -> Experiments:
        """Only these experiments, all of them for the estimation."""
        return replace(self, by_label={label: replace(self[label], role="estimation") for label in labels})

    def with_experiment(self, label: str, experiment: Experiment) -> Experiments:
        """The same with other data under a label."""
        return replace(self, by_label={**self.by_label, label: experiment})
