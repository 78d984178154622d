"""The ticks of a machine's clock to which the rows of a log belong that a program read at its own pace.

    n_k = rate (q_k - q_(k-1)) / v_k,    v_k the local slope of the positions against the ticks

A program that asks a controller for its newest sample, again and again, reads some samples twice and others never: a
row's tick is not seen in its stamp. It is seen in the motion: from row to row the positions move by a whole number of
ticks times their velocity. Where the machine hardly moves, the stamp has the say.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmu_didim.base.distributions import DEVIATION_OF_MEDIAN
from fmu_didim.data.even_clock import BLOCK, FEWEST
from fmu_didim.data.signals import Array

Flags = NDArray[np.bool_]

WINDOWS = ((31, 2), (15, 2), (9, 2), (31, 4), (15, 4), (7, 2))
"""[rows], [1] Of the local polynomial whose slope is the velocity, and its order, one after the other, until ticks and
stamps go together: long ones are exact, and a motion that is fast against the clock needs short ones."""
PASSES = 3
"""[1] Of which the first takes velocities against the stamps, and the others against the ticks found so far."""
SIDE, ORDER = 2, 6
"""[windows], [1] On each side of a stretch in which nothing tells ticks, and coefficients of the polynomial over both:
it reaches over as much."""
CERTAIN = 6.0
"""[standard deviations] By which noise of the positions must be below half a tick, so that a step is told by them."""
LARGEST_OFF = 0.1
"""[1] Of a tick, standard deviation about whole numbers, up to which steps are those of a clock."""
NEAR = 50
"""[rows] Of which the age is a median, where ticks were counted by stamps for a while."""
WANDER = 1.0
"""[ticks] By which medians of ages may wander: a reader of nearly the same pace beats with the clock, and its rows have
ages from none to one tick; a tick that was lost adds one."""
AGAIN, OFTENER = 0.01, 2.0
"""[1] Share of rows that are the same as the one before, and times the share of those that are as two before, above
which they were read again."""
REGULAR = 0.98
"""[1] Share of such rows that are equally far from the next, from which the log holds each sample for some rows."""
LATEST = 0.01
"""[1] Quantile of the ages of rows that is no age: the newest rows are read when they come up."""


@dataclass(frozen=True)
class Ticks:
    """Ticks of rows, or why there are none.

    Attributes:
        instants: (N,) of the tick of each row, s; fresh: (N,) whether a row is the first one of its tick.
        told: part of the rows whose ticks the motion tells; off: standard deviation of their steps about whole ticks.
        skipped: number of ticks without a row; latest: largest age of a row against the newest ones, s.
        fault: why these are no rows of such a clock, in words; empty where they are.
    """

    instants: Array
    fresh: Flags
    told: float
    off: float
    skipped: int
    latest: float
    fault: str = ""


def read_again(values: Array) -> int:
    """Number of rows (N, m) that are the same as the one before, where a reader takes samples twice: 0 where rows are
    as often the same as those two before, of a machine at rest or of coarse numbers, and of a held log."""
    if values.shape[0] < FEWEST:
        return 0
    same, later = ((values[lag:] == values[:-lag]).all(axis=1) for lag in (1, 2))
    if same.mean() <= max(AGAIN, OFTENER * later.mean()):
        return 0
    apart = np.diff(np.flatnonzero(same))
    return 0 if (apart == np.median(apart)).mean() > REGULAR else int(same.sum())


def ticks_of(stamps: Array, rate_hz: float, positions: Array) -> Ticks:
    """The ticks behind rows that were read at a pace of their own.

    Args:
        stamps: (N,) of the readings, s; rate_hz: of the machine's clock; positions: (N, n) in any units.
    """
    nothing = np.zeros(stamps.size, dtype=bool)
    if stamps.size < FEWEST:
        fault = f"{stamps.size} rows are too few to tell a clock ({FEWEST} are needed)"
        return Ticks(stamps, nothing, 0.0, 0.0, 0, 0.0, fault)
    first = found = _ticks(stamps, rate_hz, positions, *WINDOWS[0])
    for window, order in WINDOWS[1:]:
        if not found.fault:
            return found
        found = _ticks(stamps, rate_hz, positions, window, order)
    return first if found.fault else found


def _ticks(stamps: Array, rate: float, positions: Array, window: int, order: int) -> Ticks:
    """The ticks by velocities of a local polynomial over a window of rows."""
    steps, told, off = _steps(stamps, rate, positions, window, order)
    count = _counted(stamps * rate, steps, told, positions, window)
    age = stamps * rate - count
    start = float(np.quantile(age, LATEST))
    fresh = np.concatenate([[True], np.diff(count) > 0])
    skipped = int(count[-1] - count[0]) + 1 - int(fresh.sum())
    latest = float((age - start).max()) / rate
    fault = _fault(told, off, rate) or _lost(stamps, count, age)
    return Ticks((count + start) / rate, fresh, float(told.mean()), off, skipped, latest, fault)


def _steps(stamps: Array, rate: float, positions: Array, window: int, order: int) -> tuple[Array, Flags, float]:
    """(N - 1,) Whole ticks from row to row, which of them the motion tells, and how far these are off whole ones."""
    change = np.diff(positions, axis=0)
    weight = 1 / np.maximum(change.std(axis=0), np.finfo(float).tiny)
    along = stamps * rate
    off, steps, told = 0.0, np.zeros(change.shape[0]), np.zeros(change.shape[0], dtype=bool)
    for _ in range(PASSES):
        velocity = _slope(along, positions, window, order)
        velocity = (velocity[1:] + velocity[:-1]) / 2
        information = ((velocity * weight) ** 2).sum(axis=1)
        moves = information > 0
        found = np.zeros(information.size)
        found[moves] = (change * velocity * weight**2).sum(axis=1)[moves] / information[moves]
        steps = np.maximum(np.rint(found), 0.0)
        fast = information >= np.median(information[moves]) if moves.any() else moves
        left = np.abs(change - velocity * steps[:, None])[fast]
        noise = DEVIATION_OF_MEDIAN * np.median(left, axis=0) if left.size else 1 / weight
        weight = 1 / np.maximum(noise, np.finfo(float).eps * np.abs(positions).max(axis=0) + np.finfo(float).tiny)
        told = ((velocity * weight) ** 2).sum(axis=1) > (2 * CERTAIN) ** 2
        off = float(np.sqrt(np.mean((found - steps)[told] ** 2))) if told.any() else 0.0
        along = _counted(stamps * rate, steps, told, positions, window)
    return steps, told, off


def _slope(along: Array, positions: Array, window: int, order: int) -> Array:
    """(N, n) d positions / d along in the middle of local polynomials against the rows."""
    from scipy.signal import savgol_filter  # few cases need it

    rate = savgol_filter(along, window, order, deriv=1)
    return np.asarray(savgol_filter(positions, window, order, deriv=1, axis=0) / rate[:, None])


def _counted(along: Array, steps: Array, told: Flags, positions: Array, window: int) -> Array:
    """(N,) ticks of the rows, rising: where steps are told by them, else by the stamps ``along`` in ticks.

    Behind a stretch in which nothing tells them, the age of rows is as before it, to a tick; which one, the motion on
    both sides says where the stretch is short.
    """
    count = np.full(along.size, np.nan)
    runs = [run for run in _runs(told) if run[1] - run[0] >= window]
    if not runs:
        return np.asarray(np.rint(along - along[0]))
    age = 0.0
    for place, (first, last) in enumerate(runs):
        own = np.concatenate([[0.0], np.cumsum(steps[first:last])])
        ages = along[first : last + 1] - own
        if place:
            own += np.rint(np.median(ages[:NEAR]) - age)
            before = runs[place - 1][1]
            if first - before < SIDE * window:
                own += _one_more(count, own, positions, before, first, SIDE * window)
        else:
            own += np.rint(ages[0])
        count[first : last + 1] = own
        age = float(np.median((along[first : last + 1] - own)[-NEAR:]))
    known = ~np.isnan(count)
    ages = np.interp(np.arange(along.size), np.flatnonzero(known), (along - count)[known])
    count[~known] = np.rint((along - ages)[~known])
    return np.asarray(np.maximum.accumulate(count))


def _one_more(count: Array, own: Array, positions: Array, before: int, first: int, side: int) -> float:
    """-1, 0 or 1 tick by which the ticks ``own`` of the rows from ``first`` on go best with those ``count`` up to
    ``before``: with which one polynomial is nearest to the positions on both sides."""
    left = slice(max(before + 1 - side, 0), before + 1)
    right = slice(first, first + min(side, own.size))
    ticks, q = count[left], np.concatenate([positions[left], positions[right]])
    ticks, q = np.concatenate([ticks, own[: right.stop - right.start]]), q - q.mean(axis=0)
    known = ~np.isnan(ticks)
    behind = np.arange(ticks.size) >= left.stop - left.start
    left_over = []
    for more in (0.0, -1.0, 1.0):
        x = ticks[known] + more * behind[known]
        columns = np.vander((x - x.mean()) / max(float(np.ptp(x)), 1.0), ORDER)
        left_over.append((float(np.sum(np.linalg.lstsq(columns, q[known], rcond=None)[1])), more))
    return min(left_over)[1]


def _runs(told: Flags) -> Iterator[tuple[int, int]]:
    """First step of each unbroken run of told ones, and the one behind its last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], told, [False]])))
    yield from zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)


def _fault(told: Flags, off: float, rate: float) -> str:
    if told.sum() < FEWEST:
        return (
            f"from row to row the positions move by whole ticks of {rate:.6g} Hz, by more than their noise, in "
            f"{told.sum()} steps only ({FEWEST} are needed). Joints that hardly move, samples that were averaged or "
            "interpolated, or another rate do that"
        )
    if off > LARGEST_OFF:
        return (
            f"the positions do not move by whole ticks of {rate:.6g} Hz from row to row: their steps are off by "
            f"{off:.2g} of a tick. Samples that were averaged or interpolated, or another rate, do that"
        )
    return ""


def _lost(stamps: Array, count: Array, age: Array) -> str:
    """Stamps that leave the ticks counted, in words; empty where they stay with them."""
    middles = np.array([np.median(block) for block in np.array_split(age, max(age.size // BLOCK, 1))])
    wander = float(np.ptp(middles))
    if wander <= WANDER:
        return ""
    return (
        f"the stamps wander by {wander:.2g} ticks against those that the motion shows: the rate is another one "
        f"({1 / np.polyfit(count, stamps, 1)[0]:.6g} Hz fits best), or ticks were lost where nothing moved"
    )
