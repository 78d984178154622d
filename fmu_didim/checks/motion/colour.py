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

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache, partial

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.linalg import blas, lapack

from fmu_didim.base.tall import ROWS, in_blocks, triangle_by_parts, with_rows
from fmu_didim.checks.motion.lagged import LagSums, Run
from fmu_didim.cosim import Indices
from fmu_didim.data.signals import Array
from fmu_didim.fit.noise.autoregression import ORDERS, order_cost
from fmu_didim.fit.noise.noise import TINY
from fmu_didim.fit.noise.residual_noise import LONGEST_GAP
from fmu_didim.fit.uncertainty import Stretch

Table = Array | NDArray[np.float32]
"""(N, m), in double or single precision."""

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
LONG_RUN = 100
"""[samples] On average between gaps, from which sums over runs are faster than tables: a sum has its own beginning."""
_ONE = np.ones(1)


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
    def pasts(self) -> tuple[Past, ...]:
        """Of the logs of each rate the samples that have a past, and how much of it is looked at."""
        found = []
        for number, rate in enumerate(dict.fromkeys(log.rate_hz for log in self.stretches)):
            grids = [grid for grid, log in zip(self.grids, self.stretches, strict=True) if log.rate_hz == rate]
            samples = sum(int(np.sum(grid >= 0)) for grid in grids)
            longest = 0 if self.is_white else int(min(ORDERS * np.log10(samples), samples / SAMPLES_A_LAG))
            if self.lags is not None:
                longest = self.lags[number]
            runs = [run for grid in grids for run in _runs(grid)]
            past = Past.of(runs, longest)
            while self.lags is None and longest and past.samples < WITH_PAST * samples:
                longest //= 2
                past = Past.of(runs, longest)
            found.append(past)
        return tuple(found)

    @cached_property
    def samples(self) -> int:
        """Number n of those that are compared."""
        return sum(past.samples for past in self.pasts)

    def remembered(self, table: Table, memory: float) -> Array:
        """(1 - L)^memory of the columns (N, m); samples that are missing count as zero."""
        if not memory:
            return table.astype(float, copy=False)
        result = np.empty(table.shape, order="F")
        for grid in self.grids:
            there, count = grid >= 0, grid.size
            length = fft.next_fast_len(2 * count, real=True)
            spectrum = _of_memory(memory, count, length)
            for k in range(table.shape[1]):
                held = np.zeros(count)
                held[there] = table[grid[there], k]
                result[grid[there], k] = fft.irfft(spectrum * fft.rfft(held, length), length)[:count][there]
        return result


@lru_cache(maxsize=len(MEMORIES))
def _of_memory(memory: float, count: int, length: int) -> NDArray[np.complex128]:
    """Spectrum of so many weights of (1 - L)^memory, with zeros behind them up to a length."""
    steps = np.arange(1, count)
    return np.asarray(fft.rfft(np.cumprod(np.append(1.0, (steps - 1 - memory) / steps)), length))


