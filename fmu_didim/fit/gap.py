"""The gap between simulation and measurement, and the significance of a comparison of two models.

    gap_j = sqrt( max( mean(r_j^2) / sigma_j^2 - 1, 0 ) )        model error of joint j in units of its noise

is the residual r without the noise; 1 means a model error as large as the noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fmu_didim.base.errors import SimulationError
from fmu_didim.data.signals import Array
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.noise.noise import TINY, Noise, effective_fraction
from fmu_didim.fit.statistics import CONFIDENCE
from fmu_didim.model.experiments import Experiments
from fmu_didim.model.loop_model import LoopModel

BOOTSTRAP = 2000
"""[draws] Of the bootstrap: the ends of a 95 % interval then stand still."""
BLOCK_S = 0.5
"""[s] Length of the blocks of the bootstrap: longer than the memory of friction and of the loop."""
VARIANCE_FLOOR = 0.25
"""[1] Of the variance of the noise, below which no residual counts as better: a BIC difference is that of model
error. Half of the noise in size, which may be an upper bound."""


def joint_gaps(residual: Array, noise: Noise) -> Array:
    """(n,) gap of each joint in units of its noise."""
    return np.asarray(np.sqrt(np.maximum(np.mean(residual**2, axis=0) / noise.deviation**2 - 1, 0.0)))


def total_gap(residual: Array, noise: Noise) -> float:
    """Gap over all joints: root of the mean square, each joint in units of its noise."""
    return float(np.sqrt(max(float(np.mean((residual / noise.deviation) ** 2)) - 1, 0.0)))


def gaps(fit: Fit) -> dict[str, Array]:
    """Label of each experiment -> (n,) gap of the torque of each joint; infinite where the model cannot be run."""
    result, noise = {}, fit.noise.of(slice(0, fit.model.joint_count))
    for label in fit.model.experiments:
        try:
            result[label] = joint_gaps(fit.residual_in(label), noise)
        except SimulationError:
            result[label] = np.full(fit.model.joint_count, np.inf)
    return result


def channel_gaps(fit: Fit) -> dict[str, dict[str, float]]:
    """Label of each experiment -> name of each channel that is fitted -> its gap there; infinite where the model cannot
    be run."""
    names, n = fit.model.experiments.channels, fit.model.joint_count
    result = dict[str, dict[str, float]]()
    for label, experiment in fit.model.experiments.items() if names else ():
        measured = {c.name: c.values for c in experiment.channels if c.name in names}
        try:
            simulated = fit.simulation(label).channels()
        except SimulationError:
            result[label] = dict.fromkeys(measured, np.inf)
            continue
        result[label] = {
            name: float(joint_gaps((values - simulated[name])[:, None], fit.noise.of(slice(k, k + 1)))[0])
            for name, values in measured.items() for k in (n + names.index(name),)
        }  # fmt: skip
    return result


@dataclass(frozen=True)
class Pair:
    """Residuals (N, k) of two models, of outputs that were measured together, and the noise (k,) of these."""

    before: Array
    after: Array
    noise: Noise


def pairs(before: Fit, after: Fit, noise: Noise) -> list[Pair]:
    """The residuals of all outputs of two fits of the same data."""
    return _pairs(before.model.experiments, before.residual, after.residual, noise)


def _pairs(experiments: Experiments, before: Array, after: Array, noise: Noise) -> list[Pair]:
    both = zip(experiments.blocks(before), experiments.blocks(after), strict=True)
    return [Pair(first, second, noise.of(columns)) for (columns, first), (_, second) in both]


def bic_difference(experiments: Experiments, before: Array, after: Array, cost: float, noise: Noise) -> float:
    """:func:`delta_bic` over all outputs, of residuals (M, m) that no fit belongs to."""
    return _bic(_pairs(experiments, before, after, noise), cost)


def bic_gain(before: Fit, after: Fit, cost: float, noise: Noise) -> float:
    """:func:`delta_bic` over all outputs of two fits of the same data. What outputs share counts once: the gain is
    divided by the largest variance of a value of the larger model over that of independent outputs."""
    if not before.model.experiments.channels:
        return delta_bic(before.residual, after.residual, cost, noise)
    own = [i for i, p in enumerate(after.model.free_parameters) if p.effect is not None and not p.is_shape]
    variance = after.shared_variance
    return _bic(pairs(before, after, noise), cost, once=float(variance[own].max() if own else variance.max()))


def delta_bic(before: Array, after: Array, cost: float, noise: Noise) -> float:
    """Gain in the Bayesian information criterion by a larger model, > 0 in favour of it.

        sum_j N f_j log(s_j^2 before / s_j^2 after) - cost log(sum_j N f_j)

    with the variances s^2 of the residuals (N, n), never below the noise, and f from the colour of the better residual,
    so that model error that neither explains is not taken for independent noise.

    Args:
        cost: number of additional parameters of the larger model.

    Source: Schwarz, Annals of Statistics 6 (1978), with the effective number of samples of an autoregression.
    """
    return _bic([Pair(before, after, noise)], cost)


def _bic(compared: Sequence[Pair], cost: float, *, once: float = 1.0) -> float:
    """The same over several outputs; ``once``: by how much more they seem to say than they do."""
    gains, counts = [], []
    for pair in compared:
        floor = VARIANCE_FLOOR * pair.noise.deviation**2
        first = np.maximum(np.mean(pair.before**2, axis=0), floor)
        second = np.maximum(np.mean(pair.after**2, axis=0), floor)
        count = pair.before.shape[0] * effective_fraction(pair.after)
        gains.append(count * np.log(first / second))
        counts.append(count)
    gain, samples = np.sum(np.concatenate(gains)), np.concatenate(counts).sum()
    return float(gain / once - cost * np.log(max(float(samples), 2.0)))


@dataclass(frozen=True)
class Ratio:
    """RMS after / RMS before on the same samples: value and its 95 % interval."""

    value: float
    low: float
    high: float


def rms_ratio(before: Array, after: Array, noise: Noise, *, block: int, seed: int = 0) -> Ratio:
    """Ratio of the weighted RMS of two residuals (N, n), with the interval of a block bootstrap.

    Args:
        block: samples in a block.
        seed: of the bootstrap.

    Source: Kuensch, Annals of Statistics 17 (1989): the blocks keep the correlation of neighbouring samples.
    """
    first, second = (np.sum((r / noise.deviation) ** 2, axis=1) for r in (before, after))
    totals = drawn_sums(np.column_stack([first, second]), block=block, seed=seed)
    ratios = np.sqrt(totals[:, 1] / np.maximum(totals[:, 0], TINY))
    value = float(np.sqrt(second.sum() / max(float(first.sum()), TINY)))
    outside = (1 - CONFIDENCE) / 2
    return Ratio(value, float(np.quantile(ratios, outside)), float(np.quantile(ratios, 1 - outside)))


def drawn_sums(columns: Array, *, block: int, seed: int = 0) -> Array:
    """(BOOTSTRAP, m) sums of columns (N, m) over blocks that are drawn with replacement."""
    sums = block_sums(columns, block=block)
    drawn = np.random.default_rng(seed).integers(0, len(sums), size=(BOOTSTRAP, len(sums)))
    return np.asarray(sums[drawn].sum(axis=1))


def block_sums(columns: Array, *, block: int) -> Array:
    """(B, m) sums of columns (N, m) over blocks of about so many rows."""
    samples = columns.shape[0]
    edges = np.linspace(0, samples, max(samples // max(block, 1), 1) + 1).astype(int)
    return np.array([columns[a:b].sum(axis=0) for a, b in pairwise(edges)])


def held_out_ratio(before: Fit, after: Fit, *, seed: int = 0) -> Ratio | None:
    """Ratio of the held-out RMS of two models; None without held-out data, worse than any if one cannot be run."""
    if not before.model.experiments.validation_labels:
        return None
    try:
        first, second = held_out_residual(before), held_out_residual(after)
    except SimulationError:
        return Ratio(np.inf, np.inf, np.inf)
    return rms_ratio(first, second, before.noise, block=held_out_block(before), seed=seed)


def held_out_ratios(before: Fit, after: Fit, *, seed: int = 0) -> list[tuple[int, Ratio]]:
    """Output, from 1, the joints first, and its ratio of the held-out RMS of two models; empty without held-out data,
    and without those that were not held out."""
    if not before.model.experiments.validation_labels:
        return []
    try:
        first, second = held_out_residual(before), held_out_residual(after)
    except SimulationError:
        return []
    noise, block = before.noise, held_out_block(before)
    return [
        (j + 1, rms_ratio(first[:, [j]], second[:, [j]], noise.of(slice(j, j + 1)), block=block, seed=seed))
        for j in range(first.shape[1]) if j < before.model.joint_count or first[:, j].any()
    ]  # fmt: skip


def held_out_blocks(before: Fit, after: Fit) -> float:
    """Effective number of blocks of held-out data in which two models differ, (sum d)^2 / sum d^2 of the squares d by
    which they do in a block; infinite where one cannot be run, or there are no such data (Kish's effective size)."""
    if not before.model.experiments.validation_labels:
        return np.inf
    try:
        change = held_out_residual(before) - held_out_residual(after)
    except SimulationError:
        return np.inf
    squares = np.sum((change / before.noise.deviation) ** 2, axis=1)
    sums = block_sums(squares[:, None], block=held_out_block(before))[:, 0]
    return float(sums.sum() ** 2 / max(float(sums @ sums), TINY))


def held_out_residual(fit: Fit) -> Array:
    """(Mv, m) residual of all outputs of all held-out experiments, the torque first; raises SimulationError."""
    experiments = fit.model.experiments
    labels = experiments.validation_labels
    if not experiments.channels:
        return np.concatenate([fit.residual_in(label) for label in labels])
    return np.concatenate(
        [experiments.measured_outputs_in(label) - fit.simulation(label).outputs() for label in labels]
    )  # fmt: skip


def held_out_block(fit: Fit) -> int:
    """Rows in a block of the bootstrap of held-out data."""
    return block_in(fit.model, fit.model.experiments.validation_labels[0])


def block_in(model: LoopModel, label: str) -> int:
    """Rows in a block of the bootstrap of the data of an experiment."""
    one = model.experiments[label]
    rate = one.rate_hz
    if model.experiments.channels:  # all that was measured in a block of time is drawn together
        rate = one.instants.size / float(np.ptp(one.instants))
    return max(round(BLOCK_S * rate), 1)


def explained_gap(before: Fit, after: Fit, noise: Noise) -> tuple[float, float]:
    """:func:`explained` over all outputs of two fits of the same data."""
    return _explained(pairs(before, after, noise))


def explained(before: Array, after: Array, noise: Noise) -> tuple[float, float]:
    """Gain by a larger model: RMS in units of the noise, on the joint where it explains most, and the share of
    the gap of all joints."""
    return _explained([Pair(before, after, noise)])


def _explained(compared: Sequence[Pair]) -> tuple[float, float]:
    first = np.concatenate([np.mean((pair.before / pair.noise.deviation) ** 2, axis=0) for pair in compared])
    second = np.concatenate([np.mean((pair.after / pair.noise.deviation) ** 2, axis=0) for pair in compared])
    size = float(np.sqrt(max(float((first - second).max()), 0.0)))
    room = float(np.sum(np.maximum(first - 1, 0.0)))
    return size, float(np.clip(np.sum(first - second) / room, 0.0, 1.0)) if room > 0 else 0.0


def part_of_gap(first: Fit, before: Fit, after: Fit, noise: Noise) -> float:
    """:func:`part_of_first` over all outputs of fits of the same data."""
    blocks = first.model.experiments.blocks
    squares = [
        np.concatenate([np.mean((r / noise.of(columns).deviation) ** 2, axis=0) for columns, r in blocks(f.residual)])
        for f in (first, before, after)
    ]
    return _part_of_first(squares)


def part_of_first(first: Array, before: Array, after: Array, noise: Noise) -> float:
    """Gain by a larger model on the joint where it gains most, as a fraction of the first model's gap there.

    Args:
        first, before, after: residuals (N, n) of the first model, and without and with the addition.
    """
    return _part_of_first([np.mean((r / noise.deviation) ** 2, axis=0) for r in (first, before, after)])


def _part_of_first(squares: Sequence[Array]) -> float:
    joint = int(np.argmax(squares[1] - squares[2]))
    room = float(squares[0][joint] - 1.0)
    gained = float(squares[1][joint] - squares[2][joint])
    return gained / room if room > 0 else 1.0
