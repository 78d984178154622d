"""The instants at which a controller ran, where its period was not constant."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fmu_didim.data.signals import Array

BLOCK = 64
"""[rows] Over which a period is averaged at least: white jitter of a fifth of it leaves 0.5 %,"""
MOST_BLOCKS = 200
"""[blocks] and into so many at most a log is divided."""
CHANGED = 0.03
"""[1] Of a period by which the means of two blocks differ, from which it changes: a loop that is 3 % late has moved its
phase by two rows in a block."""
CERTAIN = 6.0
"""[standard deviations] Of the two means by which they differ then."""


@dataclass(frozen=True, eq=False)
class Instants:
    """Instants t_k of the ticks of a loop; between them time counts in control periods,

        x(t) = k + (t - t_k) / (t_(k+1) - t_k),      t_k <= t < t_(k+1)

    before the first and behind the last one in the first and the last period.

    Attributes:
        time: (T,) increasing, s, at least two; step: nominal control period, s.
    """

    time: Array
    step: float

    @cached_property
    def ends(self) -> Array:
        """(T + 1,) the instants, and where the last period ends, s."""
        return np.append(self.time, 2 * self.time[-1] - self.time[-2])

    @cached_property
    def periods(self) -> Array:
        """(T,) length of each period, s."""
        return np.diff(self.ends)

    def position(self, times: Array) -> Array:
        """(N,) control periods from tick 0 to times in s."""
        tick = np.clip(np.searchsorted(self.time, times, side="right") - 1, 0, self.time.size - 1)
        return np.asarray(tick + (times - self.time[tick]) / self.periods[tick])

    def at(self, positions: Array) -> Array:
        """(N,) times in s of positions in control periods: the inverse of :meth:`position`."""
        tick = np.clip(np.floor(positions), 0, self.time.size - 1).astype(np.int64)
        return np.asarray(self.time[tick] + (positions - tick) * self.periods[tick])

    def earlier(self, positions: Array, nominal: float) -> Array:
        """(N,) positions that lie earlier by so many nominal periods of time."""
        return self.position(self.at(positions) - nominal * self.step)


@dataclass(frozen=True)
class PeriodChange:
    """A period that changes: the shortest and the longest one over a block of rows, s, and where these blocks lie.

    Attributes:
        shortest, longest: mean periods, s; early, late: middle of the block of the one that comes first, and of the
            other, s; grows: whether the shortest comes first.
    """

    shortest: float
    longest: float
    early: float
    late: float
    grows: bool

    @property
    def text(self) -> str:
        """From what to what it changes."""
        first, then = (self.shortest, self.longest) if self.grows else (self.longest, self.shortest)
        return (
            f"from {1000 * first:.3g} ms (around t = {self.early:.4g} s) to {1000 * then:.3g} ms (around "
            f"{self.late:.4g} s)"
        )


def period_change(time: Array) -> PeriodChange | None:
    """How the spacing of instants (N,) changes over time; None where it does not, or scatters as much as it changes.

    The mean over blocks of rows tells it: in it the jitter of stamps averages out, and rows that lack are counted.
    """
    steps = np.diff(time)
    size = max(BLOCK, steps.size // MOST_BLOCKS)
    count = steps.size // size
    if count < 2:
        return None
    blocks = steps[: count * size].reshape(count, size)
    usual = np.median(blocks, axis=1, keepdims=True)
    places = np.maximum(np.rint(blocks / usual), 1)
    means = blocks.sum(axis=1) / places.sum(axis=1)
    errors = np.std(blocks - places * usual, axis=1) / np.sqrt(size)
    low, high = int(means.argmin()), int(means.argmax())
    change = float(means[high] - means[low])
    if change <= CHANGED * means[low] or change <= CERTAIN * float(np.hypot(errors[low], errors[high])):
        return None
    middles = [float(time[size * i + size // 2]) for i in sorted((low, high))]
    return PeriodChange(float(means[low]), float(means[high]), middles[0], middles[1], low < high)