@dataclass(frozen=True)
class Past:
    """Samples of the logs of one rate, and the K = ``lags`` ones before each.

    Attributes:
        runs: rows in the tables of samples without a gap, more than K of each, of which all but the first K have the
            whole past; slices where they follow each other.
    """

    runs: tuple[slice | Indices, ...]
    lags: int

    @staticmethod
    def of(runs: Sequence[slice | Indices], lags: int) -> Past:
        """Those of runs (L,) of rows that are long enough."""
        return Past(tuple(run for run in runs if _size(run) > lags), lags)

    @cached_property
    def samples(self) -> int:
        """Number M of those that have the whole past."""
        return sum(_size(run) - self.lags for run in self.runs)

    @cached_property
    def rows(self) -> tuple[slice | Indices, ...]:
        """(1 + K) times the rows (M,) of the samples, of those before them, and so on; slices, which are ten times as
        fast, where they follow each other."""
        places = range(self.lags + 1)
        if len(self.runs) == 1 and isinstance(run := self.runs[0], slice):
            return tuple(slice(run.start + self.lags - k, run.stop - k) for k in places)
        whole = [np.arange(run.start, run.stop) if isinstance(run, slice) else run for run in self.runs]
        if not whole:
            return (np.zeros(0, dtype=int),) * len(places)
        return tuple(np.concatenate([run[self.lags - k : run.size - k] for run in whole]) for k in places)

    @cached_property
    def together(self) -> slice | Indices:
        """(L,) rows of all runs, one behind the other."""
        return _joined(self.runs) if self.runs else slice(0, 0)

    @cached_property
    def begins(self) -> slice | Indices:
        """Places among them of those without the whole past."""
        first = np.cumsum([0, *(_size(run) for run in self.runs)])[:-1]
        return as_slice(np.add.outer(first, np.arange(self.lags)).ravel())

    def parts(self) -> Iterator[tuple[slice | Indices, slice | Indices]]:
        """Rows of some samples and of those before them in their runs, and which of these are the samples."""
        rows, samples, count = list[slice | Indices](), list[Indices](), 0
        for run in self.runs:
            for first in range(self.lags, _size(run), ROWS):
                part = _part(run, first - self.lags, min(first + ROWS, _size(run)))
                if count + _size(part) > ROWS and rows:
                    yield _joined(rows), as_slice(np.concatenate(samples))
                    rows, samples, count = [], [], 0
                rows.append(part)
                samples.append(np.arange(count + self.lags, count + _size(part)))
                count += _size(part)
        if rows:
            yield _joined(rows), as_slice(np.concatenate(samples))

    @property
    def has_short_runs(self) -> bool:
        """Whether there are so many that what belongs to each takes longer than all samples."""
        return self.samples < LONG_RUN * len(self.runs)

    def products(self, signal: Array, most: int) -> Array:
        """(most + 1, most + 1) sums over the samples, of the products of a signal (N,) so many samples before with it
        so many before: the first row by a sum for each lag, each further one from that before it by the samples at
        the ends of the runs; where these are short, by a table of all."""
        if self.has_short_runs:
            table = np.column_stack([signal[self.rows[k]] for k in range(most + 1)])
            return np.asarray(table.T @ table)
        first, moved, k = np.zeros(most + 1), np.zeros((most, most)), self.lags
        for run in self.runs:
            own = signal[run]
            end = own.size
            first += np.correlate(own[k - most :], own[k:], "valid")[::-1]
            begin, last = (own[at - most : at][::-1] for at in (k, end))
            moved += begin[:, None] * begin - last[:, None] * last
        steps, result = np.zeros((most + 1, 2 * most + 1)), np.zeros((most + 1, 2 * most + 1))
        steps[0, : most + 1], steps[1:, 1 : most + 1] = first, moved
        np.cumsum(_aslant(steps), axis=0, out=_aslant(result))
        upper = result[:, : most + 1]
        return np.where(_upper(most + 1), upper, upper.T)


@lru_cache
def _upper(count: int) -> NDArray[np.bool_]:
    """Which elements (K, K) of so many rows are on the diagonal or above."""
    return np.triu(np.ones((count, count), dtype=np.bool_))


def _aslant(table: Array) -> Array:
    """(K, K) view of a table (K, 2 K - 1): of each row from its diagonal on."""
    count, (row, column) = len(table), table.strides
    return np.ndarray((count, count), buffer=table, strides=(row + column, column))


def _size(rows: slice | Indices) -> int:
    return int(rows.stop - rows.start) if isinstance(rows, slice) else rows.size


def _part(rows: slice | Indices, first: int, last: int) -> slice | Indices:
    """Those from a place on to before another one."""
    return slice(rows.start + first, rows.start + last) if isinstance(rows, slice) else rows[first:last]


def _joined(parts: Sequence[slice | Indices]) -> slice | Indices:
    """Rows of parts, one behind the other."""
    if len(parts) == 1:
        return parts[0]
    return as_slice(np.concatenate([np.arange(p.start, p.stop) if isinstance(p, slice) else p for p in parts]))


def as_slice(rows: Indices) -> slice | Indices:
    """The same rows, as a slice if each follows the one before."""
    first = int(rows[0]) if rows.size else 0
    return slice(first, first + rows.size) if (np.diff(rows) == 1).all() else np.ascontiguousarray(rows)


def _as_slice(places: Sequence[int]) -> slice | Indices:
    """The same of a few, of which there is one at least."""
    following = slice(places[0], places[0] + len(places))
    return following if [*places] == [*range(following.start, following.stop)] else np.array(places)


