"""Covariance of an estimate whose noise may have a colour.

An estimate that follows the noise by d theta = sum_t Phi_t' e_t has the covariance

    C = sum over joints and logs of Phi' Omega Phi,

with the influence Phi = S (S'S)^-1 for least squares and the autocovariance Omega of the noise, whatever the weights
were. Omega comes from the residual r = (I - S Phi') e, which holds less than the noise where the motion is slow: what
an autoregression would lose there is added to the autocovariances that it is fitted to. Noise that a test does not
tell from white keeps the variance that it was weighted with. The noise of different joints counts as independent. The
values themselves are not those of whitened samples: that would gain 7 % of a deviation at most (SCARA, 200 Hz, half of
the noise with a memory of 50 ms), and let fast model error decide. Sources: Andrews, Monahan, Econometrica 60 (1992),
for C by autoregressions; Durbin, Watson, Biometrika 37 (1950), for correlations of residuals that depend on S.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import fft, stats

from fmu_didim.master import Indices, grid_places
from fmu_didim.prediction import thresholds as limits
from fmu_didim.prediction.colour import (
    autocorrelation,
    autoregression,
    innovations,
    largest_order,
    portmanteau,
    portmanteau_p,
)
from fmu_didim.prediction.noise import TINY
from fmu_didim.signals import Array


@dataclass(frozen=True)
class Stretch:
    """A log among several: its rows in their tables, the place of each row on the grid of the log, and its rate."""

    rows: slice
    places: Indices
    rate_hz: float


def nominal_rate(rate_hz: float) -> float:
    """A rate to four digits, so that logs whose stamps are rounded differently have the same."""
    return float(f"{rate_hz:.4g}")


def stretches(times: Sequence[Array]) -> list[Stretch]:
    """Logs sampled at these times (N,), one below the other; samples that a logger has dropped are counted."""
    found, first = [], 0
    for time in times:
        places = grid_places(time)
        rate = float(places[-1]) / float(time[-1] - time[0])
        found.append(Stretch(slice(first, first + time.size), places, nominal_rate(rate)))
        first += time.size
    return found


@dataclass(frozen=True)
class Colour:
    """The noise of a joint in all logs of one rate.

    Attributes:
        joint: counted from 1; rate_hz: of the logs.
        variance: of the noise that counts, squares of N.m or N; residual_variance: of the noise by the residual.
        coefficients: (p,) of the autoregression; none where the noise counts as white.
        lag_one: correlation of neighbouring samples; whiteness: p value of what the autoregression leaves.
        samples: independent ones that the variance is known from.
        inflation: standard deviations that come from this joint at all rates, over those of white noise.
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


@dataclass(frozen=True)
class Uncertainty:
    """Covariance (p, p) of an estimate, and the noise that it comes from, by rate and joint."""

    covariance: Array
    colours: tuple[Colour, ...]

    @property
    def deviation(self) -> Array:
        """(p,) standard deviations."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def inflation(self) -> float:
        """The largest of all joints, at least 1."""
        return max([1.0, *(colour.inflation for colour in self.colours)])


def chi_square_bounds(samples: float, known_from: float = np.inf) -> tuple[float, float]:
    """Chi-square per sample below which a residual is smaller than its noise, and above which it is larger.

    Args:
        samples: independent ones of the residual; known_from: those that the noise is known from, by Fisher's ratio of
            two variances.
    """
    if np.isinf(known_from):
        law, size = stats.chi2(samples), samples
    else:
        law, size = stats.f(samples, known_from), 1.0
    return float(law.ppf(limits.EXCESS)) / size, float(law.isf(limits.EXCESS)) / size


@dataclass(frozen=True)
class _Noise:
    """Noise of a joint in logs of one rate: its variance, and the coefficients (p,) of its autoregression, none if it
    is white."""

    variance: float
    coefficients: Array = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True)
class _Log:
    """A log on its grid, with rows of zeros where samples are missing: which are there (M, 1), residual (M, n),
    sensitivity and influence (M, n, p)."""

    there: Array
    residual: Array
    sensitivity: Array
    influence: Array

    @classmethod
    def of(cls, places: Indices, *tables: Array) -> _Log:
        def on_grid(values: Array) -> Array:
            result = np.zeros((int(places[-1]) + 1, *values.shape[1:]))
            result[places] = values
            return result

        return cls(on_grid(np.ones((places.size, 1))), *(on_grid(table) for table in tables))

    def coloured(self, noises: Sequence[_Noise]) -> Array:
        """(M, n, p) Omega Phi."""
        count = self.there.size
        length = fft.next_fast_len(2 * count, real=True)
        result = np.empty_like(self.influence)
        for j, noise in enumerate(noises):
            result[:, j] = noise.variance * self.influence[:, j]
            if noise.coefficients.size:
                column = np.zeros(length)
                column[:count] = autocorrelation(noise.coefficients, count)
                column[length - count + 1 :] = column[count - 1 : 0 : -1]
                spectrum = fft.rfft(column).real[:, None] * fft.rfft(result[:, j], length, axis=0)
                result[:, j] = fft.irfft(spectrum, length, axis=0)[:count]
        return np.asarray(result * self.there[:, :, None])

    def lost(self, noises: Sequence[_Noise], covariance: Array, lags: int) -> Array:
        """(lags + 1, n) what the fit takes from the sums of products of its residual: S Phi' Omega + Omega Phi S'
        - S C S'."""
        through, s = self.coloured(noises), self.sensitivity
        return _lagged(s, through - s @ covariance, lags) + _lagged(through, s, lags)


