"""Outliers of a log, in the residual of a robust fit along the simulated motion.

Base parameters by Tukey's biweight, theta = argmin sum rho(r / s) with s = 1.4826 median |r|: what single samples are
off by then stands in their residual alone, at any rate of the log. Noise with heavy tails has no outliers: of a tail of
index a, the k-th largest of the sizes |r| is larger than the next one by the factor

    g_k    with probability g_k^(-a k)    (Rényi 1953),

so that outliers are the k samples above a gap that such noise does not leave.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from fmu_didim.base.diagnostics import Diagnostic
from fmu_didim.base.distributions import DEVIATION_OF_MEDIAN
from fmu_didim.checks.data.expected import solved_from
from fmu_didim.checks.data.linear_fit import EXACT, FittedMotion
from fmu_didim.checks.data.log import FEW_OUTLIERS, LOG_OUTLIERS, MOST_SPIKES, NEIGHBOURS
from fmu_didim.checks.judgement import MATTERS
from fmu_didim.cosim import Indices
from fmu_didim.data.signals import Array
from fmu_didim.fit.base_projection import BaseProjection
from fmu_didim.fit.noise.noise import TINY, effective_fraction

TUKEY = 4.685
"""[standard deviations] Residuals beyond count nothing: 95 % of the efficiency of least squares with normal noise."""
ROUNDS = 10
"""[fits] Of the reweighting."""
TAIL = 3.0
"""[1] Index of the heaviest tail that still is noise: that of Student's t with three degrees of freedom."""
CHANCE = 1e-3
"""[1] Probability with which such noise may leave a gap in the log of a joint."""
FAR = 5.0
"""[standard deviations] From which a sample may be an outlier."""
BY_MOTION = 3.0
"""[standard deviations] Of a mean rank, from which outliers belong to the motion: of their speeds, as at reversals of
friction that the model has otherwise, or of the residuals beside them, which errors of single samples leave alone."""
BESIDE = 2
"""[samples] Of those to each side."""
RANK_DEVIATION = 0.2887
"""[1] Standard deviation of a rank between 0 and 1 by chance."""


def outliers(fitted: FittedMotion) -> dict[int, Indices]:
    """Joint (from 0) -> the samples of the log that are outliers, of those that have some."""
    residual, torque = _robust_residual(fitted), fitted.experiment.torque
    found = {j: outlying(residual[:, j], fitted.sampled_speed[:, j], torque[:, j]) for j in range(residual.shape[1])}
    return {j: rows for j, rows in found.items() if rows.size}


def outlying(residual: Array, speed: Array, torque: Array) -> Indices:
    """The samples of a joint that are outliers, by its residual (N,), its speed (N,) and the torque of its log (N,)."""
    sizes = np.abs(residual)
    rows = _settled(_above_gap(sizes, EXACT * float(torque.std())))
    return rows[:0] if rows.size and _follows_motion(rows, sizes, speed) else rows


def outlier_diagnostics(fitted: FittedMotion, found: Mapping[int, Indices]) -> list[Diagnostic]:
    """What is said of outliers; ``found``: see :func:`outliers`."""
    residual, told = _robust_residual(fitted), []
    for j, rows in found.items():
        wrong = np.zeros_like(residual)
        wrong[rows, j] = residual[rows, j]
        left = residual - wrong
        moved = _moved(fitted, wrong, left)
        text = f"They move the values by {moved:.2g} standard deviations, all together."
        place, noise = f"{fitted.run.label}: joint {j + 1}", float(left[:, j].std())
        told.append(told_outliers(place, rows, residual[:, j], fitted.experiment.time, noise, moved, text))
    return told


def told_outliers(
    place: str, rows: Indices, residual: Array, time: Array, noise: float, moved: float, text: str
) -> Diagnostic:
    """What is said of the outliers of a joint.

    Args:
        rows: of the outliers; residual, time: (N,) of all samples; noise: deviation of the rest of the residual.
        moved: standard deviations by which they move the values; text: what is said of that.
    """
    largest, first = float(np.abs(residual[rows]).max()), ", ".join(f"{t:.6g}" for t in time[rows[:3]])
    text = (
        f"{rows.size} of {residual.size} samples are off by up to {largest:.4g}, {largest / max(noise, TINY):.3g} "
        f"times the rest of the residual; the first at t = {first} s. {text}"
    )
    code = FEW_OUTLIERS if moved <= MATTERS else LOG_OUTLIERS
    return Diagnostic(code, text, place, moved, MATTERS, "standard deviations")