def _runs(grid: Indices) -> list[slice | Indices]:
    """The rows of a grid between those that are missing."""
    there = np.flatnonzero(grid >= 0)
    return [as_slice(grid[part]) for part in np.split(there, np.flatnonzero(np.diff(there) > 1) + 1)]


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

    @property
    def key(self) -> tuple[object, ...]:
        """The same of colours that whiten alike."""
        return self.memory, self.deviations, *(a.tobytes() for a in self.coefficients)


@dataclass(frozen=True)
class Columns:
    """Columns in the tables of logs.

    Attributes:
        table: (N, k) the last of them, in single precision or double; known: those before, of which others may have
            asked what a memory leaves.
    """

    logs: Logs
    table: Table
    known: Columns | None = None
    _remembered: dict[tuple[int, int], Array] = field(default_factory=dict, repr=False, compare=False)
    _shared: dict[int, Shared] = field(default_factory=dict, repr=False, compare=False)
    _regressions: dict[tuple[int, ...], Regression] = field(default_factory=dict, repr=False, compare=False)

    @cached_property
    def count(self) -> int:
        """Number m of them."""
        return self._first + int(self.table.shape[1])

    @cached_property
    def _first(self) -> int:
        """Place of the first one of the table."""
        return 0 if self.known is None else self.known.count

    def beside(self, table: Table) -> Columns:
        """These, and those of a table (N, k) behind them."""
        return Columns(self.logs, table, self)

    def with_lags(self, lags: tuple[int, ...]) -> Columns:
        """The same columns where so many samples of the past are looked at."""
        return replace(self, logs=self.logs.with_lags(lags))

    @property
    def first(self) -> Columns:
        """Those of the first table, which all others stand beside."""
        return self if self.known is None else self.known.first

    def shared(self, memory: int) -> Shared:
        """All of them after a memory, by its place: one for all who ask."""
        if memory not in self._shared:
            self._shared[memory] = Shared(self.taken(memory, range(self.count)))
        return self._shared[memory]

    def taken(self, memory: int, columns: Sequence[int]) -> Taken:
        """These columns, by their places, after a memory, by its place."""
        return Taken.of(self.logs, tuple(self._parts(memory, columns)), self.table.shape[0], len(columns))

    def _parts(self, memory: int, columns: Sequence[int]) -> Iterator[tuple[Table, slice | Indices]]:
        """Tables (N, c) of these columns, by their places, after a memory, by its place, and where they belong."""
        at = self
        while True:
            first, last = at._first, at.count
            places = [p for p, k in enumerate(columns) if first <= k < last]
            own = [columns[p] - first for p in places]
            if self.logs.memories[memory]:
                yield from ((at._after(memory, k), slice(p, p + 1)) for k, p in zip(own, places, strict=True))
            elif places:
                yield at.table[:, _as_slice(own)], _as_slice(places)
            if at.known is None:
                return
            at = at.known

    def rows_of(self, columns: Sequence[int]) -> Array:
        """(N, c) these columns as they are."""
        return np.concatenate(list(self.taken(0, columns).rows()))

    def _regression(self, memory: int, columns: Sequence[int]) -> Regression:
        """Of the last of these columns, which is the same whatever past is looked at."""
        key = memory, *columns
        if key in self._regressions:
            return replace(self._regressions[key], logs=self.logs)
        found = Regression.of(self, columns, memory)
        if len(self.table) <= ROWS:
            self._regressions[key] = found
        return found

    def _after(self, memory: int, column: int) -> Array:
        """(N, 1) a column of the table after a memory, which is taken out where nobody has asked for it yet."""
        key = memory, column
        if key not in self._remembered:
            own = self.table[:, column : column + 1]
            self._remembered[key] = self.logs.remembered(own, self.logs.memories[memory])
        return self._remembered[key]

    def whitened(self, colour: Colour, columns: Sequence[int] | None = None) -> Array:
        """(n, c) those samples that have a past, of these columns, or of all."""
        columns = range(self.count) if columns is None else columns
        table = np.empty((self.logs.samples, len(columns)), order="F")
        for own, block in with_rows(table, self.blocks(colour, columns)):
            own[:] = block
        return table

    def blocks(self, colour: Colour, columns: Sequence[int]) -> Iterator[Array]:
        """(b, c) the same, some samples at a time: no table of them is made."""
        return self.taken(colour.memory, columns).whitened(colour)

    def colour(
        self, residual: int, beside: Sequence[int], most: Sequence[int] | None = None, enough: float = -np.inf
    ) -> Colour:
        """That of a column, by its place, beside others.

        No memory and the longest are tried first; those between where the longest is not far worse than none.

        Args:
            most: largest order of each rate.
            enough: criterion, from which down it does not matter how low it is: no further memory is tried then.
        """
        columns = [*beside, residual]
        most = most or [past.lags for past in self.logs.pasts]
        last, tried = len(self.logs.memories) - 1, list[Colour]()
        for memory in (0, last, *range(1, last)) if last else (0,):
            if tried and tried[-1].criterion <= enough:
                break
            if len(tried) == 2 and tried[-1].criterion >= tried[0].criterion + FAR_WORSE:
                break
            tried.append(_colour(self._regression(memory, columns), memory, most))
        return min(tried, key=lambda colour: colour.criterion)


