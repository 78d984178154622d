"""Sums over the products of columns with themselves some samples before: from them come the products of what any
autoregression leaves of the columns, and no table of that is made.

An autoregression leaves u_t = x_t - a_1 x_(t-1) - ... - a_p x_(t-p) of columns x (r,). Over a run of samples without a
gap, zeros before and behind it, and with b = (1, -a_1, ..., -a_p), the sum of u u' is

    g_0 R_0 + sum_l g_l (R_l + R_l'),      R_l = sum_t x_t x_(t-l)',      g_l = sum_k b_k b_(k+l),

and those few that do not have their whole past in the run are taken from it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from fmu_didim.base.tall import ROWS
from fmu_didim.cosim import Indices
from fmu_didim.data.signals import Array

SAVED = 2
"""[sums] That take as long as one table, which they save: to be whitened, and to be multiplied by itself."""
_ONE = np.ones(1)


@dataclass(frozen=True)
class Run:
    """Samples without a gap; ``rows``: (b, r) of the columns from one of its (L,) on to before another one."""

    rows: Callable[[int, int], Array]
    size: int


@dataclass
class LagSums:
    """The sums of r = ``count`` columns over runs, as far as they have been worth it."""

    runs: Sequence[Run]
    count: int
    _asked: int = field(default=0, init=False)
    _sums: Array = field(init=False)
    _ends: dict[int, Array] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        self._sums = np.zeros((0, self.count**2))

    def products(self, coefficients: Array, lags: int) -> tuple[Array, Array] | None:
        """(r, r) sum of u u' over all samples but the first of each run, for coefficients a (p,), and (r,) the largest
        that the sums can be which its diagonal is the difference of; None where it has not been asked for so often that
        these are worth it.

        Args:
            lags: K >= p, the first samples of each run, which are left out.
        """
        order, sums = coefficients.size, self._sums
        if len(sums) <= order:
            self._asked += 1
            if order + 1 - len(sums) > SAVED * self._asked:
                return None
            self._sums = sums = self._up_to(order, sums)
        weights = np.concatenate([_ONE, -coefficients])
        gains = np.correlate(weights, weights, "full")[order:]
        found = (gains @ sums[: order + 1]).reshape(self.count, self.count)
        ends = (_toeplitz(weights, lags) @ self._at_ends(lags)).reshape(len(self.runs) * 2 * lags, self.count)
        found -= ends.T @ ends
        return found, np.abs(gains).sum() * sums[0][:: self.count + 1]

    def _up_to(self, order: int, known: Array) -> Array:
        """(order + 1, r r) the sums, each with its transpose, those that are known among them."""
        lags = range(len(known), order + 1)
        found = np.zeros((len(lags), self.count, self.count))
        for run in self.runs:
            for first in range(0, run.size, ROWS):
                before = min(first, order)
                block = run.rows(first - before, min(first + ROWS, run.size))
                for k, lag in enumerate(lags):
                    at = max(before, lag)
                    found[k] += block[at:].T @ block[at - lag : len(block) - lag]
        for k, lag in enumerate(lags):
            if lag:
                found[k] += found[k].T.copy()
        return np.concatenate([known, found.reshape(len(lags), -1)])

    def _at_ends(self, lags: int) -> Array:
        """(runs, 2, K, r) the first samples of each run, and its last ones."""
        if lags not in self._ends:
            ends = [(run.rows(0, lags), run.rows(run.size - lags, run.size)) for run in self.runs]
            self._ends[lags] = np.array(ends).reshape(len(ends), 2, lags, self.count)
        return self._ends[lags]


def _toeplitz(weights: Array, count: int) -> Array:
    """(2, K, K) by which so many samples with nothing before them, or behind them, leave what they do: of themselves,
    and of those behind them."""
    around = np.zeros(3 * count + 1)
    around[count : count + weights.size] = weights
    return np.asarray(around[_places(count)])


@lru_cache
def _places(count: int) -> Indices:
    """(2, K, K) places among weights with K zeros before them."""
    own = np.subtract.outer(np.arange(count), np.arange(count)) + count
    return np.array([own, own + count])
