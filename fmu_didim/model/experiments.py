"""The experiments of a loop by label, and tables over those that are fitted.

A table over all measured outputs has a column an output, the torques of the joints first, and a row an instant at which
anything was measured; where an output has no sample its cell is zero, in whatever is measured, simulated or
differentiated, so that it adds nothing to any sum. Without further channels it is the table of the torque.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fmu_didim.cosim import Indices
from fmu_didim.data.filters import LowPass
from fmu_didim.data.signals import Array
from fmu_didim.model.experiment import Experiment


@dataclass(frozen=True, eq=False)
class OutputLog:
    """The samples of an experiment in tables over all outputs: their rows there, and their instants (N,), s."""

    label: str
    rows: slice | Indices
    time: Array


@dataclass(frozen=True)
class OutputBlock:
    """Outputs that were measured together: their columns in tables over all outputs, and their logs."""

    columns: slice
    logs: tuple[OutputLog, ...]

    @property
    def samples(self) -> int:
        """Of each of them, in all logs."""
        return sum(log.time.size for log in self.logs)


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
        """(N, n) torque that the prediction of one experiment is compared with: the log, filtered if asked for, or
        divided by the scales of its samples."""
        return self.compared(self[label].torque, label)

    def compared(self, values: Array, label: str) -> Array:
        """Values at the samples (N, n, ...) of an experiment as a fit compares them: filtered, or scaled."""
        return self[label].scaled(self.filtered(values, label))

    @property
    def measured(self) -> Array:
        """(N, n) the same of all experiments that are fitted."""
        return np.concatenate([self.measured_in(label) for label in self.estimation_labels])

    def recorded_in(self, label: str) -> Array:
        """(N, n) what was logged of an experiment, in its unit, filtered if asked for."""
        own = self[label]
        return self.filtered(own.torque, label) if own.recorded is None else own.recorded

    def unscaled(self, table: Array) -> Array:
        """A table (N, n) of the torque of all experiments that are fitted, in its unit."""
        return np.concatenate([self[label].unscaled(table[rows]) for label, rows in self.rows.items()])

    @property
    def has_error_models(self) -> bool:
        """Whether the scale of some noise follows from what is simulated."""
        models = (m for e in self.values() for m in (*e.errors, *(channel.errors for channel in e.channels)))
        return any(model.follows_simulation for model in models)

    @property
    def typical_scales(self) -> Array:
        """(m,) root mean square of the scales of each output in the experiments that are fitted; one where it has
        none."""
        squares = np.concatenate([np.zeros(self[self.first].torque.shape[1]), np.zeros(len(self.channels))])
        n = squares.size - len(self.channels)
        for experiment in self._fitted:
            squares[:n] += experiment.time.size if experiment.scale is None else (experiment.scale**2).sum(axis=0)
            for channel in experiment.channels:
                size = channel.time.size if channel.scale is None else float(np.sum(channel.scale**2))
                squares[n + self.channels.index(channel.name)] += size
        return np.asarray(np.sqrt(squares / np.maximum(self.output_counts_in(self.estimation_labels), 1.0)))

    def filtered(self, values: Array, label: str) -> Array:
        """Values at the samples (N, ...) of an experiment, filtered if asked for."""
        return values if self.low_pass is None else self.low_pass.apply(values, self[label].rate_hz)

    # ---- all measured outputs, the torque first

    @cached_property
    def channels(self) -> tuple[str, ...]:
        """Names of what was measured beside the torque in experiments that are fitted, in the order of the columns
        after those of the joints; what only a held-out one has is judged there, but in no table."""
        return tuple(dict.fromkeys(channel.name for e in self._fitted for channel in e.channels))

    @property
    def _fitted(self) -> list[Experiment]:
        return [self[label] for label in self.estimation_labels]

    @property
    def torque_alone(self) -> Experiments:
        """The same without what is fitted beside the torque."""
        if not self.channels:
            return self
        return replace(self, by_label={label: replace(e, channels=()) for label, e in self.items()})

    def without_channels(self, names: Sequence[str]) -> Experiments:
        """The same without some of what was measured beside the torque."""
        kept = {
            label: replace(e, channels=tuple(c for c in e.channels if c.name not in names)) for label, e in self.items()
        }
        return replace(self, by_label=kept)

    @property
    def output_rows(self) -> Mapping[str, slice]:
        """Label of each fitted experiment -> its rows in tables over all outputs."""
        if not self.channels:
            return self.rows
        ends = np.cumsum([0, *(self[label].instants.size for label in self.estimation_labels)])
        parts = zip(self.estimation_labels, ends[:-1], ends[1:], strict=True)
        return {label: slice(int(first), int(end)) for label, first, end in parts}

    def outputs_of(self, label: str, torque: Array, further: Sequence[Array]) -> Array:
        """(M, m, ...) table over all outputs of an experiment, held out or not.

        Args:
            torque: (N, n, ...) of the joints; further: (N', ...) of each of its channels, at their own instants.
        """
        if not self.channels:
            return torque
        experiment, n = self[label], torque.shape[1]
        table = np.zeros((experiment.instants.size, n + len(self.channels), *torque.shape[2:]))
        table[experiment.row_of(experiment.time), :n] = torque
        for channel, values in zip(experiment.channels, further, strict=True):
            if channel.name in self.channels:
                table[experiment.row_of(channel.time), n + self.channels.index(channel.name)] = channel.scaled(values)
        return table

    def blocks(self, table: Array) -> list[tuple[slice, Array]]:
        """Columns of the outputs that were measured together, the torques first, and their own samples (N, k, ...) in a
        table (M, m, ...) over all outputs of the experiments that are fitted."""
        if not self.channels:
            return [(slice(0, table.shape[1]), table)]
        return [(b.columns, np.concatenate([table[log.rows, b.columns] for log in b.logs])) for b in self.output_blocks]

    def output_counts_in(self, labels: Sequence[str]) -> Array:
        """(m,) samples of each output in these experiments, held out or not."""
        n = self[self.first].torque.shape[1]
        counts = np.zeros(n + len(self.channels))
        for experiment in (self[label] for label in labels):
            counts[:n] += experiment.time.size
            for channel in experiment.channels:
                if channel.name in self.channels:
                    counts[n + self.channels.index(channel.name)] += channel.time.size
        return counts

    def channels_of(self, label: str, table: Array) -> dict[str, Array]:
        """Name of each channel of an experiment -> its samples (N,) in a table (M, m) over all outputs of that, in its
        unit."""
        experiment, n = self[label], self[label].torque.shape[1]
        return {
            channel.name: channel.unscaled(
                table[experiment.row_of(channel.time), n + self.channels.index(channel.name)]
            )
            for channel in experiment.channels
        }

    @property
    def measured_outputs(self) -> Array:
        """(M, m) all measured outputs of the experiments that are fitted."""
        return np.concatenate([self.measured_outputs_in(label) for label in self.estimation_labels])

    def measured_outputs_in(self, label: str) -> Array:
        """(M, m) the same of one experiment."""
        return self.outputs_of(label, self.measured_in(label), [channel.values for channel in self[label].channels])

    @property
    def output_blocks(self) -> tuple[OutputBlock, ...]:
        """The outputs that were measured together: the torques of all joints, then each channel."""
        n, starts = self[self.first].torque.shape[1], self.output_rows
        torque = [
            OutputLog(label, starts[label], self[label].time)
            if not self.channels
            else OutputLog(label, starts[label].start + self[label].row_of(self[label].time), self[label].time)
            for label in self.estimation_labels
        ]
        blocks = [OutputBlock(slice(0, n), tuple(torque))]
        for k, name in enumerate(self.channels, start=n):
            logs = [
                OutputLog(label, starts[label].start + self[label].row_of(channel.time), channel.time)
                for label in self.estimation_labels for channel in self[label].channels if channel.name == name
            ]  # fmt: skip
            blocks.append(OutputBlock(slice(k, k + 1), tuple(logs)))
        return tuple(blocks)

    @property
    def output_counts(self) -> Array:
        """(m,) samples of each output in the experiments that are fitted."""
        return np.concatenate(
            [np.full(b.columns.stop - b.columns.start, float(b.samples)) for b in self.output_blocks]
        )  # fmt: skip

    @property
    def stated_deviations(self) -> Array:
        """(k,) known standard deviations of the noise of each channel; NaN where it is estimated."""
        stated = {c.name: np.nan if c.deviation is None else c.deviation for e in self._fitted for c in e.channels}
        return np.array([stated[name] for name in self.channels])

    def torque_of(self, table: Array) -> Array:
        """(N, n, ...) torque in a table (M, m, ...) over all outputs of the experiments that are fitted."""
        if not self.channels:
            return table
        block = self.output_blocks[0]
        return np.concatenate([table[log.rows, block.columns] for log in block.logs])

    def fitted(self, labels: Sequence[str]) -> Experiments:
        """Only these experiments, all of them for the estimation."""
        return replace(self, by_label={label: replace(self[label], role="estimation") for label in labels})

    def with_experiment(self, label: str, experiment: Experiment) -> Experiments:
        """The same with other data under a label."""
        return replace(self, by_label={**self.by_label, label: experiment})