def _lagged(a: Array, b: Array, lags: int) -> Array:
    """(lags + 1, n) sums over t of a_t b_(t + lag) of tables (M, n) or (M, n, p)."""
    count, axes = a.shape[0], "mjp"[: a.ndim]
    found = np.zeros((lags + 1, a.shape[1]))
    for lag in range(min(lags, count - 1) + 1):
        found[lag] = np.einsum(f"{axes},{axes}->j", a[: count - lag], b[lag:])
    return found


def _counted(noise: _Noise, own: float, usual: float, samples: float, *, stated: bool) -> _Noise:
    """The noise that a standard deviation counts with, from that of the residual with variance ``own`` and white noise
    with the usual one, which may be stated."""
    if not stated:
        return replace(noise, variance=usual) if not noise.coefficients.size else noise
    ratio, (least, most) = own / usual, chi_square_bounds(samples)
    if ratio > most:
        return replace(noise, variance=own)
    # A residual that is smaller than the noise says nothing of its colour.
    return _Noise(usual, noise.coefficients if ratio >= least else np.zeros(0))


@dataclass(frozen=True)
class _Group:
    """Logs of one rate."""

    rate_hz: float
    logs: tuple[_Log, ...]

    @property
    def samples(self) -> int:
        """How many there are."""
        return int(sum(log.there.sum() for log in self.logs))

    def pairs(self, lags: int) -> Array:
        """(lags + 1,) how many pairs of samples are so far apart; at least one, so that nothing is divided by zero."""
        counts = np.sum([_lagged(log.there, log.there, lags) for log in self.logs], axis=0)
        return np.asarray(np.maximum(counts[:, 0], 1.0))

    def shares(self, noises: Sequence[_Noise]) -> Array:
        """(n, p, p) Phi' Omega Phi of each joint."""
        return np.asarray(
            sum(np.einsum("mjp,mjq->jpq", log.influence, log.coloured(noises), optimize=True) for log in self.logs)
        )

    def autocovariance(self, noises: Sequence[_Noise], covariance: Array, lags: int) -> Array:
        """(lags + 1, n) of the noise, from the residual and what noises like these lose in it."""
        left = np.sum([_lagged(log.residual, log.residual, lags) for log in self.logs], axis=0)
        lost = np.sum([log.lost(noises, covariance, lags) for log in self.logs], axis=0)
        # A joint whose residual is larger than its noise, because values that other joints decide are off, is taken as
        # it is: by how much they are off is not known, only how much they might be.
        return np.asarray((left + lost * (lost[0] > 0)) / self.pairs(lags)[:, None])

    def white(self) -> list[_Noise]:
        """White noise of each joint, by its residual."""
        left = np.sum([_lagged(log.residual, log.residual, 0) for log in self.logs], axis=0)[0]
        return [_Noise(float(v)) for v in left / np.maximum(self.samples - self.fitted, 1.0)]

    @property
    def fitted(self) -> Array:
        """(n,) samples of each joint that the fit uses up."""
        return np.asarray(sum(np.einsum("mjp,mjp->j", log.sensitivity, log.influence) for log in self.logs))

    def not_white(self, covariances: Array, floor: Array) -> list[bool]:
        """Which joints (n,) have a colour, by autocovariances (K + 1, n): all if together they do not look white,
        else those that clearly do not; never those whose residual is rounding."""
        lags, pairs = limits.GATE_LAGS, self.pairs(limits.GATE_LAGS)
        is_noise = covariances[0] > floor**2
        if self.samples < limits.FEWEST_COLOURED or not is_noise.any():
            return [False] * is_noise.size
        sums = [portmanteau(column, pairs, lags) * real for column, real in zip(covariances.T, is_noise, strict=True)]
        together = portmanteau_p(sum(sums), lags * int(is_noise.sum())) < limits.NOT_WHITE
        each = [portmanteau_p(one, lags) < limits.CLEARLY_NOT_WHITE for one in sums]
        return [bool(real and (together or own)) for real, own in zip(is_noise, each, strict=True)]

    def refitted(self, noises: Sequence[_Noise], coloured: Sequence[bool], covariance: Array) -> list[_Noise]:
        """Those with a colour anew, from the residual and what they lose in it."""
        if not any(coloured):
            return list(noises)
        largest = largest_order(self.samples)
        found = self.autocovariance(noises, covariance, largest)
        # Means of fewer and fewer products, drawn towards zero so that they belong to noise that can be.
        found *= 1 - np.arange(largest + 1)[:, None] / sum(log.there.size for log in self.logs)
        return [
            _Noise(float(column[0]), autoregression(column, self.samples, largest)) if wanted else noise
            for noise, wanted, column in zip(noises, coloured, found.T, strict=True)
        ]

    def judged(
        self, noises: Sequence[_Noise], usual: Array, covariance: Array, floor: Array, *, stated: bool
    ) -> list[Colour]:
        """What is known of each joint, where white noise would have variances ``usual`` (n,); its inflation is still
        one."""
        most = max(noise.coefficients.size for noise in noises) + limits.WHITENESS_LAGS
        lags = min(most, self.samples - 1)
        found, pairs = self.autocovariance(noises, covariance, 2 * most), self.pairs(2 * most)
        colours, freedom = [], np.maximum(self.samples - self.fitted, 1.0)
        for j, (noise, column) in enumerate(zip(noises, found.T, strict=True)):
            order, own = noise.coefficients.size, float(column[0])
            rho = autocorrelation(noise.coefficients, self.samples)
            samples = float(freedom[j]) / float(2 * np.sum(rho**2) - 1)
            counted = _counted(noise, own, float(usual[j]), samples, stated=stated)
            left = portmanteau(innovations(column, noise.coefficients, lags), pairs, lags)
            colours.append(
                Colour(
                    joint=j + 1,
                    rate_hz=self.rate_hz,
                    variance=counted.variance,
                    residual_variance=own,
                    coefficients=counted.coefficients,
                    lag_one=float(column[1] / max(own, TINY)),
                    whiteness=portmanteau_p(left, lags - order) if own > floor[j] ** 2 else 1.0,
                    samples=samples,
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
    stated: bool = False,
    floor: Array | float = 0.0,
    usual: Array | None = None,
) -> Uncertainty:
    """The covariance of an estimate, from what it leaves.

    Args:
        residual: (N, n); sensitivity: (N, n, p) of the simulated torque; influence: (N, n, p) d theta / d noise.
        deviation: (n,) of white noise; stated: whether it is known: then it counts, unless the residual is larger by
            more than chance.
        stretches: the logs; floor: (n,) residuals below are rounding, and count as white.
        usual: (n, p) variances that the inflation is counted from; by default those of white noise.
    """
    tables = (residual, sensitivity, influence)
    groups = [
        _Group(rate, tuple(_Log.of(s.places, *(t[s.rows] for t in tables)) for s in stretches if s.rate_hz == rate))
        for rate in sorted({stretch.rate_hz for stretch in stretches})
    ]
    floor = np.broadcast_to(floor, deviation.shape)
    covariance, noises = _settled(groups, floor)
    colours = [
        group.judged(noise, deviation**2, covariance, floor, stated=stated)
        for group, noise in zip(groups, noises, strict=True)
    ]
    covariance, shares = _covariance(groups, [[_Noise(c.variance, c.coefficients) for c in each] for each in colours])
    if usual is None:
        _, before = _covariance(groups, [[_Noise(float(d) ** 2) for d in deviation] for _ in groups])
        usual = np.einsum("gjpp->jp", before)
    weight = 1 / np.maximum(usual.sum(axis=0), TINY)
    inflation = np.sqrt((np.einsum("gjpp->jp", shares) @ weight) / np.maximum(usual @ weight, TINY))
    return Uncertainty(
        covariance, tuple(replace(c, inflation=float(inflation[c.joint - 1])) for each in colours for c in each)
    )


def _settled(groups: Sequence[_Group], floor: Array) -> tuple[Array, list[list[_Noise]]]:
    """The noise that the residual shows, and the covariance with it; what the fit takes from the residual is found
    with the noise of the round before."""
    noises = [group.white() for group in groups]
    covariance, _ = _covariance(groups, noises)
    gates = [
        group.not_white(group.autocovariance(noise, covariance, limits.GATE_LAGS), floor)
        for group, noise in zip(groups, noises, strict=True)
    ]
    for _ in range(limits.COLOUR_ROUNDS if np.any(gates) else 0):
        noises = [g.refitted(noise, gate, covariance) for g, noise, gate in zip(groups, noises, gates, strict=True)]
        covariance, _ = _covariance(groups, noises)
    return covariance, noises


def _covariance(groups: Sequence[_Group], noises: Sequence[Sequence[_Noise]]) -> tuple[Array, Array]:
    """C (p, p), and what each group and joint adds to it (g, n, p, p)."""
    shares = np.array([group.shares(noise) for group, noise in zip(groups, noises, strict=True)])
    return shares.sum(axis=(0, 1)), shares
