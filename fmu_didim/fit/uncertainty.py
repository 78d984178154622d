"""Covariance of an estimate whose noise may have a colour.

An estimate that follows the noise by d theta = sum_t Phi_t' e_t has the covariance

    C = sum over outputs and logs of Phi' Omega Phi,

with the influence Phi = S (S'S)^-1 for least squares and the autocovariance Omega of the noise, whatever the weights
were. Omega comes from the residual r = (I - S Phi') e, which is smaller than the noise, most where the motion is slow,
because the fit takes up a part of it: what an autoregression would lose so is added to the autocovariances that it is
fitted to. Noise that a test cannot tell from white keeps the variance that it was weighted with. The noise of
different outputs, torques of joints or what else was measured, counts as independent. The values themselves are not
those of whitened samples: that would gain 7 % of a deviation at most (SCARA, 200 Hz, half of the noise with a memory
of 50 ms), and let fast model error decide. Sources: Andrews, Monahan, Econometrica 60 (1992), for C by
autoregressions; Durbin, Watson, Biometrika 37 (1950), for correlations of residuals that depend on S.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from fmu_didim.base.distributions import chi2_isf, chi2_ppf, f_ppf
from fmu_didim.cosim import Indices, grid_places
from fmu_didim.data.signals import Array
from fmu_didim.fit.noise.autoregression import autocorrelation, innovations, portmanteau, portmanteau_p
from fmu_didim.fit.noise.noise import TINY
from fmu_didim.fit.noise.residual_noise import GATE_LAGS, JointNoise, Log, LogsOfOneRate
from fmu_didim.model.experiments import Experiments

COLOUR_ROUNDS = 3
"""[rounds] Of colour and what the fit takes from it: a fourth moves no deviation by 1 %."""
WHITENESS_LAGS = 10
"""[samples] Correlations, beyond the order of the colour, that are tested after it."""
EXCESS = 0.001
"""[1] Probability of as large a residual by chance, below which a joint is reported as off by more than its known
noise."""


@dataclass(frozen=True)
class Stretch:
    """A log among several: its rows in their tables, the place of each row on the grid of the log, and its rate; and
    the columns that it holds, all by default."""

    rows: slice | Indices
    places: Indices
    rate_hz: float
    columns: slice = field(default_factory=lambda: slice(None))


def nominal_rate(rate_hz: float) -> float:
    """A rate to four digits, so that logs whose stamps are rounded differently have the same."""
    return float(f"{rate_hz:.4g}")


def stretches(times: Sequence[Array]) -> list[Stretch]:
    """Logs sampled at these times (N,), one below the other; samples that a logger has dropped are counted."""
    found, first = [], 0
    for time in times:
        found.append(_stretch(slice(first, first + time.size), time))
        first += time.size
    return found


def stretches_of_outputs(experiments: Experiments) -> list[Stretch]:
    """The logs of all outputs that are fitted, in tables over these."""
    return [_stretch(log.rows, log.time, block.columns) for block in experiments.output_blocks for log in block.logs]


def _stretch(rows: slice | Indices, time: Array, columns: slice | None = None) -> Stretch:
    places = grid_places(time)
    rate = float(places[-1]) / float(time[-1] - time[0])
    return Stretch(rows, places, nominal_rate(rate), slice(None) if columns is None else columns)


@dataclass(frozen=True)
class Colour:
    """The noise of an output in all logs of one rate.

    Attributes:
        joint: whose torque it is, counted from 1; what was measured beside the torque comes after the joints.
        rate_hz: of the logs.
        variance: of the noise that counts, squares of the unit; residual_variance: of the noise by the residual.
        coefficients: (p,) of the autoregression; none where the noise counts as white.
        lag_one: correlation of neighbouring samples; whiteness: p value of what the autoregression leaves.
        samples: independent ones that the variance is known from.
        inflation: standard deviations that come from this output at all rates, over those of white noise.
        is_louder: whether the noise is white but louder in places, and counts so.
    """

    joint: int
    rate_hz: float
    variance: float
    residual_variance: float
    coefficients: Array
    lag_one: float
    whiteness: float
    samples: float
    inflation: float = 1.0
    is_louder: bool = False


@dataclass(frozen=True)
class Uncertainty:
    """How well an estimate is known.

    Attributes:
        covariance: (p, p) of the values; colours: the noise that it comes from, by rate and output.
        by_data: (p, p) the part of the covariance that comes from that noise, where the rest comes from a prior;
            alone: (p, p) what it would be without the prior, zero in directions that the data do not show. None where
            there is no prior.
        loudness: (M, m) variance of the noise of each sample over the mean one of its output.
    """

    covariance: Array
    colours: tuple[Colour, ...]
    loudness: Array
    by_data: Array | None = None
    alone: Array | None = None

    @property
    def deviation(self) -> Array:
        """(p,) standard deviations."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def inflation(self) -> float:
        """The largest of all outputs, at least 1."""
        return max([1.0, *(colour.inflation for colour in self.colours)])