def without(fitted: FittedMotion, rows: Iterable[Indices]) -> FittedMotion:
    """The same motion without these samples of the log."""
    kept = np.setdiff1d(np.arange(fitted.experiment.time.size), np.concatenate(list(rows)))
    return replace(fitted, run=fitted.run.on(fitted.experiment.at(kept)))


def _robust_residual(fitted: FittedMotion) -> Array:
    """(N, n) residual of the log as it is, not filtered, by Tukey's biweight."""
    columns, known = fitted.sampled
    target = fitted.experiment.torque - known
    size, weight = fitted.size, np.ones_like(target)
    flat, right = columns / size[:, None], target / size
    residual = right
    for _ in range(ROUNDS):
        weighted = flat * weight[:, :, None]
        products = np.tensordot(weighted, flat, axes=((0, 1), (0, 1)))
        residual = right - flat @ solved_from(products, np.tensordot(weighted, right, axes=((0, 1), (0, 1))))[0]
        scale = np.maximum(DEVIATION_OF_MEDIAN * np.median(np.abs(residual), axis=0), TINY)
        weight = np.maximum(1 - (residual / (TUKEY * scale)) ** 2, 0.0) ** 2
    return np.asarray(residual * size)


def _above_gap(sizes: Array, floor: float) -> Indices:
    """The samples above the clearest gap in sizes (N,), none where noise with a heavy tail may leave it.

    Args:
        floor: below which a residual is the error of the simulation.
    """
    order = np.argsort(-sizes)
    most = int(MOST_SPIKES * sizes.size)
    if most < 1:
        return order[:0]
    largest = np.maximum(sizes[order[: most + 1]], floor + TINY)
    gaps = TAIL * np.arange(1, most + 1) * np.log(largest[:-1] / largest[1:])
    gaps[largest[:-1] < FAR * DEVIATION_OF_MEDIAN * np.median(sizes)] = 0.0
    k = int(np.argmax(gaps))
    rows = np.sort(order[: k + 1])
    return rows if gaps[k] > np.log(most / CHANCE) else rows[:0]


def _settled(rows: Indices) -> Indices:
    """The outliers without those while a loop swings in: from the beginning of the log on, hardly interrupted."""
    ends = np.flatnonzero(np.diff(rows, prepend=0) > NEIGHBOURS)
    return rows[ends[0] :] if ends.size else rows[:0]


def _follows_motion(rows: Indices, sizes: Array, speed: Array) -> bool:
    """Whether outliers belong to the motion: by the speeds (N,) of the joint, of which neighbours count once, or by the
    sizes (N,) of the residual beside them."""
    events = rows[np.append(True, np.diff(rows) > 1)]
    beside = np.unique(rows[:, None] + np.append(np.arange(-BESIDE, 0), np.arange(1, BESIDE + 1)))
    beside = np.setdiff1d(beside[(beside >= 0) & (beside < sizes.size)], rows)
    others = np.delete(np.arange(sizes.size), rows)
    rank = np.searchsorted(np.sort(sizes[others]), sizes[beside]) / others.size
    return _is_unlikely(abs(_rank(speed)[events].mean() - 0.5), events.size) or _is_unlikely(
        float(rank.mean()) - 0.5 if rank.size else 0.0, rank.size
    )


def _rank(values: Array) -> Array:
    """(N,) ranks of values (N,), between 0 and 1."""
    return np.asarray(np.argsort(np.argsort(values)) / max(values.size - 1, 1))


def _is_unlikely(off: float, count: int) -> bool:
    """Whether the mean of so many ranks is off by more than chance."""
    return bool(off * np.sqrt(count) > BY_MOTION * RANK_DEVIATION)


def _moved(fitted: FittedMotion, wrong: Array, left: Array) -> float:
    """Standard deviations by which (N, n) errors move the values, all together; ``left``: the residual beside them."""
    weight = np.sqrt(effective_fraction(left)) / np.maximum(left.std(axis=0), TINY)
    base = BaseProjection.of(fitted.sampled[0], weight)
    return float(np.linalg.norm(base.basis.T @ base.weighted(wrong)))
