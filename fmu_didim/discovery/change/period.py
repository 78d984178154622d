"""The reference period of a machine: what its logs say of the values, and how far apart logs of one state are.

Machines vary from day to day by more than the noise of one log says. Along a direction u (p,) of the values, of unit
change y_i = u' v_i with the variance c_i = u' C_i u of its log,

    y_i = m + b_i + e_i,      b_i ~ N(0, t^2),      e_i ~ N(0, c_i),      i = 1 ... N logs of the reference

m and t are not known. With t weighed by 1 / (1 + t / a) and m by 1, a new log is as far from them as y by chance with

    p = sum over t of w(t) P(|z| > |y - m(t)| / sqrt(c + t^2 + s(t)^2))

with m(t), s(t)^2 the mean of the reference and its variance for this t, and w(t) its weight after the reference. Few
logs leave large t possible, so that little is called a change; many logs without spread leave the noise alone. The
directions are those of the values themselves and the principal ones of their covariance; p of all together is that of
the smallest one times their number (Bonferroni).

Sources: A. Gelman, Bayesian Analysis 1 (2006), on priors of t; J. Higgins, S. Thompson, D. Spiegelhalter, Journal of
the Royal Statistical Society A 172 (2009), on the interval of a new study.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fmu_didim.base.distributions import chi2_sf, normal_sf, t_sf
from fmu_didim.base.errors import InputError
from fmu_didim.data.signals import Array
from fmu_didim.discovery.change.difference import LARGEST_FREEDOM

FEWEST_FOR_SPREAD = 4
"""[logs] Of a reference, from which on the spread between them is estimated: of three, each direction has two degrees
of freedom, and nothing short of fifty deviations would be a change."""
WIDE = 2.0
"""[1] Of the deviation of a log, a in the weight of t: a change is called where there is none at most 1.2 times as
often as stated along one direction, whatever the spread is, and less than stated along all of them together."""
SPREADS = (1e-3, 1e4, 141)
"""[1] Of that deviation, least and largest t that is tried beside none, and how many: a twentieth of a decade apart."""
MEDIAN = 0.5
"""[1] Probability that t is smaller than the one by which values are drawn and causes are weighed."""


@dataclass(frozen=True)
class LogValues:
    """What one log says of the values.

    Attributes:
        value: (p,); covariance: (p, p); freedom: independent samples by which its noise is known.
    """

    value: Array
    covariance: Array
    freedom: float


@dataclass(frozen=True)
class Distance:
    """How far a log is from the reference.

    Attributes:
        p_value: of as large a distance along any direction where nothing has changed.
        of_each: (p,) the same along each value alone, not adjusted.
    """

    p_value: float
    of_each: Array


@dataclass(frozen=True)
class Period:
    """Logs of one state of a machine.

    Attributes:
        names: (p,) of the values; logs: of the reference.
    """

    names: tuple[str, ...]
    logs: Sequence[LogValues]

    @property
    def knows_spread(self) -> bool:
        """Whether the spread between logs is estimated; else logs differ by their noise alone."""
        return len(self.logs) >= FEWEST_FOR_SPREAD

    @cached_property
    def values(self) -> Array:
        """(N, p)."""
        return np.array([log.value for log in self.logs])

    @cached_property
    def noise(self) -> Array:
        """(p, p) mean covariance of a log."""
        return np.asarray(np.mean([log.covariance for log in self.logs], axis=0))

    @cached_property
    def directions(self) -> Array:
        """(2 p, p) along which logs are looked at: each value, and the principal directions of the scaled noise."""
        deviation = np.sqrt(np.diag(self.noise))
        sizes, vectors = np.linalg.eigh(self.noise / np.outer(deviation, deviation))
        if not np.isfinite(sizes).all() or sizes[0] <= 0:
            raise InputError(
                "The covariances of the reference logs do not tell how far values may be apart.",
                where=", ".join(self.names), got=f"smallest eigenvalue {sizes[0]:.1e}",
                valid="positive definite covariances",
                next_step="Identify parameters that the data tell apart (condition number, correlations).",
            )  # fmt: skip
        count = len(self.names)
        return np.vstack([np.eye(count), (vectors / deviation[:, None]).T]) if count > 1 else np.eye(1)

    @cached_property
    def _spread(self) -> _Spread:
        along = self.directions
        variance = np.array([np.einsum("kp,pq,kq->k", along, log.covariance, along) for log in self.logs])
        return _Spread.of(self.values @ along.T, variance, knows=self.knows_spread)

    @cached_property
    def between(self) -> Array:
        """(p,) standard deviation of each value between logs beyond their noise, the median of what it may be."""
        return self._spread.quantile(MEDIAN)[: len(self.names)]

    @cached_property
    def mean(self) -> tuple[Array, Array]:
        """(p,) value of the machine in this period by generalised least squares, and its (p, p) covariance."""
        inverse = [np.linalg.inv(self.spread_of(log)) for log in self.logs]
        covariance = np.linalg.inv(np.sum(inverse, axis=0))
        right = np.sum([i @ log.value for i, log in zip(inverse, self.logs, strict=True)], axis=0)
        return np.asarray(covariance @ right), covariance

    def spread_of(self, log: LogValues) -> Array:
        """(p, p) covariance of a log about the value of the machine: its noise, and the spread between logs."""
        return np.asarray(log.covariance + np.diag(self.between**2))

    def distance(self, log: LogValues) -> Distance:
        """How far a log is from this period."""
        along = self.directions
        variance = np.einsum("kp,pq,kq->k", along, log.covariance, along)
        freedom = min(log.freedom, *(one.freedom for one in self.logs))
        found = self._spread.chance(along @ log.value, variance, freedom)
        return Distance(min(float(found.min()) * len(along), 1.0), found[: len(self.names)])

    def least_seen(self, log: LogValues, level: float) -> Array:
        """(p,) change of each value alone that such a log would show half of the time at this level: where the chance
        along its own direction reaches it."""
        count = len(self.directions)
        freedom = min(log.freedom, *(one.freedom for one in self.logs))
        variance = np.einsum("kp,pq,kq->k", self.directions, log.covariance, self.directions)
        low, high = np.zeros(count), np.sqrt(variance + self._spread.scale) * FARTHEST
        for _ in range(BISECTIONS):
            middle = (low + high) / 2
            seen = self._spread.chance(self._spread.centre + middle, variance, freedom) < level / count
            low, high = np.where(seen, low, middle), np.where(seen, middle, high)
        return np.asarray(high[: len(self.names)])

    @cached_property
    def noise_alone(self) -> float:
        """Probability that the reference logs are as far apart by their noise alone; 1 of a single one."""
        count = len(self.logs) - 1
        if count < 1:
            return 1.0
        inverse = [np.linalg.inv(log.covariance) for log in self.logs]
        total = np.sum(inverse, axis=0)
        right = np.sum([i @ log.value for i, log in zip(inverse, self.logs, strict=True)], axis=0)
        mean = np.linalg.solve(total, right)
        left = sum(
            float((log.value - mean) @ i @ (log.value - mean)) for i, log in zip(inverse, self.logs, strict=True)
        )
        return float(chi2_sf(left, count * len(self.names)))


FARTHEST = 1e5
"""[standard deviations] Of a change that is surely seen."""
BISECTIONS = 60
"""[steps] From there to rounding."""


@dataclass(frozen=True)
class _Spread:
    """What the reference says of each direction: for each t tried its weight, the mean and the variance of that.

    Attributes:
        weight, between, mean, variance: (K, G), between is t^2; scale: (K,) usual variance of a log.
    """

    weight: Array
    between: Array
    mean: Array
    variance: Array
    scale: Array

    @staticmethod
    def of(values: Array, noise: Array, *, knows: bool) -> _Spread:
        """Of values (N, K) with their noise (N, K)."""
        scale = np.median(noise, axis=0)
        t = np.geomspace(*SPREADS) if knows else np.zeros(0)  # type: ignore[call-overload]
        prior = np.concatenate([[SPREADS[0]], np.gradient(np.log(t)) * t / (1 + t / WIDE)]) if knows else np.ones(1)
        between = scale[:, None] * np.concatenate([[0.0], t**2])
        inverse = 1 / (noise[:, :, None] + between)
        total = inverse.sum(axis=0)
        mean = np.sum(inverse * values[:, :, None], axis=0) / total
        fit = np.sum(np.log(inverse) - inverse * (values[:, :, None] - mean) ** 2, axis=0) - np.log(total)
        log_weight = fit / 2 + np.log(prior)
        weight = np.exp(log_weight - log_weight.max(axis=1, keepdims=True))
        return _Spread(weight / weight.sum(axis=1, keepdims=True), between, mean, 1 / total, scale)

    @property
    def centre(self) -> Array:
        """(K,) mean of the reference."""
        return np.asarray(np.sum(self.weight * self.mean, axis=1))

    def chance(self, values: Array, noise: Array, freedom: float) -> Array:
        """(K,) probability of as large a distance of values (K,) with this noise (K,)."""
        apart = np.abs(values[:, None] - self.mean) / np.sqrt(noise[:, None] + self.between + self.variance)
        tail = normal_sf(apart) if freedom >= LARGEST_FREEDOM else t_sf(apart, freedom)
        return np.asarray(np.sum(self.weight * 2 * np.asarray(tail), axis=1))

    def quantile(self, share: float) -> Array:
        """(K,) t that is exceeded with the probability 1 - share."""
        reached = np.cumsum(self.weight, axis=1) >= share
        places = np.argmax(reached, axis=1)
        return np.asarray(np.sqrt(self.between[np.arange(len(places)), places]))