def chi_square_bounds(samples: float, known_from: float = np.inf) -> tuple[float, float]:
    """Chi-square per sample below which a residual is smaller than its noise, and above which it is larger.

    Args:
        samples: independent ones of the residual; known_from: those that the noise is known from, by Fisher's ratio of
            two variances.
    """
    if np.isinf(known_from):
        return float(chi2_ppf(EXCESS, samples)) / samples, float(chi2_isf(EXCESS, samples)) / samples
    return float(f_ppf(EXCESS, samples, known_from)), float(f_ppf(1 - EXCESS, samples, known_from))


def _counted(noise: JointNoise, own: float, usual: float, samples: float, *, stated: bool) -> JointNoise:
    """The noise for standard deviations, from that of the residual with variance ``own`` and white noise
    with the usual one, which may be stated."""
    if not stated:
        return replace(noise, variance=usual) if not noise.coefficients.size else noise
    ratio, (least, most) = own / usual, chi_square_bounds(samples)
    if ratio > most:
        return replace(noise, variance=own)
    # A residual that is smaller than the noise says nothing of its colour.
    return JointNoise(usual, noise.coefficients if ratio >= least else np.zeros(0))


def _judged(
    group: _Group,
    noises: Sequence[JointNoise],
    usual: Array,
    covariance: Array,
    floor: Array,
    stated: NDArray[np.bool_],
    loud: NDArray[np.bool_],
) -> list[Colour]:
    """The colour of each output of a group, where white noise would have variances ``usual`` (n,); its inflation is
    still one."""
    most = max(noise.coefficients.size for noise in noises) + WHITENESS_LAGS
    lags = min(most, group.samples - 1)
    found, pairs = group.autocovariance(noises, covariance, 2 * most), group.pairs(2 * most)
    colours, freedom = [], np.maximum(group.samples - group.fitted, 1.0)
    for j, (noise, column) in enumerate(zip(noises, found.T, strict=True)):
        order, own = noise.coefficients.size, float(column[0])
        rho = autocorrelation(noise.coefficients, group.samples)
        samples = float(freedom[j]) / float(2 * np.sum(rho**2) - 1)
        counted = _counted(noise, own, float(usual[j]), samples, stated=bool(stated[j]))
        left = (
            group.loud_portmanteau(column, j, lags)
            if loud[j]
            else portmanteau(innovations(column, noise.coefficients, lags), pairs, lags)
        )
        colours.append(
            Colour(
                joint=group.columns.start + j + 1,
                rate_hz=group.rate_hz,
                variance=counted.variance,
                residual_variance=own,
                coefficients=counted.coefficients,
                lag_one=float(column[1] / max(own, TINY)),
                whiteness=portmanteau_p(left, lags - order) if own > floor[j] ** 2 else 1.0,
                samples=samples,
                is_louder=bool(loud[j]),
            )
        )
    return colours


def uncertainty(
    residual: Array,
    sensitivity: Array,
    influence: Array,
    deviation: Array,
    stretches: Sequence[Stretch],
    *,
    stated: bool | NDArray[np.bool_] = False,
    floor: Array | float = 0.0,
    usual: Array | None = None,
    size: Array | None = None,
) -> Uncertainty:
    """The covariance of an estimate, from its residual.

    Args:
        residual: (M, m); sensitivity: (M, m, p) of the simulated outputs; influence: (M, m, p) d theta / d noise.
        deviation: (m,) of white noise; stated: whether it is known, (m,) or of all: then it counts, unless the
            residual is larger by more than chance.
        stretches: the logs; floor: (m,) residuals below are rounding, and count as white.
        usual: (m, p) variances that the inflation is counted from; by default those of white noise.
        size: (M, m) of the outputs, which noise may grow with; None: the noise of an output is as loud everywhere.
    """
    loudness = np.ones_like(residual)
    tables, sizes = (residual, sensitivity, influence), loudness if size is None else np.abs(size)
    alike = groups = _grouped(stretches, (*tables, loudness, sizes), deviation.size)
    floor, stated = np.broadcast_to(floor, deviation.shape), np.broadcast_to(stated, deviation.shape)
    loud = (
        [np.zeros(group.logs[0].residual.shape[1], bool) for group in groups]
        if size is None
        else _louder(groups, floor, stated)
    )
    if np.concatenate(loud).any():
        loudness = _loudness(groups, loud, residual.shape)
        groups = _grouped(stretches, (*tables, loudness, sizes), deviation.size)
    covariance, noises = _settled(groups, floor, loud)
    colours = [
        _judged(group, noise, deviation[at] ** 2, covariance, floor[at], stated[at], own)
        for group, noise, own in zip(groups, noises, loud, strict=True) for at in (group.columns,)
    ]  # fmt: skip
    covariance, shares = _covariance(
        groups, [[JointNoise(c.variance, c.coefficients) for c in each] for each in colours]
    )
    if usual is None:
        white = [[JointNoise(float(d) ** 2) for d in deviation[group.columns]] for group in groups]
        usual = _by_output(alike, _covariance(alike, white)[1], deviation.size)
    weight = 1 / np.maximum(usual.sum(axis=0), TINY)
    counted = _by_output(groups, shares, deviation.size)
    inflation = np.sqrt((counted @ weight) / np.maximum(usual @ weight, TINY))
    return Uncertainty(
        covariance,
        tuple(replace(c, inflation=float(inflation[c.joint - 1])) for each in colours for c in each),
        loudness,
    )


