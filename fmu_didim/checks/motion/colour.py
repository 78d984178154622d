"""The colour of the noise in the logs of a joint, learnt beside columns that explain a part of the residual.

Noise e has a long memory d and an autoregression of an order p that is chosen,

    (1 - L)^d (1 - a_1 L - ... - a_p L^p) e_t = u_t,      L e_t = e_(t-1),  u white,

d being none, that of noise whose power grows with 1/f, or half of it. Residual r and columns X have the coefficients b
and a that explain r = X b + e with the least innovations u (Cochrane, Orcutt 1949), and d and p those with the least

    C = n log(sum of u^2 / n) + 2 (p + 1) n / (n - p - 2) + 2 (d > 0),

Akaike's criterion corrected for few samples, at the same n samples whatever the order is. So colours that are learnt
beside different columns can be compared: :mod:`fmu_didim.checks.motion.dependence`. Sources: Brockwell, Davis, Time
Series: Theory and Methods, 2nd ed., 1991, 9.3, 13.2; Hosking, Biometrika 68 (1981), for long memories.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np
from scipy import fft
from scipy.linalg import blas, lapack

from fmu_didim.cosim import Indices
from fmu_didim.data.signals import Array
from fmu_didim.fit.noise.autoregression import ORDERS, order_cost
from fmu_didim.fit.noise.noise import TINY
from fmu_didim.fit.noise.residual_noise import LONGEST_GAP
from fmu_didim.fit.uncertainty import Stretch

ROUNDS = 3
"""[rounds] Of values and colour at most; as a rule the second one changes nothing."""
SETTLED = 0.1
"""[1] Of the criterion, by which a round must change it to be made; a coefficient costs 2. Of n samples it changes by
some n times the squares by which coefficients change."""
MEMORIES = (0.0, 0.25, 0.4, 0.5)
"""[1] Exponents d that are tried: power that is level at low frequencies, grows with f^(-1/2), and with 1/f. With none
but zero a right SCARA or arm was doubted in 27 to 52 % of draws of 1/f noise, alone or beside as much white noise; with
zero and a half in 2 to 18 %, with a quarter, too, in 0 to 6 %, with all of them in 1 to 5 %."""
MEMORY_COST = 2.0
"""[1] Of a memory: that of one more coefficient in many samples."""
FAR_WORSE = 10.0
"""[1] Of the criterion, by which the longest memory is so much worse than none that those between are not tried: they
are better than both where both are nearly as good."""
SAMPLES_A_LAG = 8
"""[samples] At least for each sample of the past that is looked at: so much of a log has no past and is left out."""
WITH_PAST = 0.8
"""[1] Of the samples must have the whole past that is looked at; where rows of a log are missing, it is shorter."""
NEARLY_DEPENDENT = 1e-8
"""[1] Part of the squares of a column that others leave, below which products, which have eight digits of it then, do
not tell how much that is."""


@dataclass(frozen=True)
class Logs:
    """The logs of a joint.

    Attributes:
        stretches: rows and places of each in tables of all of them, and its rate.
        is_white: whether their noise is known to be.
        lags: samples of the past that are looked at in the logs of each rate; None: as many as they allow.
    """

    stretches: tuple[Stretch, ...]
    is_white: bool = False
    lags: tuple[int, ...] | None = None

    def with_lags(self, lags: tuple[int, ...]) -> Logs:
        """The same with so many samples of the past."""
        if lags not in self._with_lags:
            self._with_lags[lags] = replace(self, lags=lags)
        return self._with_lags[lags]

    @cached_property
    def _with_lags(self) -> dict[tuple[int, ...], Logs]:
        return {}

    @staticmethod
    def white(samples: int) -> Logs:
        """One log of white noise."""
        return Logs((Stretch(slice(0, samples), np.arange(samples), 1.0),), is_white=True)

    @property
    def memories(self) -> tuple[float, ...]:
        """Those that are tried."""
        return (0.0,) if self.is_white else MEMORIES

    @cached_property
    def grids(self) -> tuple[Indices, ...]:
        """Of each log (M,) the row in the tables at each place of its grid, -1 where it is missing."""
        found = []
        for log in self.stretches:
            # Samples so far apart have nothing to do with each other, however long the pause was.
            places = np.cumsum(np.append(0, np.minimum(np.diff(log.places), LONGEST_GAP)))
            grid = np.full(int(places[-1]) + 1, -1)
            grid[places] = np.arange(log.rows.start, log.rows.stop) if isinstance(log.rows, slice) else log.rows
            found.append(grid)
        return tuple(found)

    @cached_property
    def pasts(self) -> tuple[Indices, ...]:
        """Of the logs of each rate (M, 1 + K) the rows of samples and of the K ones before each."""
        found = []
        for number, rate in enumerate(dict.fromkeys(log.rate_hz for log in self.stretches)):
            grids = [grid for grid, log in zip(self.grids, self.stretches, strict=True) if log.rate_hz == rate]
            samples = sum(int(np.sum(grid >= 0)) for grid in grids)
            longest = 0 if self.is_white else int(min(ORDERS * np.log10(samples), samples / SAMPLES_A_LAG))
            if self.lags is not None:
                longest = self.lags[number]
            past = _with_past(grids, longest)
            while self.lags is None and longest and past.shape[0] < WITH_PAST * samples:
                longest //= 2
                past = _with_past(grids, longest)
            found.append(past)
        return tuple(found)

    @cached_property
    def rows(self) -> tuple[tuple[slice | Indices, ...], ...]:
        """The columns of ``pasts``; slices where their rows follow each other, which are ten times as fast."""
        return tuple(tuple(_as_slice(column) for column in past.T) for past in self.pasts)

    @cached_property
    def turned(self) -> tuple[Indices, ...]:
        """``pasts`` with the samples in the last column, behind those before them."""
        return tuple(np.ascontiguousarray(np.roll(past, -1, axis=1)) for past in self.pasts)

    @property
    def samples(self) -> int:
        """Number n of those that are compared."""
        return sum(past.shape[0] for past in self.pasts)

    def remembered(self, table: Array, memory: float) -> Array:
        """(1 - L)^memory of the columns (N, m); samples that are missing count as zero."""
        if not memory:
            return table
        result = np.empty_like(table)
        for grid in self.grids:
            there, count = grid >= 0, grid.size
            steps = np.arange(1, count)
            weights = np.cumprod(np.append(1.0, (steps - 1 - memory) / steps))
            held = np.zeros((count, table.shape[1]))
            held[there] = table[grid[there]]
            length = fft.next_fast_len(2 * count, real=True)
            spectrum = fft.rfft(weights, length)[:, None] * fft.rfft(held, length, axis=0)
            passed = fft.irfft(spectrum, length, axis=0)
            result[grid[there]] = passed[:count][there]
        return result


def _as_slice(rows: Indices) -> slice | Indices:
    """The same rows, as a slice if each follows the one before."""
    first = int(rows[0]) if rows.size else 0
    return slice(first, first + rows.size) if (np.diff(rows) == 1).all() else np.ascontiguousarray(rows)


def _with_past(grids: Sequence[Indices], longest: int) -> Indices:
    """(M, 1 + longest) rows of the samples of logs whose past is there, and of that."""
    found = []
    for grid in grids:
        rows = grid[np.arange(longest, grid.size)[:, None] - np.arange(longest + 1)]
        found.append(rows[(rows >= 0).all(axis=1)])
    return np.concatenate(found)


@dataclass(frozen=True)
class Colour:
    """A colour of the noise.

    Attributes:
        memory: d, as a place in ``Logs.memories``; coefficients: of each rate (p,), none if it is white.
        deviations: of the innovations of each rate, over their geometric mean; criterion: C.
    """

    memory: int
    coefficients: tuple[Array, ...]
    deviations: tuple[float, ...]
    criterion: float

    @staticmethod
    def white(rates: int) -> Colour:
        """That of white noise, in logs of so many rates."""
        return Colour(0, (np.zeros(0),) * rates, (1.0,) * rates, np.inf)

    @property
    def orders(self) -> tuple[int, ...]:
        """Order p of each rate."""
        return tuple(a.size for a in self.coefficients)


@dataclass(frozen=True)
class Columns:
    """Columns (N, m) in the tables of logs.

    Attributes:
        known: the first of them, of which others may have asked what a memory leaves.
    """

    logs: Logs
    table: Array
    known: Columns | None = None
    _remembered: dict[int, Array] = field(default_factory=dict, repr=False, compare=False)

    def beside(self, table: Array) -> Columns:
        """These, and those of a table (N, k) behind them."""
        return Columns(self.logs, np.column_stack([self.table, table]), self)

    def with_lags(self, lags: tuple[int, ...]) -> Columns:
        """The same columns where so many samples of the past are looked at."""
        return replace(self, logs=self.logs.with_lags(lags))

    def remembered(self, memory: int) -> Array:
        """(N, m) the same after a memory, by its place."""
        if memory not in self._remembered:
            exponent, known = self.logs.memories[memory], self.known
            if known is None or not exponent:
                found = self.logs.remembered(self.table, exponent)
            else:
                own = self.logs.remembered(self.table[:, known.table.shape[1] :], exponent)
                found = np.column_stack([known.remembered(memory), own])
            self._remembered[memory] = found
        return self._remembered[memory]

    def whitened(self, colour: Colour) -> Array:
        """(n, m) of those samples that have a past."""
        return _whitened(self.remembered(colour.memory), self.logs, colour)

    def colour(self, residual: int, beside: Sequence[int], most: Sequence[int] | None = None) -> Colour:
        """That of a column, by its place, beside others; ``most``: largest order of each rate.

        No memory and the longest are tried first; those between where the longest is not far worse than none.
        """
        columns = [*beside, residual]
        most = most or [past.shape[1] - 1 for past in self.logs.pasts]

        def found(memory: int) -> Colour:
            return _colour(self.remembered(memory).take(columns, axis=1), self.logs, memory, most)

        last = len(self.logs.memories) - 1
        tried = [found(memory) for memory in sorted({0, last})]
        if tried[-1].criterion < tried[0].criterion + FAR_WORSE:
            tried += [found(memory) for memory in range(1, last)]
        return min(tried, key=lambda colour: colour.criterion)


def _whitened(table: Array, logs: Logs, colour: Colour) -> Array:
    """(n, m) of columns (N, m) whose memory has been taken out."""
    table, parts = np.ascontiguousarray(table), list[Array]()
    for rows, coefficients, deviation in zip(logs.rows, colour.coefficients, colour.deviations, strict=True):
        left = table[rows[0]].ravel() / deviation
        for k, a in enumerate(coefficients, start=1):
            left = blas.daxpy(table[rows[k]].ravel(), left, a=-a / deviation)  # in place, without another table
        parts.append(left.reshape(-1, table.shape[1]))
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def _colour(table: Array, logs: Logs, memory: int, most: Sequence[int]) -> Colour:
    """The colour of the last column beside the others (N, m), when its memory has been taken out of all."""
    beside, residual = table[:, :-1], table[:, -1]
    values, best = _least_squares(table)[0], None
    for _ in range(ROUNDS):
        colour = _of_rest(residual - beside @ values, logs, memory, most, beside.shape[1])
        if best is not None and colour.orders == best.orders and logs.samples * _moved(best, colour) < SETTLED:
            break
        values, size = _least_squares(_whitened(table, logs, colour))
        cost = sum(
            order_cost(past.shape[0], order, beside.shape[1])
            for past, order in zip(logs.pasts, colour.orders, strict=True)
        )  # fmt: skip
        criterion = 2 * logs.samples * np.log(max(size, TINY)) + cost + MEMORY_COST * (memory > 0)
        if best is not None and criterion >= best.criterion:
            break
        best = replace(colour, criterion=float(criterion))
        if not any(colour.orders):
            break
    assert best is not None
    return best


def _moved(before: Colour, after: Colour) -> float:
    """Sum of the squares by which the coefficients of colours of the same orders differ."""
    pairs = zip(before.coefficients, after.coefficients, strict=True)
    return sum(float(np.sum((a - b) ** 2)) for a, b in pairs)


def _least_squares(table: Array) -> tuple[Array, float]:
    """Values (m,) of the last column by the others (N, m), which are independent, and the length of what they leave."""
    r = _triangle(table)
    return _solved(r[:-1, :-1], r[:-1, -1]), abs(float(r[-1, -1]))


def _triangle(table: Array) -> Array:
    """Upper triangle R (m, m) with R'R = T'T of a table T (N, m), by Cholesky's factorisation, which takes a quarter of
    the time of an orthogonal one and runs beside other threads; by that where columns are nearly dependent."""
    if table.shape[0] < table.shape[1]:
        return np.asarray(np.linalg.qr(table, mode="r"))
    products = table.T @ table
    r, failed = lapack.dpotrf(products, clean=True)
    if failed or (np.diag(r) ** 2 < NEARLY_DEPENDENT * np.diag(products)).any():
        return np.asarray(np.linalg.qr(table, mode="r"))
    return np.asarray(r)


def _solved(triangle: Array, right: Array) -> Array:
    """x (m,) of an upper triangle (m, m) x = right."""
    if not right.size:
        return np.zeros(0)
    found, singular = lapack.dtrtrs(triangle, right)
    if singular:
        raise np.linalg.LinAlgError(f"Column {singular} of a triangle depends on those before it.")
    return np.asarray(found)


def _of_rest(rest: Array, logs: Logs, memory: int, most: Sequence[int], used: int) -> Colour:
    """The autoregressions of what is left (N,) beside columns, ``used`` of them, when its memory has been taken out."""
    found = [_autoregression(rest, turned, p, used) for turned, p in zip(logs.turned, most, strict=True)]
    if len(found) == 1:
        return Colour(memory, (found[0][0],), (1.0,), np.inf)
    deviations = np.array([max(deviation, TINY) for _, deviation in found])
    counts = [past.shape[0] for past in logs.pasts]
    mean = np.exp(np.average(np.log(deviations), weights=counts))
    return Colour(memory, tuple(a for a, _ in found), tuple((deviations / mean).tolist()), np.inf)


def _autoregression(rest: Array, turned: Indices, most: int, used: int) -> tuple[Array, float]:
    """Coefficients of the order up to ``most`` that the criterion chooses, and the deviation of the innovations, of
    what is left (N,); ``turned`` (M, K + 1) as in ``Logs``."""
    count, longest = turned.shape[0], turned.shape[1] - 1
    if most < longest:
        turned, longest = turned[:, [*range(most), longest]], most
    r = _triangle(rest[turned])
    along = r[:, -1]
    squares = np.cumsum(along[::-1] ** 2)[::-1]  # that are left of orders 0, 1, ..., K
    squares = np.append(squares, np.zeros(longest + 1 - squares.size))
    order = int(np.argmin(count * np.log(np.maximum(squares, TINY)) + _order_costs(count, longest, used)))
    deviation = float(np.sqrt(squares[order] / count))
    return _solved(r[:order, :order], along[:order]), deviation


@lru_cache
def _order_costs(samples: int, longest: int, used: int) -> Array:
    """(longest + 1,) costs of the orders up to that."""
    return np.array([order_cost(samples, order, used) for order in range(longest + 1)])


def orthonormal(columns: Array) -> Array:
    """(N, r) basis of columns (N, m) that are independent."""
    return np.asarray(np.linalg.qr(columns)[0])


def rest_of(columns: Array, basis: Array) -> Array:
    """What an orthonormal basis (N, r) leaves of columns (N,) or (N, m)."""
    return np.asarray(columns - basis @ (basis.T @ columns))