@dataclass(frozen=True)
class Taken:
    """Some columns of logs after a memory.

    Attributes:
        parts: tables (N, c) of some of them, and where they belong; samples: N; count: of the columns.
    """

    logs: Logs
    parts: tuple[tuple[Table, slice | Indices], ...]
    samples: int
    count: int

    @classmethod
    def of(cls, logs: Logs, parts: tuple[tuple[Table, slice | Indices], ...], samples: int, count: int) -> Taken:
        """Those of a short log are put into one table, which is asked again and again."""
        found = cls(logs, parts, samples, count)
        if samples > ROWS or len(parts) == 1:
            return found
        return replace(found, parts=((found.of_rows(slice(0, samples)), slice(0, count)),))

    def of_rows(self, rows: slice | Indices) -> Array:
        """(b, c) some rows; a view where it can be one."""
        if len(self.parts) == 1:
            return self.parts[0][0][rows].astype(float, copy=False)
        block = np.empty((_size(rows), self.count), order="F")
        for table, places in self.parts:
            block[:, places] = table[rows]
        return block

    def rows(self) -> Iterator[Array]:
        """(b, c) all samples, some at a time."""
        return (self.of_rows(slice(k, min(k + ROWS, self.samples))) for k in range(0, self.samples, ROWS))

    def times(self, values: Array) -> Array:
        """(N,) of them all with values (c,)."""
        return np.concatenate([block @ values for block in self.rows()])

    def along(self, table: Array) -> Array:
        """(c, k) products of them with a table (N, k)."""
        found = np.zeros((self.count, table.shape[1]))
        for own, block in with_rows(table, self.rows()):
            found += block.T @ own
        return found

    def whitened(self, colour: Colour) -> Iterator[Array]:
        """(b, c) those samples that have a past, whitened by a colour of the same memory, some at a time."""
        for past, a, deviation in zip(self.logs.pasts, colour.coefficients, colour.deviations, strict=True):
            for rows, samples in past.parts():
                block = self.of_rows(rows)
                yield (_innovations(block, a, deviation) if a.size or deviation != 1 else block)[samples]


@dataclass(frozen=True)
class Shared:
    """Columns after a memory that are asked for with many others, one after the other.

    Attributes:
        taken: (N, r) them.
    """

    taken: Taken
    _sums: dict[tuple[int, int], LagSums] = field(default_factory=dict, repr=False)

    @cached_property
    def triangle(self) -> Array | None:
        """(r, r) of them all; None where they are nearly dependent."""
        products = np.zeros((self.taken.count, self.taken.count))
        for block in self.taken.rows():
            products += block.T @ block
        return _triangle_of(products)

    def triangle_by(self, colour: Colour, logs: Logs) -> Array | None:
        """(r, r) of what a colour leaves of them at the samples that are compared; None where these are nearly
        dependent, or where it is faster to look at the samples."""
        products, largest = np.zeros((self.taken.count, self.taken.count)), np.zeros(self.taken.count)
        rates = zip(logs.pasts, colour.coefficients, colour.deviations, strict=True)
        for rate, (past, a, deviation) in enumerate(rates):
            own = None if past.has_short_runs else self._sums_of(rate, past).products(a, past.lags)
            if own is None:
                return None
            products += own[0] / deviation**2
            largest += own[1] / deviation**2
        return _triangle_of(products, largest)

    def _sums_of(self, rate: int, past: Past) -> LagSums:
        """Those over the logs of a rate: all runs that are long enough for this past."""
        key = rate, len(past.runs)
        if key not in self._sums:
            runs = [Run(partial(self._run, run), _size(run)) for run in past.runs]
            self._sums[key] = LagSums(runs, self.taken.count)
        return self._sums[key]

    def _run(self, run: slice | Indices, first: int, last: int) -> Array:
        return self.taken.of_rows(_part(run, first, last))


