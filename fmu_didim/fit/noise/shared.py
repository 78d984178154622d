"""Noise that outputs share: what the feedback of the loop carries from one into the others.

The control law turns whatever moves a joint, a disturbance or model error, into torque. So the residuals of torque and
position are largely the same noise twice, and counting them as independent makes standard deviations too small, by a
factor sqrt(2) where they share all. With the parts s_jk = sum over a block k of time of Phi_j' r_j, by which output j
moves the values, the variance of their sum over that of independent outputs is

    f^2 = sum_k (sum_j s_jk)^2 / sum_k sum_j s_jk^2

for each value. Blocks are longer than the noise remembers.

Torques of joints share noise where they were made of those of motors that drive several (``motors:`` of a file): the
noise of such a motor is in all of them.

Source: Kuensch, Annals of Statistics 17 (1989), for blocks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fmu_didim.cosim import Indices
from fmu_didim.data.signals import Array
from fmu_didim.model.experiments import Experiments

SHORTEST_BLOCK_S = 0.5
"""[s] Shortest block: longer than the memory of friction and of the loop."""
MEMORIES = 2.0
"""[1] A block holds as many times the time that the noise remembers, so that most of what outputs share, with what lag
it ever is, lies in one."""
FEWEST_BLOCKS = 12
"""[blocks] At least, if they must be shorter for it: variances of fewer say little."""
LEAST_SHARED = 0.1
"""[1] Of the variance of independent outputs, where they cancel: a smaller one is chance."""


@dataclass(frozen=True)
class Part:
    """Samples of outputs in an experiment: its label, their rows (N,) and columns in tables over all outputs, and their
    instants (N,), s."""

    experiment: str
    rows: slice | Indices
    columns: slice
    time: Array


def parts_of_outputs(experiments: Experiments) -> list[Part]:
    """The samples of all outputs that are fitted; torques that share noise each as an output of its own."""
    return [
        Part(log.label, log.rows, columns, log.time)
        for block in experiments.output_blocks
        for log in block.logs
        for columns in (_single(block.columns) if experiments[log.label].shares_noise else [block.columns])
    ]


def _single(columns: slice) -> list[slice]:
    return [slice(k, k + 1) for k in range(columns.start, columns.stop)]


def remembered_s(residual: Array, time: Array) -> float:
    """Time in s that noise (N,) remembers, by the correlation of neighbouring samples as of a first-order
    autoregression."""
    square = float(residual @ residual)
    rho = float(residual[1:] @ residual[:-1]) / square if square > 0 else 0.0
    rho = float(np.clip(rho, 0.0, 1 - 2 / residual.size))
    return float(np.median(np.diff(time))) * (1 + rho) / (1 - rho)


def shared_variance(influence: Array, residual: Array, parts: Sequence[Part]) -> Array:
    """(p,) variance of each value over that of independent outputs.

    Args:
        influence: (M, m, p); residual: (M, m); parts: of all experiments, the first of each with its torques, which
            count as independent of each other here as everywhere but where motors drive several joints.
    """
    independent, together = np.zeros((2, influence.shape[2]))
    for experiment in sorted({part.experiment for part in parts}):
        own = [part for part in parts if part.experiment == experiment]
        edges, sums = _blocks(residual, own), []
        for part in own:
            products = influence[part.rows, part.columns] * residual[part.rows, part.columns][:, :, None]
            blocks = np.zeros((edges.size - 1, *products.shape[1:]))
            np.add.at(blocks, np.searchsorted(edges[1:-1], part.time, side="right"), products)
            independent += (blocks**2).sum(axis=(0, 1))
            sums.append(blocks.sum(axis=1))
        together += (np.sum(sums, axis=0) ** 2 - np.sum(np.square(sums), axis=0)).sum(axis=0)
    return np.maximum(1 + together / np.where(independent > 0, independent, 1.0), LEAST_SHARED)


def variance_by_sharing(influence: Array, residual: Array, experiments: Experiments) -> Array:
    """(p,) the same of the outputs of experiments, at least 1: what outputs share by chance makes no value better
    known. 1 where there is nothing beside the torque, and no motor drives several joints."""
    if not experiments.channels and not any(experiments[label].shares_noise for label in experiments.estimation_labels):
        return np.ones(influence.shape[2])
    return np.maximum(shared_variance(influence, residual, parts_of_outputs(experiments)), 1.0)


def counted_once(covariance: Array, by_sharing: Array) -> Array:
    """A covariance (p, p) with variances that are larger by what outputs share (p,)."""
    factor = np.sqrt(by_sharing)
    return np.asarray(covariance * np.outer(factor, factor))


def _blocks(residual: Array, parts: Sequence[Part]) -> Array:
    """Edges of the blocks of an experiment, s."""
    first, last = min(part.time[0] for part in parts), max(part.time[-1] for part in parts)
    memory = max(remembered_s(column, part.time) for part in parts for column in residual[part.rows, part.columns].T)
    length = max(MEMORIES * memory, SHORTEST_BLOCK_S)
    count = max(int((last - first) / length), FEWEST_BLOCKS)
    return np.linspace(first, last, count + 1)
