"""The noise of logs on their grids, estimated from a residual.

The fit takes up a part of the noise e, most of it where the motion is slow, so the residual r = (I - S Phi') e of
sensitivity S and influence Phi is smaller than the noise. What noise of a given autocovariance Omega would lose so,
S Phi' Omega + Omega Phi S' - S Phi' Omega Phi S', is added to the autocovariances of r.

Noise may be louder in places, as noise that grows with the torque is. Then no bound of one variance holds, and white
noise of every sample has a variance of its own,

    Omega = diag(v_t),      v_t ~ (r_t / (1 - h_t))^2,      h_t = S_t Phi_t'  the leverage of the sample,

which is consistent in Phi' Omega Phi, whatever it is that the variance follows. It is asked of r_t^2 whether it
follows the size of the output, or the squared influence on a value, where a variance that varies matters. What has a
colour keeps one variance: there a misfit would pass for noise that is loud where the model is wrong. Sources: Koenker,
J. Econometrics 17 (1981), for the test; White, Econometrica 48 (1980), MacKinnon, White, J. Econometrics 29 (1985), for
v_t; Diebold, in: Proc. Am. Stat. Assoc. (1986), for correlations of such noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from fmu_didim.base.distributions import normal_sf
from fmu_didim.cosim import Indices
from fmu_didim.data.signals import Array
from fmu_didim.fit.noise.autoregression import (
    autocorrelation,
    autoregression,
    largest_order,
    portmanteau,
    portmanteau_p,
)
from fmu_didim.fit.noise.noise import TINY

GATE_LAGS = 3
"""[samples] A residual is white if its correlations up to this lag are: colour shows there first."""
NOT_WHITE = 0.05
"""[1] Probability of the correlations of all joints by chance, below which they have a colour. A false alarm costs
little, since what is then estimated is nearly white; a colour that is missed costs coverage."""
CLEARLY_NOT_WHITE = 0.01
"""[1] The same of one joint where all together look white; there are several to ask."""
LOUDER = 0.01
"""[1] Probability by chance of what the squares of the residual of an output follow, below which its noise is louder in
places."""
LONGEST_GAP = 1000
"""[samples] A longer gap in a log counts as this long: noise is uncorrelated across it."""
LEAST_LEFT = 0.5
"""[1] Of a sample, that the fit leaves at least: one of more leverage says nothing of its own noise."""
FEWEST_COLOURED = 20
"""[samples] Fewer samples are too few to show a colour."""


@dataclass(frozen=True)
class JointNoise:
    """Noise of a joint in logs of one rate: its variance, and the coefficients (p,) of its autoregression, none if it
    is white."""

    variance: float
    coefficients: Array = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True)
class Log:
    """A log on its grid, with rows of zeros where samples are missing: which are there (M, 1), residual (M, n),
    sensitivity and influence (M, n, p); variance of the noise at each sample over the mean one, and size of the output
    (M, n)."""

    there: Array
    residual: Array
    sensitivity: Array
    influence: Array
    loudness: Array
    size: Array

    @classmethod
    def of(cls, places: Indices, *tables: Array) -> Log:
        # Samples so far apart have nothing to do with each other, however long the pause was.
        places = np.cumsum(np.append(0, np.minimum(np.diff(places), LONGEST_GAP)))

        def on_grid(values: Array) -> Array:
            result = np.zeros((int(places[-1]) + 1, *values.shape[1:]))
            result[places] = values
            return result

        return cls(on_grid(np.ones((places.size, 1))), *(on_grid(table) for table in tables))

    def coloured(self, noises: Sequence[JointNoise]) -> Array:
        """(M, n, p) Omega Phi."""
        count = self.there.size
        length = fft.next_fast_len(2 * count, real=True)
        result = np.empty_like(self.influence)
        for j, noise in enumerate(noises):
            result[:, j] = noise.variance * self.influence[:, j] * self.loudness[:, j, None]
            if noise.coefficients.size:
                column = np.zeros(length)
                column[:count] = autocorrelation(noise.coefficients, count)
                column[length - count + 1 :] = column[count - 1 : 0 : -1]
                spectrum = fft.rfft(column).real[:, None] * fft.rfft(result[:, j], length, axis=0)
                result[:, j] = fft.irfft(spectrum, length, axis=0)[:count]
        return np.asarray(result * self.there[:, :, None])

    @property
    def squares(self) -> Array:
        """(M, n) squares of the residual, of which the fit has taken the least where a sample has leverage; the mean of
        the others where it has taken most, as of the samples in which a start acts."""
        left = 1 - np.einsum("mjp,mjp->mj", self.sensitivity, self.influence)
        known = (left >= LEAST_LEFT) & (self.there > 0)
        own = np.where(known, (self.residual / np.maximum(left, LEAST_LEFT)) ** 2, 0.0)
        mean = own.sum(axis=0) / np.maximum(known.sum(axis=0), 1)
        return np.asarray(np.where(known, own, mean * self.there))

    def lost(self, noises: Sequence[JointNoise], covariance: Array, lags: int) -> Array:
        """(lags + 1, n) what the fit takes from the sums of products of its residual: S Phi' Omega + Omega Phi S'
        - S C S'."""
        through, s = self.coloured(noises), self.sensitivity
        return _lagged(s, through - s @ covariance, lags) + _lagged(through, s, lags)


