"""Covariance of an estimate whose noise may have a colour.

An estimate that follows the noise by d theta = sum_t Phi_t' e_t has the covariance

    C = sum over joints and logs of Phi' Omega Phi,

with the influence Phi = S (S'S)^-1 for least squares and the autocovariance Omega of the noise, whatever the weights
were. Omega comes from the residual r = (I - S Phi') e, which is smaller than the noise, most where the motion is slow,
because the fit takes up a part of it: what an autoregression would lose so is added to the autocovariances that it is
fitted to. Noise that a test cannot tell from white keeps the variance that it was weighted with. The noise of different
joints counts as independent. The values themselves are not those of whitened samples: that would gain 7 % of a
deviation at most (SCARA, 200 Hz, half of the noise with a memory of 50 ms), and let fast model error decide. Sources:
Andrews, Monahan, Econometrica 60 (1992), for C by autoregressions; Durbin, Watson, Biometrika 37 (1950), for
correlations of residuals that depend on S.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from fmu_didim.cosim import Indices, grid_places
from fmu_didim.data.signals import Array
from fmu_didim.fit.noise.autoregression import autocorrelation, innovations, portmanteau, portmanteau_p
from fmu_didim.fit.noise.noise import TINY
from fmu_didim.fit.noise.residual_noise import GATE_LAGS, JointNoise, Log, LogsOfOneRate

COLOUR_ROUNDS = 3
"""[rounds] Of colour and what the fit takes from it: a fourth moves no deviation by 1 %."""
WHITENESS_LAGS = 10
"""[samples] Correlations, beyond the order of the colour, that are tested after it."""
EXCESS = 0.001
"""[1] Probability of as large a residual by chance, below which a joint is reported as off by more than its known
noise."""


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
    return float(law.ppf(EXCESS)) / size, float(law.isf(EXCESS)) / size


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
    group: LogsOfOneRate, noises: Sequence[JointNoise], usual: Array, covariance: Array, floor: Array, *, stated: bool
) -> list[Colour]:
    """The colour of each joint, where white noise would have variances ``usual`` (n,); its inflation is still
    one."""
    most = max(noise.coefficients.size for noise in noises) + WHITENESS_LAGS
    lags = min(most, group.samples - 1)
    found, pairs = group.autocovariance(noises, covariance, 2 * most), group.pairs(2 * most)
    colours, freedom = [], np.maximum(group.samples - group.fitted, 1.0)
    for j, (noise, column) in enumerate(zip(noises, found.T, strict=True)):
        order, own = noise.coefficients.size, float(column[0])
        rho = autocorrelation(noise.coefficients, group.samples)
        samples = float(freedom[j]) / float(2 * np.sum(rho**2) - 1)
        counted = _counted(noise, own, float(usual[j]), samples, stated=stated)
        left = portmanteau(innovations(column, noise.coefficients, lags), pairs, lags)
        colours.append(
            Colour(
                joint=j + 1,
                rate_hz=group.rate_hz,
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
    """The covariance of an estimate, from its residual.

    Args:
        residual: (N, n); sensitivity: (N, n, p) of the simulated torque; influence: (N, n, p) d theta / d noise.
        deviation: (n,) of white noise; stated: whether it is known: then it counts, unless the residual is larger by
            more than chance.
        stretches: the logs; floor: (n,) residuals below are rounding, and count as white.
        usual: (n, p) variances that the inflation is counted from; by default those of white noise.
    """
    tables = (residual, sensitivity, influence)
    groups = [
        LogsOfOneRate(
            rate, tuple(Log.of(s.places, *(t[s.rows] for t in tables)) for s in stretches if s.rate_hz == rate)
        )
        for rate in sorted({stretch.rate_hz for stretch in stretches})
    ]
    floor = np.broadcast_to(floor, deviation.shape)
    covariance, noises = _settled(groups, floor)
    colours = [
        _judged(group, noise, deviation**2, covariance, floor, stated=stated)
        for group, noise in zip(groups, noises, strict=True)
    ]
    covariance, shares = _covariance(
        groups, [[JointNoise(c.variance, c.coefficients) for c in each] for each in colours]
    )
    if usual is None:
        _, before = _covariance(groups, [[JointNoise(float(d) ** 2) for d in deviation] for _ in groups])
        usual = np.einsum("gjpp->jp", before)
    weight = 1 / np.maximum(usual.sum(axis=0), TINY)
    inflation = np.sqrt((np.einsum("gjpp->jp", shares) @ weight) / np.maximum(usual @ weight, TINY))
    return Uncertainty(
        covariance, tuple(replace(c, inflation=float(inflation[c.joint - 1])) for each in colours for c in each)
    )


def _settled(groups: Sequence[LogsOfOneRate], floor: Array) -> tuple[Array, list[list[JointNoise]]]:
    """The noise that the residual shows, and the covariance with it; what the fit takes from the residual is found
    with the noise of the round before."""
    noises = [group.white() for group in groups]
    covariance, _ = _covariance(groups, noises)
    gates = [
        group.not_white(group.autocovariance(noise, covariance, GATE_LAGS), floor)
        for group, noise in zip(groups, noises, strict=True)
    ]
    for _ in range(COLOUR_ROUNDS if np.any(gates) else 0):
        noises = [g.refitted(noise, gate, covariance) for g, noise, gate in zip(groups, noises, gates, strict=True)]
        covariance, _ = _covariance(groups, noises)
    return covariance, noises


def _covariance(groups: Sequence[LogsOfOneRate], noises: Sequence[Sequence[JointNoise]]) -> tuple[Array, Array]:
    """C (p, p), and what each group and joint adds to it (g, n, p, p)."""
    shares = np.array([group.shares(noise) for group, noise in zip(groups, noises, strict=True)])
    return shares.sum(axis=(0, 1)), shares
