"""Whether uneven stamps are jittered readings of an even clock, so that its instants may be taken in their place.

    s_k = t_0 + k T + e_k,    k = 0 ... N - 1 the rows, e_k white, of one distribution, bounded

A program that stamps what an even clock has sampled is late by what the computer does at the time: row k belongs to
t_0 + k T whatever its stamp is. That holds only if no row lacks and the period stays: a row that lacks is a step of T
in e_k that does not go back, and a period that changes lets its mean wander.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmu_didim.base.distributions import DEVIATION_OF_MEDIAN
from fmu_didim.data.signals import Array

WINDOWS = (10, 50)
"""[rows] On both sides of a row, whose medians of e_k are compared: the short one sees rows that lack often, the long
one a single one below larger jitter."""
STEP = 0.5
"""[1] Of a period, by which they differ where a row lacks, or is there twice: half of what one such row makes."""
CERTAIN = 6.0
"""[standard deviations] By which a step or a wander is no scatter of medians."""
WANDER = 0.25
"""[1] Of a period, by which the mean of e_k may wander: rows belong to wrong instants by as much."""
BLOCK = 100
"""[rows] Of which that mean is taken."""
LARGEST_SCATTER = 0.35
"""[1] Of a period, up to which e_k may scatter (standard deviation): beyond, rows that lack often would not show."""
FEWEST = 100
"""[rows] Of which a clock can be told."""
OF_MEDIAN = 1.2533
"""[1] Standard deviation of a median of normal values over that of their mean."""


@dataclass(frozen=True)
class EvenClock:
    """An even clock behind stamps, or why there is none.

    Attributes:
        start: t_0, s; period: T, s; scatter: standard deviation of e_k, s; largest: of |e_k|, s.
        fault: why rows are not those of an even clock, in words; empty where they are.
    """

    start: float
    period: float
    scatter: float
    largest: float
    fault: str = ""

    def instants(self, count: int) -> Array:
        """(count,) t_0 + k T, s."""
        return np.asarray(self.start + self.period * np.arange(count, dtype=np.float64))


def even_clock(stamps: Array, rate_hz: float | None = None) -> EvenClock:
    """The even clock behind stamps (N,), s; ``rate_hz``: of the clock, where it is known."""
    rows = np.arange(stamps.size, dtype=float)
    period, start = np.polyfit(rows, stamps, 1) if stamps.size > 1 else (1.0, float(stamps[0]))
    off = stamps - start - period * rows
    near = np.abs(off - np.median(off)) <= CERTAIN * _deviation(off) + 1e-12 * period
    if near.sum() > 2:  # single late stamps do not turn the line
        period, start = np.polyfit(rows[near], stamps[near], 1)
    fitted = float(period)
    if rate_hz is not None:
        period = 1 / rate_hz
        start = float(np.median(stamps - period * rows))
    off = stamps - start - period * rows
    found = EvenClock(float(start), float(period), _deviation(off), float(np.abs(off).max()))
    fault = _fault(off, found, stamps, fitted)
    return found if not fault else EvenClock(found.start, found.period, found.scatter, found.largest, fault)


def _deviation(values: Array) -> float:
    """Robust standard deviation of the scatter of neighbours, which no step or wander adds to."""
    return float(DEVIATION_OF_MEDIAN * np.median(np.abs(np.diff(values))) / np.sqrt(2)) if values.size > 1 else 0.0


def _fault(off: Array, found: EvenClock, stamps: Array, fitted: float) -> str:
    if off.size < FEWEST:
        return f"{off.size} rows are too few to tell a clock ({FEWEST} are needed)"
    period, scatter = found.period, found.scatter
    if scatter > LARGEST_SCATTER * period:
        return (
            f"the stamps scatter by {1000 * scatter:.3g} ms, more than {LARGEST_SCATTER:g} of the period of "
            f"{1000 * period:.4g} ms: rows that lack would not show"
        )
    if (at := _step(off, period, scatter)) is not None:
        row, size = at
        lacks = f"{size:.2g} periods are lacking" if size > 0 else f"{-size:.2g} periods are there twice"
        other = abs(fitted / period - 1) * off.size > STEP  # of a rate that is stated
        rate = f", or the rate is another one ({1 / fitted:.6g} Hz fits best)" if other else ""
        return f"{lacks} near row {row + 1} (t = {stamps[row]:.6g} s), which the rows after it do not make good{rate}"
    count = off.size // BLOCK
    if count > 1:
        means = np.median(off[: count * BLOCK].reshape(count, BLOCK), axis=1)
        wander = float(np.ptp(means))
        if wander > max(WANDER * period, CERTAIN * OF_MEDIAN * scatter / np.sqrt(BLOCK)):
            return (
                f"the stamps wander by {1000 * wander:.3g} ms against an even clock of {1 / period:.6g} Hz: its period "
                f"changes, or is another one ({1 / fitted:.6g} Hz fits best)"
            )
    return ""


def _step(off: Array, period: float, scatter: float) -> tuple[int, float] | None:
    """The row before which e_k (N,) steps most, and by how many periods; None where it does not step."""
    best: tuple[int, float] | None = None
    for width in WINDOWS:
        view = np.median(np.lib.stride_tricks.sliding_window_view(off, width), axis=1)
        steps = view[width:] - view[:-width]
        if not steps.size:
            continue
        least = max(STEP * period, CERTAIN * OF_MEDIAN * scatter * np.sqrt(2 / width))
        row = int(np.abs(steps).argmax())
        if abs(steps[row]) > least and (best is None or abs(steps[row]) > abs(best[1]) * period):
            best = row + width, float(steps[row]) / period
    return best
