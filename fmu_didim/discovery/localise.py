"""Localisation of the model error: joint, and region of velocity, position, load, time.

For each joint the mean residual in bins of each quantity is compared with the noise; the false-discovery rate over
all bins of all joints is controlled (Benjamini and Hochberg, 1995). Intervals of time with a force of their own, or in
which an output of a model alone is off, are found one by one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmu_didim.base.distributions import normal_isf, normal_sf
from fmu_didim.data.signals import Array
from fmu_didim.dynamics.robot import RobotDescription, RobotModel
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.noise.noise import TINY, Noise, effective_fraction
from fmu_didim.fit.statistics import CONFIDENCE
from fmu_didim.model.motion import Motion, simulated_motion
from fmu_didim.results.findings import RegionResult, WindowResult

QUARTER = 0.25
"""[1] Part of normal noise beyond the median of its absolute values, on either side."""
BINS = 12
"""[bins] Of each quantity, with the same number of samples: enough to see where."""
FEWEST_EDGES = 3
"""[edges] A quantity that does not fill two bins is left out."""
FALSE_DISCOVERIES = 0.01
"""[1] Expected fraction of false ones among the regions named."""
WINDOW_SCORE = 8.0
"""[standard deviations] By which the mean of a window must differ before it counts as a force of its own: far beyond
chance, because model error is not noise."""
MAXIMUM_WINDOWS = 24
"""[windows] Looked for on a joint: hardly more are events."""
LONGEST_WINDOW = 0.3
"""[1] Fraction of the log that a window may last: a longer one is no event of its own."""
SHORTEST_WINDOW = 3
"""[samples] A window of fewer is an outlier of the logger."""
WINDOW_GRID = 800
"""[instants] At the edges of windows in the first search; then they are polished."""

NEAR = 2
"""[windows] On either side of a window, from where on what the model leaves may be larger than elsewhere: its error
comes and goes with the motion."""
VALUE_AND_HALF = 1 + 1 / 4
"""[1] Variance of a value less half of the largest, over that of a value."""
SMOOTHED = 0.25
"""[1] Part of a window over which an output is smoothed before its begin and end are read: noise moves a mean less than
a sample, and half of the height of a pulse of any form stays where it is."""


def regions_of_fit(fit: Fit, description: RobotDescription | None) -> list[RegionResult]:
    """Regions where a model disagrees with the fitted data; none if the plant does not give its motion.

    Args:
        description: the robot, None for a plant that is a black box.
    """
    motions = []
    for run in map(fit.simulation, fit.model.estimation_labels):
        motion = simulated_motion(run, None if description is None else RobotModel(description))
        if motion is None:
            return []
        experiment, time = run.experiment, run.experiment.reference.time
        places = (
            (experiment.time - float(time[0])) / run.step_size
            if run.instants is None
            else run.instants.position(experiment.time)
        )
        ticks = np.round(places - experiment.operator.lag).astype(np.int64)
        motions.append((motion, np.clip(ticks, 0, time.size - 1)))
    return regions(fit.residual, motions, fit.noise, fit.model.parameters.torque_units)


def regions(
    residual: Array, motions: Sequence[tuple[Motion, NDArray[np.int64]]], noise: Noise, units: tuple[str, ...]
) -> list[RegionResult]:
    """Regions with a mean residual of their own, the largest share first.

    Args:
        residual: (N, n); motions: of each experiment that is fitted, at all ticks, with the tick nearest to each
            sample.
        units: (n,) ``N.m`` or ``N`` of each joint.
    """
    found: list[RegionResult] = []
    factor = effective_fraction(residual)
    for j in range(residual.shape[1]):
        r = residual[:, j]
        error = max(float(np.mean(r**2)) - float(noise.deviation[j]) ** 2, TINY)
        turn = "rad" if units[j] == "N.m" else "m"
        parts = [(_quantities(motion, j, turn), ticks) for motion, ticks in motions]
        for name, (unit, _) in parts[0][0].items():
            at = np.concatenate([quantities[name][1][ticks] for quantities, ticks in parts])
            edges = np.unique(np.quantile(at, np.linspace(0, 1, BINS + 1)))
            if edges.size < FEWEST_EDGES:
                continue
            place = np.clip(np.searchsorted(edges, at, side="right") - 1, 0, edges.size - 2)
            counts = np.bincount(place, minlength=edges.size - 1)
            means = np.bincount(place, r, minlength=edges.size - 1) / np.maximum(counts, 1)
            deviation = noise.deviation[j] / np.sqrt(np.maximum(counts * factor[j], 1.0))
            p = 2 * np.asarray(normal_sf(np.abs(means) / deviation))
            noise_part = float(np.sum(counts * deviation**2)) / r.size
            share = float(np.clip((np.sum(counts * means**2) / r.size - noise_part) / error, 0.0, 1.0))
            found += [
                RegionResult(
                    joint=j + 1, quantity=name, unit=unit, low=float(edges[i]), high=float(edges[i + 1]),
                    mean=float(means[i]), share_of_gap=share, p_value=float(p[i]),
                )
                for i in range(edges.size - 1)
                if counts[i] > 0
            ]  # fmt: skip
    chances = np.sort([region.p_value for region in found])
    small = chances[chances <= FALSE_DISCOVERIES * np.arange(1, chances.size + 1) / max(chances.size, 1)]
    kept = (region for region in found if region.p_value <= max(small, default=-1.0))
    return sorted(kept, key=lambda r: (-r.share_of_gap, r.p_value))


def _quantities(motion: Motion, j: int, turn: str) -> Mapping[str, tuple[str, Array]]:
    distance = np.zeros(motion.time.size)
    travelled = np.abs(motion.dq[:, j]) * motion.step
    for k in range(1, distance.size):
        reversed_here = motion.dq[k, j] * motion.dq[k - 1, j] < 0
        distance[k] = 0.0 if reversed_here else distance[k - 1] + travelled[k]
    return {
        "velocity": (f"{turn}/s", motion.dq[:, j]),
        "distance since the last reversal": (turn, distance),
        "position": (turn, motion.q[:, j]),
        "acceleration": (f"{turn}/s2", motion.ddq[:, j]),
        "load": ("N.m" if turn == "rad" else "N", np.abs(motion.load[:, j])),
        "torque": ("N.m" if turn == "rad" else "N", motion.torque[:, j]),
        "time": ("s", motion.time),
    }


def force_windows(residual: Array, time: Array, noise: Noise, label: str) -> list[WindowResult]:
    """Intervals in which the residual of a joint has a mean that stands out, by decreasing score.

    The interval with the largest |sum| / sqrt(length) is taken, its mean removed, and the search repeated. The score is
    measured in the spread of the residual outside, so that model error everywhere is not taken for events. The drive
    must make up for a torque from outside: it is the mean with its sign reversed.

    Args:
        label: of the experiment.
    """
    found: list[WindowResult] = []
    factor = effective_fraction(residual)
    for j in range(residual.shape[1]):
        r = residual[:, j] - np.median(residual[:, j])
        spread = max(float(np.median(np.abs(r)) / normal_isf(QUARTER)), float(noise.deviation[j]))
        rest = r.copy()
        for _ in range(MAXIMUM_WINDOWS):
            a, b = _best_window(rest)
            mean = float(rest[a:b].mean())
            score = abs(mean) / spread * np.sqrt((b - a) * factor[j])
            if score < WINDOW_SCORE or b - a > LONGEST_WINDOW * r.size or abs(mean) < spread:
                break
            begin, end = float(time[a]), float(time[b - 1])
            found.append(
                WindowResult(joint=j + 1, begin_s=begin, end_s=end, torque=-mean, score=float(score), experiment=label)
            )
            rest[a:b] -= mean
    return sorted(found, key=lambda w: -w.score)


def output_windows(residual: Array, time: Array, noise: float, name: str, label: str) -> list[WindowResult]:
    """Intervals in which an output is off its model by more than elsewhere, by decreasing score.

    Each is found as in :func:`force_windows`; it begins and ends where what is measured beyond the model, smoothed over
    a quarter of it, passes half of its largest value there, whatever the form of the pulse. How many samples count as
    independent is that of the residual outside, up to where that changes its sign: a pulse itself has a colour.

    What the model leaves outside all windows, smoothed alike, moves a value h(t) and half of the largest, H/2, by

        q = 1.96 s sqrt(1 + 1/4),

    s its root mean square, everywhere or near the window, whichever is larger. An edge lies between where h passes
    H/2 - q and H/2 + q.

    Args:
        residual: (N,) measured less simulated, in the unit of the output. time: (N,) s, s[k] < s[k + 1].
        noise: standard deviation of the output, at least as large as which the spread is taken.
        name: of the output. label: of the experiment.
    """
    found: list[tuple[WindowResult, _Pulse]] = []
    rest = residual - np.median(residual)
    spread = max(float(np.median(np.abs(rest)) / normal_isf(QUARTER)), noise, TINY)
    for _ in range(MAXIMUM_WINDOWS):
        a, b = _best_window(rest)
        mean = float(rest[a:b].mean())
        count = max(round(SMOOTHED * (b - a)), 1)
        height = np.sign(mean) * _smoothed(rest, count)
        top = a + int(np.argmax(height[a:b]))
        first, last = _around(height > 0, top)
        outside, reach = rest.copy(), slice(min(a, first), max(b, last + 1))
        outside[reach] = 0.0
        score = abs(mean) / spread * np.sqrt((b - a) * float(effective_fraction(outside[:, None])[0]))
        if score < WINDOW_SCORE or b - a > LONGEST_WINDOW * rest.size or abs(mean) < spread:
            break
        first, last = _around(height >= height[top] / 2, top)
        window = WindowResult(
            joint=0, signal=name, begin_s=float(time[first]), end_s=float(time[last]), score=float(score),
            torque=float(np.sign(mean) * height[top]), experiment=label,
        )  # fmt: skip
        found.append((window, _Pulse(height, top, count, reach)))
        rest = outside
    with_intervals = [w.model_copy(update=pulse.intervals(rest, time)) for w, pulse in found]
    return sorted(with_intervals, key=lambda w: -w.score)


@dataclass(frozen=True)
class _Pulse:
    """What is measured beyond a model in a window: smoothed over ``count`` samples (N,), the place of its largest
    value, and where it is not zero."""

    height: Array
    top: int
    count: int
    reach: slice

    def intervals(self, rest: Array, time: Array) -> dict[str, tuple[float, float]]:
        """95 % intervals of begin and end, by what is left (N,) outside all windows, zero within."""
        left, free = _smoothed(rest, self.count) ** 2, rest != 0.0
        room = NEAR * (self.reach.stop - self.reach.start)
        near = np.zeros_like(free)
        near[max(self.reach.start - room, 0) : self.reach.stop + room] = True
        sizes = [float(left[own].mean()) for own in (free, free & near) if own.any()]
        off = float(normal_isf((1 - CONFIDENCE) / 2)) * np.sqrt(VALUE_AND_HALF * max(sizes, default=0.0))
        half, most = self.height[self.top] / 2, self.height[self.top]
        wide, narrow = (_around(self.height >= level, self.top) for level in (half - off, min(half + off, most)))
        begin, end = ((float(time[i]), float(time[k])) for i, k in zip(wide, narrow, strict=True))
        return {"begin_interval": begin, "end_interval": (end[1], end[0])}


def _smoothed(values: Array, count: int) -> Array:
    """(N,) mean of ``count`` neighbours, ends held."""
    before = count // 2
    padded = np.pad(values, (before, count - 1 - before), mode="edge")
    return np.convolve(padded, np.full(count, 1 / count), "valid")


def _around(holds: NDArray[np.bool_], place: int) -> tuple[int, int]:
    """First and last sample of those about a place for which something holds."""
    breaks = np.flatnonzero(~holds)
    before, after = breaks[breaks < place], breaks[breaks > place]
    return int(before[-1]) + 1 if before.size else 0, int(after[0]) - 1 if after.size else holds.size - 1


def _best_window(values: Array) -> tuple[int, int]:
    """Begin and end (exclusive) of the interval with the largest |sum| / sqrt(length), at least 3 samples long."""
    thin = max(values.size // WINDOW_GRID, 1)
    edges = np.append(np.arange(0, values.size, thin), values.size)
    total = np.concatenate([[0.0], np.cumsum(values)])

    def best(begins: NDArray[np.int64], ends: NDArray[np.int64]) -> tuple[int, int]:
        length = ends[None, :] - begins[:, None]
        sums = np.abs(total[ends][None, :] - total[begins][:, None])
        score = np.where(length >= SHORTEST_WINDOW, sums / np.sqrt(np.maximum(length, 1)), -1.0)
        i, k = np.unravel_index(int(np.argmax(score)), score.shape)
        return int(begins[i]), int(ends[k])

    def near(edge: int) -> NDArray[np.int64]:
        return np.arange(max(edge - thin, 0), min(edge + thin, values.size) + 1)

    begin, end = best(edges, edges)  # on a coarse grid of edges, then on every sample near them
    return best(near(begin), near(end))
