"""Torque at a low rate: how a logged sample follows from the held command of the loop.

The command is constant over each period of the control, tau(t) = tau_k on [t_k, t_k + h). So every
logged sample, a point of it, an average or what a filter leaves, is a linear combination of the tau_k;
the same combination of the rows of the regressor belongs to it.

A low-pass without phase, a Butterworth filter of the order n run forward and backward, has the response
1 / (1 + (f/c)^2n). With its poles z_k = exp(i pi (2k + 1) / 2n), k < n, what it makes of a step at zero is

    C(t) = 1/2 + sign(t)/2 (1 - 1/n sum_k Re exp(2 pi i c |t| z_k)),

and the weight of tau_k in a sample at t is C(t - t_k) - C(t - t_k - h).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, assert_never

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from fmu_didim.base.errors import InputError
from fmu_didim.cosim.instants import Instants
from fmu_didim.data.signals import Array

Indices = NDArray[np.signedinteger[Any]]
Kind = Literal["point", "average", "filtered"]
Window = Literal["preceding", "centred", "following"]
JITTER = 0.01
"""[1] Fraction of a control period by which the stamp of an instant may lie before its tick: clocks are rounded."""
NO_WINDOW = 1e-6
"""[1] Fraction of a control period below which a window holds nothing."""
ROUNDING = 1e-9
"""[1] Of the ends of a window, in control periods: a period of which so little lies inside is not in it."""
MOST_SAMPLES = 5_000_000
"""[1] Samples of a log at another rate at most: an hour at 1 kHz, which fits into memory."""
FILTER_ORDER = 4
"""[1] Of the filter of a log, run forward and backward: that of a low-pass of the case."""
FILTER_ENDS = 1e-4
"""[1] Of the weights of a filtered sample, what lies outside its kernel: below the resolution of torque logs."""
_SHIFT = {"preceding": -1.0, "centred": -0.5, "following": 0.0}


@dataclass(frozen=True)
class SampleOperator:
    """Linear map from the values at some ticks to the logged samples.

    Attributes:
        ticks: (K,) the ticks that matter, increasing.
        matrix: (N, K) weights.
        positions: (N,) instants of point samples in control periods from tick 0; None for averages.
        lag: control periods by which :meth:`stamped_later` has moved the stamps.
        origin: the operator without that; None for one that was not moved.
        instants: of the ticks, where the control period changes: a shift is then a time, so many nominal periods.
        cutoff_hz: of the filter that the samples are behind; None without one.
    """

    ticks: NDArray[np.int64]
    matrix: sparse.csr_array
    positions: Array | None = None
    lag: float = 0.0
    origin: SampleOperator | None = None
    instants: Instants | None = None
    cutoff_hz: float | None = None

    @property
    def count(self) -> int:
        """Number of logged samples N."""
        return int(self.matrix.shape[0])

    def after(self, first: int) -> SampleOperator:
        """The operator for the samples from ``first`` on."""
        return self.at(np.arange(first, self.count))

    def at(self, rows: Indices) -> SampleOperator:
        """The operator for these samples alone."""
        return replace(
            self,
            matrix=sparse.csr_array(self.matrix[rows]),
            positions=None if self.positions is None else self.positions[rows],
            origin=None if self.origin is None else self.origin.at(rows),
        )

    def every(self, stride: int) -> SampleOperator:
        """The operator for one sample in so many, with the ticks that these need."""
        some = self.at(np.arange(0, self.count, stride))
        used, place = np.unique(some.matrix.indices, return_inverse=True)
        matrix = sparse.csr_array((some.matrix.data, place, some.matrix.indptr), shape=(some.count, used.size))
        origin = None if self.origin is None else self.origin.every(stride)
        return replace(some, ticks=self.ticks[used], matrix=matrix, origin=origin)

    def summed(self, weights: sparse.csr_array) -> SampleOperator:
        """The operator of weighted sums of the samples, by weights (N', N)."""
        origin = None if self.origin is None else self.origin.summed(weights)
        return replace(self, matrix=sparse.csr_array(weights @ self.matrix), positions=None, origin=origin)

    def before(self, count: int) -> SampleOperator:
        """The operator for the first samples, with the ticks up to the last one that they need."""
        matrix = sparse.csr_array(self.matrix[:count])
        used = int(matrix.indices.max()) + 1
        return replace(
            self,
            ticks=self.ticks[:used],
            matrix=sparse.csr_array(matrix[:, :used]),
            positions=None if self.positions is None else self.positions[:count],
            origin=None if self.origin is None else self.origin.before(count),
        )

    def thinned(self, most: int) -> SampleOperator:
        """Averages by some of the ticks alone, about ``most`` of the longest window, and straight lines between them.

        They are exact for straight lines. Windows that have no more ticks stay as they are.
        """
        stride = int(np.diff(self.matrix.indptr).max(initial=0)) // most
        if self.positions is not None or stride < 2:
            return self
        steps = np.diff(self.ticks)
        wanted = np.arange(self.ticks.size) % stride == 0
        wanted[:-1] |= steps > steps.min()  # both sides of a gap
        wanted[1:] |= steps > steps.min()
        wanted[-1] = True
        left = np.flatnonzero(wanted)
        after = np.clip(np.searchsorted(left, np.arange(self.ticks.size)), 1, left.size - 1)
        begin, end = self.ticks[left[after - 1]], self.ticks[left[after]]
        share = (self.ticks - begin) / (end - begin)
        rows = np.arange(self.ticks.size)
        lines = sparse.csr_array(
            (np.concatenate([1 - share, share]), (np.tile(rows, 2), np.concatenate([after - 1, after]))),
            shape=(rows.size, left.size),
        )
        return replace(self, ticks=self.ticks[left], matrix=sparse.csr_array(self.matrix @ lines), origin=None)

    def apply(self, values: Array) -> Array:
        """(K, ...) values at the ticks -> (N, ...) samples."""
        flat = values.reshape(values.shape[0], -1)
        return np.asarray(self.matrix @ flat).reshape(self.count, *values.shape[1:])

    def stamped_later(self, periods: float, tick_count: int, *, between: bool = False) -> SampleOperator:
        """The operator of the same log with its stamps later by so many control periods; negative: earlier.

        What a sample took at the position x then comes from x - p, between two ticks on the straight line

            tau(x) = (1 - d) tau_k + d tau_(k+1),      k = floor(x),  d = x - k

        which unlike the held command is continuous in p. A point sample is one such position, an average the sum of
        those of the ticks in its window. Before the first tick and after the last one the command is taken as there.

        Args:
            periods: p, added to the lag that there is. With none in all the command is held again, unless ``between``
                asks for the straight line there too, as a fit of p does, which needs a slope.
            tick_count: number of ticks of the reference.
        """
        key = (periods, tick_count, between)  # the same is asked for at each simulation, with another lag seldom
        found = self._last_later.get(key)
        if found is None:
            found = self._stamped_later(*key)
            self._last_later.clear()
            self._last_later[key] = found
        return found

    @cached_property
    def _last_later(self) -> dict[tuple[float, int, bool], SampleOperator]:
        return {}

    def _stamped_later(self, periods: float, tick_count: int, between: bool) -> SampleOperator:
        origin, lag = self.origin or self, self.lag + periods
        if lag == 0 and not between:
            return origin
        if origin.positions is not None:
            ticks, matrix = _lines(self._earlier(origin.positions, lag), tick_count)
        else:
            ticks, lines = _lines(self._earlier(origin.ticks.astype(np.float64), lag), tick_count)
            matrix = sparse.csr_array(origin.matrix @ lines)
        return SampleOperator(ticks, matrix, None, lag, origin, self.instants, self.cutoff_hz)

    def _earlier(self, positions: Array, lag: float) -> Array:
        return positions - lag if self.instants is None else self.instants.earlier(positions, lag)


def _lines(positions: Array, tick_count: int) -> tuple[NDArray[np.int64], sparse.csr_array]:
    """The ticks (K,) around positions (N,), and the weights (N, K) of straight lines between them."""
    low = np.floor(positions)
    ends = np.stack([low, low + 1], axis=1).astype(np.int64).clip(0, tick_count - 1)
    wanted = np.zeros(tick_count, dtype=bool)
    wanted[ends] = True
    columns = (np.cumsum(wanted) - 1)[ends].ravel()
    weights = np.stack([1 - (positions - low), positions - low], axis=1).ravel()
    ticks = np.flatnonzero(wanted)
    rows = np.arange(0, weights.size + 1, 2)
    return ticks, sparse.csr_array((weights, columns, rows), shape=(positions.size, ticks.size))


def sample_operator(
    times: Array,
    *,
    start: float,
    step: float,
    tick_count: int,
    kind: Kind = "point",
    window: Window = "preceding",
    window_s: float | None = None,
    cutoff_hz: float | None = None,
    instants: Instants | None = None,
) -> SampleOperator:
    """The operator for samples logged at ``times``.

    Args:
        times: (N,) instants of the log in s.
        start, step: instant of tick 0 and control period, s.
        tick_count: number of ticks of the reference.
        kind: ``point``: the command that acts at the instant; ``average``: its mean over a window; ``filtered``: what
            a low-pass without phase leaves there.
        window: where the window lies: it ends, is centred or starts at the instant.
        window_s: its length in s; by default the usual spacing of ``times``.
        cutoff_hz: of the filter, where it leaves half of the amplitude.
        instants: of the ticks, where the control period changes; ``start`` and ``step`` do not count then.

    Raises:
        InputError: an instant lies outside the reference, or a filter has no cut-off.
    """
    position = (times - start) / step if instants is None else instants.position(times)
    last = tick_count
    # A point needs a period that begins there; the window of an average may end where the last period does.
    end = last - JITTER if kind == "point" else last + JITTER
    first_bad = np.flatnonzero((position < -JITTER) | (position >= end))
    if first_bad.size:
        t = times[first_bad[0]]
        raise InputError(
            "The torque log reaches beyond the reference.",
            where="measurement",
            got=f"{first_bad.size} samples, the first one at t = {t:g} s",
            valid=f"t from {start:g} s to {start + last * step if instants is None else instants.ends[-1]:g} s",
            next_step="Check that both share one clock; cut the log or give the whole reference.",
        )
    rows: Indices
    columns: Indices
    match kind:
        case "point":
            ticks = np.floor(position + JITTER).astype(np.int64).clip(0)
            rows, columns, weights = np.arange(times.size), ticks, np.ones(times.size)
        case "average":
            length = _length(times, window_s) / step
            longest = last if instants is None else float(np.ptp(instants.ends)) / step
            if length > longest:
                raise InputError(
                    "The window of the averages is longer than the reference.", where="torque.window_s",
                    got=f"{length * step:g} s", valid=f"at most {longest * step:g} s",
                    next_step="Shorten the window, or give a longer reference.",
                )  # fmt: skip
            rows, columns, weights = _average(position, last, window, length, instants)
        case "filtered":
            if cutoff_hz is None:
                raise InputError(
                    "The filter of the log has no cut-off.", where="torque.cutoff_hz", got="none", valid="Hz > 0",
                    next_step="Give the frequency at which the filter of the log leaves half of the amplitude.",
                )  # fmt: skip
            rows, columns, weights = _filtered(position, last, cutoff_hz * step)
        case _:
            assert_never(kind)
    support, place = np.unique(columns, return_inverse=True)
    matrix = sparse.csr_array((weights, (rows, place)), shape=(times.size, support.size))
    positions = position if kind == "point" else None
    return SampleOperator(support.astype(np.int64), matrix, positions, instants=instants, cutoff_hz=cutoff_hz)


def _length(times: Array, window_s: float | None) -> float:
    if window_s is not None:
        return window_s
    if times.size < 2:
        raise InputError("The window of a single average is unknown.", next_step="Give window_s.")
    return float((times[-1] - times[0]) / grid_places(times)[-1])


def _average(
    position: Array, last: int, window: Window, length: float, instants: Instants | None
) -> tuple[Indices, Indices, Array]:
    """Overlap of each window with each control period; windows are cut where the data begin or end."""
    begin, end = (position + shift * length for shift in (_SHIFT[window], 1 + _SHIFT[window]))
    if instants is not None:
        begin, end = (instants.earlier(position, -shift * length) for shift in (_SHIFT[window], 1 + _SHIFT[window]))
    low, high = np.maximum(begin, 0.0), np.minimum(end, float(last))
    empty = high - low < NO_WINDOW  # nothing before the first sample: the command that acts there
    low = np.where(empty, np.clip(position, 0.0, last - 1.0), low)
    high = np.where(empty, low + NO_WINDOW, high)
    first = np.floor(low + ROUNDING).astype(np.int64)
    counts = np.minimum(np.ceil(high - ROUNDING).astype(np.int64), last) - first
    rows, before = np.repeat(np.arange(position.size), counts), np.cumsum(counts) - counts
    columns = np.arange(rows.size) - before[rows] + first[rows]
    overlap = np.minimum(columns + 1.0, high[rows]) - np.maximum(columns, low[rows])
    overlap = overlap if instants is None else overlap * instants.periods[columns]
    return rows, columns, overlap / np.add.reduceat(overlap, before)[rows]


def filter_response(frequency: Array, cutoff_hz: float) -> Array:
    """(K,) part of an amplitude that the filter of a log leaves at frequencies (K,), Hz."""
    return np.asarray(1 / (1 + (frequency / cutoff_hz) ** (2 * FILTER_ORDER)))


def _filtered(position: Array, last: int, cutoff: float) -> tuple[Indices, Indices, Array]:
    """What a low-pass of so many oscillations in a control period makes of each of these, cut where the data begin or
    end."""
    poles = np.exp(1j * np.pi * (2 * np.arange(FILTER_ORDER) + 1) / (2 * FILTER_ORDER))
    reach = -np.log(FILTER_ENDS) / (2 * np.pi * cutoff * poles.imag.min())
    first = np.floor(np.clip(position - reach, 0.0, last - 1.0)).astype(np.int64)
    counts = np.ceil(np.clip(position + reach, first + 1.0, float(last))).astype(np.int64) - first
    rows, before = np.repeat(np.arange(position.size), counts), np.cumsum(counts) - counts
    columns = np.arange(rows.size) - before[rows] + first[rows]

    def after_step(since: Array) -> Array:
        rings = sum(np.exp(2j * np.pi * cutoff * np.abs(since) * pole).real for pole in poles) / FILTER_ORDER
        return np.asarray(0.5 + np.sign(since) / 2 * (1 - rings))

    weights = after_step(position[rows] - columns) - after_step(position[rows] - columns - 1.0)
    return rows, columns, weights / np.add.reduceat(weights, before)[rows]


def grid_places(times: Array) -> Indices:
    """(N,) place of each sample of a log on its grid, of which a logger may have dropped some: 0, 1, 2, 4, ...

    A step of time counts as many places as usual steps fit into it. Where a step is shorter than half of the usual one
    there is no grid, and the samples are just counted.
    """
    steps = np.diff(times)
    counts = np.rint(steps / np.median(steps)).astype(np.int64) if steps.size else np.zeros(0, dtype=np.int64)
    return np.arange(times.size) if (counts < 1).any() else np.concatenate([[0], np.cumsum(counts)])


def decimated_times(time: Array, rate_hz: float, phase_s: float = 0.0) -> Array:
    """Instants phase + i / rate inside a log, whether or not the rate divides that of the log."""
    if not rate_hz > 0:
        raise InputError(
            "The sample rate must be positive.", got=rate_hz, valid="Hz > 0",
            next_step="Give the rate of the log in Hz.",
        )  # fmt: skip
    if phase_s < 0:
        raise InputError(
            "The phase of the samples must not be negative.", got=f"{phase_s} s", valid="phase_s >= 0",
            next_step="Give the time of the first sample after the start of the log.",
        )  # fmt: skip
    period = 1.0 / rate_hz
    first = time[0] + phase_s
    wanted = float(np.floor((time[-1] - first) / period + 1e-6)) + 1
    if not wanted <= MOST_SAMPLES:
        raise InputError(
            "The log has fewer samples than that.", where="torque.rate_hz", got=f"{rate_hz:g} Hz",
            valid=f"at most {MOST_SAMPLES} samples", next_step="Leave rate_hz out to take all that the log has.",
        )  # fmt: skip
    count = int(wanted)
    if count < 1:
        raise InputError(
            "No sample of that rate and phase falls into the log.", got=f"{rate_hz} Hz, phase {phase_s} s",
            next_step="Check both against the duration of the log.",
        )  # fmt: skip
    return np.asarray(first + np.arange(count) * period)