@dataclass(frozen=True)
class Regression:
    """A column beside others, after a memory.

    Attributes:
        first: (N, r) some of the others, which further columns stand beside, too.
        table: (N, c) the rest of them, and the column last.
        values: (m,) of the others that leave least of it.
    """

    logs: Logs
    first: Shared
    table: Array
    values: Array

    @classmethod
    def of(cls, columns: Columns, places: Sequence[int], memory: int) -> Regression:
        """Of the last one of columns, by their places, and a memory, by its place."""
        count = columns.first.count
        if list(places[:-1][:count]) != list(range(count)):
            count = 0
        first = columns.first.shared(memory) if count else Shared(columns.taken(memory, []))
        further = columns.taken(memory, places[count:])
        found = cls(columns.logs, first, np.concatenate(list(further.rows())), np.zeros(0))
        return replace(found, values=found._white()[0])

    @property
    def used(self) -> int:
        """Number m of the others."""
        return self.first.taken.count + int(self.table.shape[1]) - 1

    def rest(self, values: Array) -> Array:
        """(N,) what the others leave of it with values (m,)."""
        count = self.first.taken.count
        further = self.table @ np.concatenate([-values[count:], _ONE])
        return np.asarray(further - self.first.taken.times(values[:count]))

    def _white(self) -> tuple[Array, float]:
        """Values (m,) of the others that leave least of it, and the length of that."""
        found = None
        if (upper := self.first.triangle) is not None:
            found = _beside(upper, self.first.taken.along(self.table), self.table.T @ self.table)
        return found or _least_squares(self._whole.rows, self.used + 1)

    def by(self, colour: Colour) -> tuple[Array, float]:
        """The same of all columns whitened by a colour."""
        upper = self.first.triangle_by(colour, self.logs) if self.logs.samples > self.used else None
        if upper is None:
            return _least_squares(partial(self._whole.whitened, colour), self.used + 1)
        later, products = np.zeros(self.table.shape, order="F"), np.zeros((self.table.shape[1],) * 2)
        for past, a, deviation in zip(self.logs.pasts, colour.coefficients, colour.deviations, strict=True):
            left = _innovations(self.table[past.together], a, deviation)
            left[past.begins] = 0.0
            products += left.T @ left
            later[past.together] = _innovations(left, a, deviation, later=True)
        found = _beside(upper, self.first.taken.along(later), products)
        return found or _least_squares(partial(self._whole.whitened, colour), self.used + 1)

    @cached_property
    def _whole(self) -> Taken:
        """All of them in one table, or its parts."""
        first, count = self.first.taken, self.used + 1
        return Taken.of(self.logs, (*first.parts, (self.table, slice(first.count, count))), first.samples, count)


def _beside(upper: Array, along: Array, products: Array) -> tuple[Array, float] | None:
    """Values (r + c - 1,) of all columns but the last that leave least of that, and the length of it; None where these
    are nearly dependent.

    Args:
        upper: triangle (r, r) of the first columns; along: (r, c) products of these with the others; products: (c, c)
            of these.
    """
    own = _solved(upper, along, transposed=True)
    r = _triangle_of(products - own.T @ own, products.diagonal())
    if r is None:
        return None
    values = _solved(r[:-1, :-1], r[:-1, -1])
    first = _solved(upper, own[:, -1] - own[:, :-1] @ values)
    return np.concatenate([first, values]), abs(float(r[-1, -1]))


