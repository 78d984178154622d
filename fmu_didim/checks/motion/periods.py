"""Whether the residual torque repeats where the motion repeats: noise does not, what a model lacks does.

Over each period k of a log the residual r and the sensitivities S of a joint are brought to the harmonics of the period
in the band of the motion,

    u_k' r = u_k' S a + R_k c + e_k,      u_k R_k = [cos(2 pi h t/T), sin(2 pi h t/T)],  h = 1 ... H,

with an orthonormal u_k, weighted at the ends where a part of a period is missing. Fisher's F compares what the periods
have in common, c, with how they differ, beside S, which the fit has used up. Both hold the same frequencies, to a
fraction of 1/T: the noise may have any colour, and a misfit that repeats does not widen its own bound. Nothing is asked
of the mean, h = 0, where noise drifts, nor above the band, where a hum may keep step with the period.

Source: Pintelon, Schoukens, System Identification: A Frequency Domain Approach, 2nd ed., 2012, 2.5 and 11.4, for noise
by the differences of periods.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fmu_didim.base.diagnostics import Diagnostic
from fmu_didim.base.distributions import f_ppf, f_sf
from fmu_didim.base.errors import UnknownNameError
from fmu_didim.checks.motion.colour import orthonormal, rest_of
from fmu_didim.checks.motion.dependence import MOTION_CHANCE, independent
from fmu_didim.checks.residual import RESIDUAL_ABOVE_NOISE
from fmu_didim.data.signals import Array
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.log_noise import TRANSIENT, motion_period
from fmu_didim.fit.noise.noise import ABOVE_MOTION, HIGHEST_CUT, TINY, motion_frequency

PART_OF_PERIOD = 0.3
"""[1] Least part of a period, the last one, that is compared with the others."""
KNOWN_PART = 0.1
"""[1] Of the largest singular value of the harmonics over a part of a period, above which a combination of them is
used: the others are hardly there."""
RAMP = 0.03
"""[1] Of a period, over which the weights of its samples rise and fall where a part of it is missing."""
FEWEST_DIFFERENCES = 6
"""[1] Degrees of freedom of the noise below which nothing is said: Fisher's bound would be twenty and more."""


@dataclass(frozen=True)
class Repetition:
    """What repeats in the residual of a joint.

    Attributes:
        joint: from 1; periods: that were compared.
        ratio: mean square of what the periods have in common over that of their differences, one by chance.
        first, second: degrees of freedom of the two.
    """

    joint: int
    periods: int
    ratio: float
    first: int
    second: int

    @property
    def p_value(self) -> float:
        """Of as large a ratio by noise alone."""
        return float(f_sf(self.ratio, self.first, self.second))


def repetition_of_fit(fit: Fit) -> list[Repetition]:
    """What repeats in the residual of each joint, in all experiments whose motion repeats; empty where none does."""
    tables = [table for label in fit.model.estimation_labels for table in _harmonics(fit, label)]
    found = [_repetition(tables, j) for j in range(fit.model.joint_count)] if tables else []
    return [one for one in found if one is not None]


def repetition_diagnostics(found: list[Repetition]) -> list[Diagnostic]:
    """The joints whose residual repeats with the motion beyond chance."""
    level = MOTION_CHANCE / max(len(found), 1)
    return [
        Diagnostic(
            RESIDUAL_ABOVE_NOISE,
            f"what the residual has in common in {one.periods} periods of the motion is {one.ratio:.3g} times what "
            f"their differences give (p = {max(one.p_value, TINY):.1e}): it repeats, which noise does not.",
            f"joint {one.joint}", one.ratio, float(f_ppf(1 - level, one.first, one.second)), "1",
        )
        for one in found if one.p_value < level
    ]  # fmt: skip