def covariance_of(influence: Array, noise: Uncertainty, stretches: Sequence[Stretch]) -> Array:
    """(p, p) covariance of what follows the noise of an estimate with an influence (M, m, p)."""
    known = {(c.joint, c.rate_hz): JointNoise(c.variance, c.coefficients) for c in noise.colours}
    none = np.zeros(influence.shape[:2])
    groups = _grouped(stretches, (none, influence, influence, noise.loudness, none), influence.shape[1])
    columns = [range(group.columns.start, group.columns.stop) for group in groups]
    noises = [[known[j + 1, g.rate_hz] for j in own] for g, own in zip(groups, columns, strict=True)]
    return _covariance(groups, noises)[0]


@dataclass(frozen=True)
class _Group(LogsOfOneRate):
    """Logs of one rate, their stretches, and the columns that they hold in tables over all outputs."""

    stretches: tuple[Stretch, ...]
    columns: slice


def _grouped(stretches: Sequence[Stretch], tables: Sequence[Array], count: int) -> list[_Group]:
    """The logs (of tables with ``count`` outputs) that belong together: of the same outputs, with one rate."""
    kinds = [(*s.columns.indices(count)[:2], s.rate_hz) for s in stretches]
    return [
        _Group(
            kind[2],
            tuple(
                Log.of(s.places, *(t[s.rows][:, s.columns] for t in tables))
                for s, own in zip(stretches, kinds, strict=True) if own == kind
            ),
            tuple(s for s, own in zip(stretches, kinds, strict=True) if own == kind),
            slice(*kind[:2]),
        )
        for kind in sorted(set(kinds))
    ]  # fmt: skip


def _by_output(groups: Sequence[_Group], shares: Sequence[Array], count: int) -> Array:
    """(m, p) variances that each output adds, from the shares (n, p, p) of the groups."""
    found = np.zeros((count, shares[0].shape[2]))
    for group, share in zip(groups, shares, strict=True):
        found[group.columns] += np.einsum("jpp->jp", share)
    return found


def _louder(groups: Sequence[_Group], floor: Array, stated: NDArray[np.bool_]) -> list[NDArray[np.bool_]]:
    """Which outputs of each group have noise, of a size that is not stated, that is white but louder in places."""
    loud = [np.array(group.varying()) & ~stated[group.columns] for group in groups]
    if not np.concatenate(loud).any():
        return loud
    noises = [group.white() for group in groups]
    covariance, _ = _covariance(groups, noises)
    return [
        own & group.looks_white(group.autocovariance(noise, covariance, GATE_LAGS), floor[group.columns])
        for own, group, noise in zip(loud, groups, noises, strict=True)
    ]


def _loudness(groups: Sequence[_Group], loud: Sequence[NDArray[np.bool_]], shape: tuple[int, ...]) -> Array:
    """(M, m) variance of the noise of each sample over the mean one of its output; 1 where it is as loud everywhere."""
    found = np.ones(shape)
    for group, own in zip(groups, loud, strict=True):
        mean = np.maximum(np.sum([log.squares.sum(axis=0) for log in group.logs], axis=0) / group.samples, TINY)
        for s, log in zip(group.stretches, group.logs, strict=True):
            found[s.rows, s.columns] = np.where(own, log.squares[log.there[:, 0] > 0] / mean, 1.0)
    return found


def _settled(
    groups: Sequence[_Group], floor: Array, loud: Sequence[NDArray[np.bool_]]
) -> tuple[Array, list[list[JointNoise]]]:
    """The noise that the residual shows, and the covariance with it; what the fit takes from the residual is found
    with the noise of the round before.

    Args:
        loud: outputs of each group whose noise is white, but louder in places.
    """
    noises = [group.white() for group in groups]
    covariance, _ = _covariance(groups, noises)
    gates = [
        np.array(group.not_white(group.autocovariance(noise, covariance, GATE_LAGS), floor[group.columns])) & ~own
        for group, noise, own in zip(groups, noises, loud, strict=True)
    ]
    for _ in range(COLOUR_ROUNDS if any(map(any, gates)) else 0):
        noises = [g.refitted(noise, gate, covariance) for g, noise, gate in zip(groups, noises, gates, strict=True)]
        covariance, _ = _covariance(groups, noises)
    return covariance, noises


def _covariance(groups: Sequence[_Group], noises: Sequence[Sequence[JointNoise]]) -> tuple[Array, list[Array]]:
    """C (p, p), and what the outputs of each group add to it (n, p, p)."""
    shares = [group.shares(noise) for group, noise in zip(groups, noises, strict=True)]
    return np.concatenate(shares).sum(axis=0), shares