def _innovations(block: Array, coefficients: Array, deviation: float, *, later: bool = False) -> Array:
    """(b, c) of columns (b, c): each sample less what an autoregression (p,) makes of those before, over a deviation;
    the first p of a run of samples mean nothing; ``later``: of those behind it, of runs that begin with p zeros."""
    signal = block.ravel(order="F")
    left = signal / deviation
    for k, a in enumerate(coefficients, start=1):  # in place; the column before falls into the first p
        offset = {"offx": k} if later else {"offy": k}
        left = blas.daxpy(signal, left, n=left.size - k, a=-a / deviation, **offset)
    return left.reshape(block.shape, order="F")


def _colour(columns: Regression, memory: int, most: Sequence[int]) -> Colour:
    """The colour of what a column leaves beside others."""
    logs, used, best = columns.logs, columns.used, None
    values = columns.values
    for _ in range(ROUNDS):
        colour = _of_rest(columns.rest(values), logs, memory, most, used)
        if best is not None and colour.orders == best.orders and logs.samples * _moved(best, colour) < SETTLED:
            break
        values, size = columns.by(colour)
        cost = sum(order_cost(past.samples, order, used) for past, order in zip(logs.pasts, colour.orders, strict=True))
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


def _least_squares(blocks: Callable[[], Iterable[Array]], count: int) -> tuple[Array, float]:
    """Values (m,) of the last one of so many columns by the others, which are independent, and the length of what they
    leave."""
    r = triangle_of_blocks(blocks, count)
    return _solved(r[:-1, :-1], r[:-1, -1]), abs(float(r[-1, -1]))


def triangle(table: Array) -> Array:
    """Upper triangle R (m, m) with R'R = T'T of a table T (N, m), by Cholesky's factorisation, which takes a quarter of
    the time of an orthogonal one and runs beside other threads; by that where columns are nearly dependent."""
    return triangle_of_blocks(lambda: in_blocks(table), table.shape[1])


def triangle_of_blocks(blocks: Callable[[], Iterable[Array]], count: int) -> Array:
    """The same of a table of so many columns, of which some rows (b, m) are made at a time, once or twice."""
    products, samples = np.zeros((count, count)), 0
    for block in blocks():
        products += block.T @ block
        samples += len(block)
    r = None if samples < count else _triangle_of(products)
    return triangle_by_parts(blocks(), count) if r is None else r


def _triangle_of(products: Array, squares: Array | None = None) -> Array | None:
    """Upper triangle R (m, m) with R'R = products of columns; None where these are nearly dependent; ``squares``: (m,)
    that the diagonal of the products is the rest of, if it is one."""
    if not products.size:
        return products
    r, failed = lapack.dpotrf(products, clean=True)
    squares = products.diagonal() if squares is None else squares
    dependent = failed or (r.diagonal() ** 2 < NEARLY_DEPENDENT * squares).any()
    return None if dependent else np.asarray(r)


def _solved(upper: Array, right: Array, *, transposed: bool = False) -> Array:
    """x (m,) or (m, c) of an upper triangle (m, m), or a transposed one, times x = right."""
    if not right.size:
        return np.zeros(right.shape)
    found, singular = lapack.dtrtrs(upper, right, trans=transposed)
    if singular:
        raise np.linalg.LinAlgError(f"Column {singular} of a triangle depends on those before it.")
    return np.asarray(found)


def _of_rest(rest: Array, logs: Logs, memory: int, most: Sequence[int], used: int) -> Colour:
    """The autoregressions of what is left (N,) beside columns, ``used`` of them, when its memory has been taken out."""
    found = [_autoregression(rest, past, p, used) for past, p in zip(logs.pasts, most, strict=True)]
    if len(found) == 1:
        return Colour(memory, (found[0][0],), (1.0,), np.inf)
    deviations = np.array([max(deviation, TINY) for _, deviation in found])
    counts = [past.samples for past in logs.pasts]
    mean = np.exp(np.average(np.log(deviations), weights=counts))
    return Colour(memory, tuple(a for a, _ in found), tuple((deviations / mean).tolist()), np.inf)