@dataclass(frozen=True)
class _Log:
    """A log whose motion repeats: its residual (N, n) and sensitivity (N, n, p); and for each period what leads to the
    harmonics u (K, N), its rows, and R (K, 2 H)."""

    residual: Array
    sensitivity: Array
    periods: tuple[tuple[Array, slice, Array], ...]

    @property
    def harmonics(self) -> Array:
        """(sum of K, 2 H) R of all periods."""
        return np.concatenate([common for _, _, common in self.periods])

    def at(self, joint: int) -> tuple[Array, Array]:
        """Residual (sum of K,) and sensitivity (sum of K, p) of a joint, from 0, at the harmonics."""
        left = [u @ self.residual[part, joint] for u, part, _ in self.periods]
        columns = [u @ self.sensitivity[part, joint] for u, part, _ in self.periods]
        return np.concatenate(left), np.concatenate(columns)


def _harmonics(fit: Fit, label: str) -> Iterator[_Log]:
    """A log at the harmonics of its period, without the transient that may begin the first one; nothing where it does
    not last for one and a part, or where its reference has no motion."""
    model, experiment = fit.model, fit.model.experiments[label]
    period, rows = motion_period(model, label), model.experiments.rows[label]
    if period is None:
        return
    try:
        motion_hz = motion_frequency(experiment.reference, model.joint_count)
    except UnknownNameError:
        return
    highest = min(ABOVE_MOTION * motion_hz, HIGHEST_CUT * experiment.rate_hz)
    if model.experiments.low_pass is not None:
        highest = min(highest, model.experiments.low_pass.cutoff_hz)
    turns = (experiment.time - experiment.time[0]) / period
    angle = 2 * np.pi * np.outer(turns, np.arange(1, max(int(highest * period), 1) + 1))
    columns = np.concatenate([np.cos(angle), np.sin(angle)], axis=1)
    edges = np.searchsorted(turns, [TRANSIENT, *range(1, int(turns[-1]) + 2)])
    found = []
    for first, last in pairwise(edges):
        if last - first < 2 or turns[last - 1] - turns[first] < PART_OF_PERIOD:
            continue
        own, window = columns[first:last], _window(turns[first:last])[:, None]
        own = window * (own - np.sum(window * own, axis=0) / np.sum(window))  # an offset is left out
        square, along = np.linalg.eigh(own.T @ own)
        kept = square > KNOWN_PART**2 * square[-1]
        size, along = np.sqrt(square[kept]), along[:, kept]
        found.append(((own @ (along / size)).T * window[:, 0], slice(int(first), int(last)), (along * size).T))
    if len(found) > 1:
        yield _Log(fit.residual[rows], fit.jacobian[rows], tuple(found))


def _window(turns: Array) -> Array:
    """(N,) weights of the samples of a period: one, but rising and falling smoothly where a part of it is missing, so
    that other frequencies, such as a hum, do not show at those of the motion."""
    inside = np.minimum(turns - turns[0], turns[-1] - turns)
    if np.ptp(turns) + 2 * np.median(np.diff(turns)) > 1:  # no more than a sample is missing
        return np.ones(turns.size)
    return np.asarray(np.sin(np.pi / 2 * np.minimum(inside / RAMP, 1.0)) ** 2)


def _repetition(logs: list[_Log], joint: int) -> Repetition | None:
    """What repeats in the residual of a joint, from 0; None where too little is left to compare with."""
    both = [log.at(joint) for log in logs]
    residual = np.concatenate([left for left, _ in both])
    basis = orthonormal(independent(np.concatenate([columns for _, columns in both])))
    width = sum(log.harmonics.shape[1] for log in logs)
    common, row, column = np.zeros((residual.size, width)), 0, 0
    for log in logs:
        own = log.harmonics
        common[row : row + own.shape[0], column : column + own.shape[1]] = own
        row, column = row + own.shape[0], column + own.shape[1]
    residual, common = rest_of(residual, basis), rest_of(common, basis)
    along = orthonormal(independent(common))
    first = along.shape[1]
    second = residual.size - basis.shape[1] - first
    if first < 1 or second < FEWEST_DIFFERENCES:
        return None
    explained = float(np.sum((along.T @ residual) ** 2))
    noise = max(float(residual @ residual) - explained, TINY) / second
    periods = max(len(log.periods) for log in logs)
    return Repetition(joint + 1, periods, explained / first / noise, first, second)