def _lagged(a: Array, b: Array, lags: int) -> Array:
    """(lags + 1, n) sums over t of a_t b_(t + lag) of tables (M, n) or (M, n, p)."""
    count, axes = a.shape[0], "mjp"[: a.ndim]
    found = np.zeros((lags + 1, a.shape[1]))
    if a.shape[1] == 1:  # as products of vectors, which is several times faster
        width, first, second = a[0].size, a.ravel(), b.ravel()
        for lag in range(min(lags, count - 1) + 1):
            found[lag] = first[: (count - lag) * width] @ second[lag * width :]
        return found
    for lag in range(min(lags, count - 1) + 1):
        found[lag] = np.einsum(f"{axes},{axes}->j", a[: count - lag], b[lag:])
    return found


def varies(squares: Array, causes: Array) -> float:
    """Probability by chance of what the squares (N,) of a residual follow, by Koenker's test for each cause (N, k) and
    Bonferroni's correction."""
    own, off = squares - squares.mean(), causes - causes.mean(axis=0)
    power = np.sum(off**2, axis=0)
    there = power > TINY * np.sum(causes**2, axis=0)
    if not there.any() or not own.any():
        return 1.0
    largest = np.max(np.abs(own @ off[:, there]) / np.sqrt(power[there] * np.mean(own**2)))
    return float(min(2 * normal_sf(float(largest)) * np.count_nonzero(there), 1.0))