def _autoregression(rest: Array, past: Past, most: int, used: int) -> tuple[Array, float]:
    """Coefficients of the order up to ``most`` that the criterion chooses, and the deviation of the innovations, of
    what is left (N,)."""
    count, longest = past.samples, min(most, past.lags)
    products = past.products(rest, longest)
    size = products.diagonal()
    there = count > longest and size.min() > NEARLY_DEPENDENT * size.max()
    r = _triangle_of(products.take(_first_at_last(longest + 1))) if there else None
    if r is None:
        order = [*range(1, longest + 1), 0]
        r = np.asarray(np.linalg.qr(np.column_stack([rest[past.rows[k]] for k in order]), mode="r"))
    along = r[:, -1]
    squares = np.cumsum(along[::-1] ** 2)[::-1]  # that are left of orders 0, 1, ..., K
    if squares.size <= longest:
        squares = np.append(squares, np.zeros(longest + 1 - squares.size))
    best = int(np.argmin(count * np.log(np.maximum(squares, TINY)) + _order_costs(count, longest, used)))
    deviation = float(np.sqrt(squares[best] / count))
    return _solved(r[:best, :best], along[:best]), deviation


@lru_cache
def _first_at_last(count: int) -> Indices:
    """(K, K) places of the elements of a table (K, K) whose first row and column stand behind all others: the samples
    behind those before them."""
    order = np.roll(np.arange(count), -1)
    return np.asarray(count * order[:, None] + order)


@lru_cache
def _order_costs(samples: int, longest: int, used: int) -> Array:
    """(longest + 1,) costs of the orders up to that."""
    return np.array([order_cost(samples, order, used) for order in range(longest + 1)])


def orthonormal(columns: Array) -> Array:
    """(N, r) basis of columns (N, m) that are independent; by their triangle, and that of what it leaves, which is as
    exact as an orthogonal factorisation (Yamamoto et al., Electronic Transactions on Numerical Analysis 44 (2015)), in
    a fraction of its time."""
    if not 0 < columns.shape[1] <= columns.shape[0]:
        return np.asarray(np.linalg.qr(columns)[0])
    basis, found = columns, np.empty(columns.shape, order="F")
    for _ in range(2):
        r = triangle(basis)
        size = np.abs(np.diag(r))
        if not size.min() > NEARLY_DEPENDENT * np.sqrt(np.einsum("ij,ij->j", r, r)).max():
            return np.asarray(np.linalg.qr(columns)[0])
        inverse = lapack.dtrtri(r)[0]
        for first in range(0, len(found), ROWS):
            found[first : first + ROWS] = (inverse.T @ basis[first : first + ROWS].T).T  # column by column
        basis = found
    return found


def asked_twice(blocks: Callable[[], Iterable[Array]], samples: int) -> Callable[[], Iterable[Array]]:
    """Blocks of so many samples, which are made once if they are few."""
    if samples > ROWS:
        return blocks
    made = list(blocks())
    return lambda: made


@dataclass(frozen=True)
class Beside:
    """What an orthonormal basis (N, r) leaves of c columns, by products: of a long log no table of it is made.

    Attributes:
        along: (r, c) of the columns along the basis; squares: (c,) of the columns themselves.
        products: (c, c) of what is left.
    """

    along: Array
    squares: Array
    products: Array

    @staticmethod
    def of(basis: Array, blocks: Callable[[], Iterable[Array]], count: int) -> Beside:
        """Of so many columns, of which some rows (b, c) are made at a time, twice."""
        blocks = asked_twice(blocks, len(basis))
        along, squares, products = np.zeros((basis.shape[1], count)), np.zeros(count), np.zeros((count, count))
        for own, block in with_rows(basis, blocks()):
            along += own.T @ block
            squares += np.einsum("ij,ij->j", block, block)
        for own, block in with_rows(basis, blocks()):
            left = less(block, own, along)
            products += left.T @ left
        return Beside(along, squares, products)


def rest_of(columns: Array, basis: Array) -> Array:
    """What an orthonormal basis (N, r) leaves of columns (N,) or (N, m)."""
    return less(columns, basis, basis.T @ columns)


def less(columns: Array, basis: Array, along: Array) -> Array:
    """Columns (N,) or (N, m) less those along a basis (N, r) that have these amounts (r,) or (r, m); all column by
    column, as tables lie in memory: a table row by row beside them takes three times as long."""
    found = np.asarray((along.T @ basis.T).T)
    return np.subtract(columns, found, out=found)
