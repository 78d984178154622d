"""What two answers of one model differ by, and whether that is noise.

With values v1, v2 (p,) and their covariances C1, C2 (p, p), of data that have no noise in common, the change
d = v2 - v1 has the covariance S = C1 + C2, and

    T = d' S^-1 d,       T / p ~ F(p, f)  where nothing has changed

f is the number of independent samples from which the size of the noise is known. What a change along columns A (p, k)
leaves, d = A b + noise by generalised least squares, is

    T_A = d' (S^-1 - S^-1 A (A' S^-1 A)^-1 A' S^-1) d,       T_A / (p - k) ~ F(p - k, f).

Sources: A. Wald, Transactions of the AMS 54 (1943); S. Holm, Scandinavian Journal of Statistics 6 (1979).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fmu_didim.base.distributions import chi2_isf, chi2_sf, f_isf, f_power, f_sf, normal_isf, t_ppf, t_sf
from fmu_didim.base.errors import InputError
from fmu_didim.data.signals import Array
from fmu_didim.fit.noise.noise import TINY
from fmu_didim.fit.statistics import CONFIDENCE

CHANGED = 0.001
"""[1] Probability of as large a difference by noise alone, below which something has changed: of 100 machines that are
compared each week, one is called changed in ten weeks."""
SEEN = 0.95
"""[1] Probability with which a change that is stated as visible is seen."""
LARGEST_FREEDOM = 1e6
"""[samples] From which on the size of the noise counts as known."""
RANK = 1e-12
"""[1] Smallest eigenvalue of the scaled covariance over the largest: below, a direction is known to rounding."""
NONCENTRALITY = (0.1, 1000.0, 400)
"""[1] Least and largest noncentrality of a change that is seen, and how many between: 1000 is seen with 60 parameters
and ten samples."""


def chance_of_sizes(first: float, second: float, freedom: tuple[float, float]) -> float:
    """Probability that standard deviations of two residuals, of so many independent samples, are as far apart by noise
    alone: Fisher's ratio of two variances, on both sides."""
    up = float(f_sf((max(second, TINY) / max(first, TINY)) ** 2, freedom[1], freedom[0]))
    return min(2 * min(up, 1 - up), 1.0)


@dataclass(frozen=True)
class Difference:
    """The change of the values of one model between two answers.

    Attributes:
        names, units: (p,) of the parameters; before, after: (p,) their values.
        covariance: (p, p) of the change; freedom: independent samples from which it is known, may be infinite.
        samples: of all torques that both answers were fitted to, which counts in the information criterion.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    before: Array
    after: Array
    covariance: Array
    freedom: float
    samples: int

    @property
    def change(self) -> Array:
        """(p,) after minus before."""
        return self.after - self.before

    @cached_property
    def deviation(self) -> Array:
        """(p,) standard deviation of each change."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @cached_property
    def root(self) -> Array:
        """(p, p) W with W' W = S^-1.

        Raises:
            InputError: a combination of values is known to rounding only, which is no covariance of data with noise.
        """
        scaled = self.covariance / np.outer(self.deviation, self.deviation)
        sizes, vectors = np.linalg.eigh(scaled)
        if not np.isfinite(sizes).all() or sizes[0] <= RANK * sizes[-1]:
            raise InputError(
                "The covariances of these results do not tell how far the values may be apart.", where=", ".join(
                    self.names), got=f"smallest eigenvalue {sizes[0] / sizes[-1]:.1e} of the largest",
                valid="positive definite covariances",
                next_step="Identify again with parameters that the data tell apart (condition number, correlations).",
            )  # fmt: skip
        return np.asarray((vectors / np.sqrt(sizes)).T / self.deviation)

    @cached_property
    def whitened(self) -> Array:
        """(p,) W d: of unit variance and not correlated where nothing has changed."""
        return np.asarray(self.root @ self.change)

    @cached_property
    def total(self) -> float:
        """T."""
        return float(self.whitened @ self.whitened)

    @property
    def p_value(self) -> float:
        """Of as large a T where nothing has changed."""
        return self.chance(self.total, len(self.names))

    def chance(self, chi_square: float, count: int) -> float:
        """Probability of a larger sum of squares of so many independent numbers; 1 of none."""
        if count <= 0:
            return 1.0
        if self.freedom >= LARGEST_FREEDOM:
            return float(chi2_sf(chi_square, count))
        return float(f_sf(chi_square / count, count, self.freedom))

    @property
    def bounds(self) -> float:
        """Standard deviations of each change, within which all are at once with the probability CONFIDENCE, by
        Bonferroni."""
        tail = (1 - CONFIDENCE) / (2 * len(self.names))
        if self.freedom >= LARGEST_FREEDOM:
            return float(normal_isf(tail))
        return float(t_ppf(1 - tail, self.freedom))

    @cached_property
    def holm(self) -> Array:
        """(p,) p values of each change by itself, adjusted for their number by Holm's method."""
        raw = np.minimum(
            2 * np.asarray(t_sf(np.abs(self.change) / self.deviation, min(self.freedom, LARGEST_FREEDOM))), 1.0
        )
        order = np.argsort(raw)
        found = np.empty(raw.size)
        found[order] = np.minimum(np.maximum.accumulate(raw[order] * np.arange(raw.size, 0, -1)), 1.0)
        return found

    @property
    def moved(self) -> NDArray[np.bool_]:
        """(p,) which changed beyond their joint intervals, once all together have."""
        return np.asarray((self.holm < 1 - CONFIDENCE) & (self.p_value < CHANGED))

    @cached_property
    def least_seen(self) -> Array:
        """(p,) change of each parameter alone that the test of all would have seen with the probability SEEN."""
        count, freedom = len(self.names), min(self.freedom, LARGEST_FREEDOM)
        limit = float(f_isf(CHANGED, count, freedom)) if freedom < LARGEST_FREEDOM else (
            float(chi2_isf(CHANGED, count)) / count
        )  # fmt: skip
        grid = np.geomspace(*NONCENTRALITY)  # type: ignore[call-overload]
        power = np.maximum.accumulate(f_power(limit, count, freedom, grid))
        needed = float(np.interp(SEEN, power, grid))
        return np.asarray(np.sqrt(needed / np.sum(self.root**2, axis=0)))