@dataclass(frozen=True)
class LogsOfOneRate:
    """Logs of one rate."""

    rate_hz: float
    logs: tuple[Log, ...]

    @property
    def samples(self) -> int:
        """Their number."""
        return int(sum(log.there.sum() for log in self.logs))

    def pairs(self, lags: int) -> Array:
        """(lags + 1,) numbers of pairs of samples at each lag, at least one, to divide by."""
        counts = np.sum([_lagged(log.there, log.there, lags) for log in self.logs], axis=0)
        return np.asarray(np.maximum(counts[:, 0], 1.0))

    def shares(self, noises: Sequence[JointNoise]) -> Array:
        """(n, p, p) Phi' Omega Phi of each joint."""
        return np.asarray(
            sum(np.einsum("mjp,mjq->jpq", log.influence, log.coloured(noises), optimize=True) for log in self.logs)
        )

    def autocovariance(self, noises: Sequence[JointNoise], covariance: Array, lags: int) -> Array:
        """(lags + 1, n) of the noise, from the residual and what noises like these lose in it."""
        left = np.sum([_lagged(log.residual, log.residual, lags) for log in self.logs], axis=0)
        lost = np.sum([log.lost(noises, covariance, lags) for log in self.logs], axis=0)
        # A joint whose residual is larger than its noise, because values that other joints decide are off, is taken as
        # it is: by how much they are off is not known, only how much they might be.
        return np.asarray((left + lost * (lost[0] > 0)) / self.pairs(lags)[:, None])

    def white(self) -> list[JointNoise]:
        """White noise of each joint, by its residual."""
        left = np.sum([_lagged(log.residual, log.residual, 0) for log in self.logs], axis=0)[0]
        return [JointNoise(float(v)) for v in left / np.maximum(self.samples - self.fitted, 1.0)]

    @property
    def fitted(self) -> Array:
        """(n,) samples of each joint that the fit uses up."""
        return np.asarray(sum(np.einsum("mjp,mjp->j", log.sensitivity, log.influence) for log in self.logs))

    def not_white(self, covariances: Array, floor: Array) -> list[bool]:
        """Which joints (n,) have a colour, by autocovariances (K + 1, n): all if together they do not look white,
        else those that clearly do not; never those whose residual is rounding."""
        lags, pairs = GATE_LAGS, self.pairs(GATE_LAGS)
        is_noise = covariances[0] > floor**2
        if self.samples < FEWEST_COLOURED or not is_noise.any():
            return [False] * is_noise.size
        sums = [portmanteau(column, pairs, lags) * real for column, real in zip(covariances.T, is_noise, strict=True)]
        together = portmanteau_p(sum(sums), lags * int(is_noise.sum())) < NOT_WHITE
        each = [portmanteau_p(one, lags) < CLEARLY_NOT_WHITE for one in sums]
        return [bool(real and (together or own)) for real, own in zip(is_noise, each, strict=True)]

    def varying(self) -> list[bool]:
        """Of which outputs (n,) the noise seems to be louder in places, whatever its colour."""
        if self.samples < FEWEST_COLOURED:
            return [False] * self.logs[0].residual.shape[1]
        rows = [log.there[:, 0] > 0 for log in self.logs]
        squares, size, influence = (
            np.concatenate([table[there] for table, there in zip(tables, rows, strict=True)])
            for tables in zip(*((log.squares, log.size, log.influence) for log in self.logs), strict=True)
        )
        return [
            varies(column, np.column_stack([size[:, j], influence[:, j] ** 2])) < LOUDER
            for j, column in enumerate(squares.T)
        ]

    def looks_white(self, covariances: Array, floor: Array) -> list[bool]:
        """Which outputs (n,) have noise that is white if its size may vary, by autocovariances (K + 1, n); never those
        whose residual is rounding."""
        lags = GATE_LAGS
        return [
            bool(column[0] > least**2) and portmanteau_p(self.loud_portmanteau(column, j, lags), lags) >= NOT_WHITE
            for j, (column, least) in enumerate(zip(covariances.T, floor, strict=True))
        ]

    def loud_portmanteau(self, covariance: Array, j: int, lags: int) -> float:
        """Ljung and Box's sum for noise that is louder in places: correlations over their own deviations."""
        squared = np.sum([_lagged(log.residual**2, log.residual**2, lags) for log in self.logs], axis=0)[1:, j]
        return float(np.sum((self.pairs(lags)[1:] * covariance[1 : lags + 1]) ** 2 / np.maximum(squared, TINY)))

    def refitted(
        self, noises: Sequence[JointNoise], coloured: NDArray[np.bool_], covariance: Array
    ) -> list[JointNoise]:
        """Those with a colour anew, from the residual and what they lose in it."""
        if not coloured.any():
            return list(noises)
        largest = largest_order(self.samples)
        found = self.autocovariance(noises, covariance, largest)
        # Means of fewer and fewer products, drawn towards zero so that they belong to noise that can be.
        found *= 1 - np.arange(largest + 1)[:, None] / sum(log.there.size for log in self.logs)
        return [
            JointNoise(float(column[0]), autoregression(column, self.samples, largest)) if wanted else noise
            for noise, wanted, column in zip(noises, coloured, found.T, strict=True)
        ]
