"""Noise of a torque log, and how much of it repeats, without any model.

A motion that repeats shows both: the difference of two periods is noise, their mean repeats. Without
repetition the noise is what is left in the residual of a model above the frequencies of the motion.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fmu_didim.cosim.sampling import filter_response
from fmu_didim.data.signals import Array, Trajectory
from fmu_didim.data.spectrum import lagged_products, power_density

REPEATS_WITHIN = 1e-6
"""[1] Two periods of a reference are the same when they differ by less than this fraction of its range: what a file
with seven digits keeps. The search for the lag allows the same of the mean square."""
SHORTEST_PERIOD = 10
"""[ticks] A shorter period would be one of the control."""
LONGEST_PERIOD = 0.75
"""[1] Fraction of a reference that a period may last: a quarter must be there twice."""
FEWEST_DIFFERENCES = 30
"""[samples] Fewer differences of two periods give no noise: the deviation of 30 is known to 13 %."""
LARGEST_CORRELATION = 0.98
"""[1] Largest correlation of neighbouring samples that is used, so that one sample of a hundred still counts."""
SEGMENTS = 6
"""[segments] A residual's spectrum comes from at least as many, for their median."""
SEGMENT = (32, 256)
"""[samples] Shortest and longest of those segments."""
ABOVE_MOTION = 4.0
"""[1] From this many times the highest frequency of the motion on, a residual counts as noise: what friction adds to
the motion has faded there."""
HIGHEST_CUT = 0.3
"""[1] Of the sample rate: the noise is looked for from there at the latest; half is the most."""
FEWEST_FREQUENCIES = 4
"""[frequencies] With fewer above the cut, the upper half of the spectrum is taken."""
UPPER_HALF = 0.5
"""[1] Where that half begins, as a fraction of the highest frequency."""
CORRELATIONS = (-0.5, 0.9)
"""[1] Range of the correlations tried for the colour of a residual."""
CORRELATION_COUNT = 57
"""[correlations] Tried in that range, in steps of 0.025."""
USUAL = (0.2, 0.2)
"""[1] Correlation of neighbouring samples that noise usually has, and its spread."""
SLOW_S = 0.05
"""[s] Noise of a current sensor is uncorrelated after this time."""
LEAST_NOISE = 1e-9
"""[1] Smallest noise, as a fraction of the torque: a simulated log may repeat exactly, its weight must stay
finite."""
BLOCKS = 20
"""[blocks] In a period, to find those in which something happened once."""
SHORTEST_BLOCK = 10
"""[samples] Shortest block: the power of fewer samples is chance."""
OUTLIER = 6.0
"""[1] A block with more than this many times the usual power is not noise,"""
MOST_OUTLIERS = 0.4
"""[1] unless more than this fraction of the blocks are: then the motion has loud and quiet parts."""
OUTLIER_ROUNDS = 4
"""[rounds] Largest number of times that blocks are left out."""
MOTION_POWER = 0.999
"""[1] Fraction of the power of the velocities below the highest frequency of a motion."""

TINY = 1e-300
"""[1] Smallest divisor."""
SMALLEST_MISFIT = 1e-12
"""[1] Smallest misfit to divide by, where a colour fits exactly."""


@dataclass(frozen=True)
class Noise:
    """Noise of the torque log.

    Attributes:
        deviation: (n,) standard deviation sigma, N.m or N.
        correlation: (n,) correlation rho of neighbouring samples, as of a first-order autoregression.
        period_s: period of the motion, None if it does not repeat; periods: how many are compared.
        source: ``periods`` or ``residual``.
        samples: of the log it was taken from.
        slow: (n,) correlation of what differs between periods at samples ``SLOW_S`` apart; None without periods.
    """

    deviation: Array
    correlation: Array
    source: str
    period_s: float | None = None
    periods: int = 1
    samples: int = 1
    slow: Array | None = None

    def of(self, columns: slice) -> Noise:
        """That of some of the outputs."""
        return replace(self, deviation=self.deviation[columns], correlation=self.correlation[columns])

    @property
    def factor(self) -> Array:
        """(n,) part f = (1 - rho)/(1 + rho) of the samples that count as independent."""
        return np.asarray((1 - self.correlation) / (1 + self.correlation))

    @property
    def weight(self) -> Array:
        """(n,) sqrt(f)/sigma: residuals times this, summed in squares, are a chi-square of N f samples."""
        return np.asarray(np.sqrt(self.factor) / self.deviation)


def period_in_ticks(reference: Trajectory) -> int | None:
    """Period of a reference whose motion repeats at least once, in ticks; None if it does not."""
    spread = np.ptp(reference.values, axis=0)
    moving = spread > 0
    if not moving.any():
        return None
    values = (reference.values[:, moving] - reference.values[:, moving].mean(axis=0)) / spread[moving]
    count = values.shape[0]
    # Mean squared difference at every lag by one transform; lags where it nearly vanishes are then looked at exactly.
    products = np.sum([lagged_products(v, v, np.arange(count)) for v in values.T], axis=0)
    squares = np.concatenate([[0.0], np.cumsum((values**2).sum(axis=1))])
    lags = np.arange(SHORTEST_PERIOD, math.ceil(LONGEST_PERIOD * count))
    both = squares[count - lags] + squares[count] - squares[lags]
    close = (both - 2 * products[lags]) / (count - lags) < REPEATS_WITHIN
    for lag in lags[close]:
        if np.abs(values[lag:] - values[:-lag]).max() < REPEATS_WITHIN:
            return int(lag)
    return None


def noise_from_periods(
    torque: Array, samples: int, *, rate_hz: float, skip: int, regressors: Array | None = None
) -> Noise | None:
    """Noise from the differences of neighbouring periods.

    Args:
        torque: (N, n) log, NaN where a sample is missing; samples: number of samples in a period.
        skip: samples at the beginning that the transient spoils.
        regressors: (N, n, m) columns whose slow change is taken out of the differences first, such as friction:
            else thermal drift would count as noise. What happened in one period only, such as an external torque, is
            left out too.

    Returns:
        None if less than one and a half periods are left.
    """
    n = torque.shape[1]
    first, second = torque[skip : torque.shape[0] - samples], torque[skip + samples :]
    if first.shape[0] < samples // 2 or first.shape[0] < FEWEST_DIFFERENCES:
        return None
    deviation, correlation, slow = np.zeros(n), np.zeros(n), np.zeros(n)
    for j in range(n):
        difference = (second[:, j] - first[:, j]) / np.sqrt(2)
        there = np.isfinite(difference)
        difference = np.where(there, difference, 0.0)
        columns = [np.ones(difference.size)]
        if regressors is not None:
            part = np.nan_to_num(regressors[skip + samples :, j])
            columns += [part[:, i] for i in range(part.shape[1]) if np.ptp(part[:, i]) > 0]
        table = np.column_stack(columns)
        table = table / np.linalg.norm(table, axis=0)
        rest, kept = _without_events(difference, table, there, max(samples // BLOCKS, SHORTEST_BLOCK))
        spread = float(np.sqrt(np.sum(rest[kept] ** 2) / max(int(kept.sum()) - table.shape[1], 1)))
        correlation[j] = np.clip(_correlation(rest, kept, spread, 1), 0.0, LARGEST_CORRELATION)
        slow[j] = _correlation(rest, kept, spread, max(round(SLOW_S * rate_hz), 1))
        # A simulated log may repeat exactly; its weight must stay finite.
        deviation[j] = max(spread, LEAST_NOISE * float(np.sqrt(np.nanmean(torque[:, j] ** 2))), TINY)
    periods = -((skip - torque.shape[0]) // samples)  # a last one that is cut short is compared as well
    count = int(np.isfinite(torque).all(axis=1).sum())
    return Noise(deviation, correlation, "periods", periods=periods, samples=count, slow=slow)


def _without_events(
    difference: Array, table: Array, there: NDArray[np.bool_], block: int
) -> tuple[Array, NDArray[np.bool_]]:
    """Residual (N,) of a difference on columns (N, m), and the samples in blocks that do not stand out."""
    place = np.arange(difference.size) // block
    kept = there
    for _ in range(OUTLIER_ROUNDS):
        rest = difference - table @ np.linalg.lstsq(table[kept], difference[kept], rcond=None)[0]
        power = np.bincount(place, rest**2 * there) / np.maximum(np.bincount(place, there), 1)
        wanted = (power <= OUTLIER * np.median(power))[place] & there
        if wanted.sum() < (1 - MOST_OUTLIERS) * there.sum():
            kept = there  # they are the rule: loud and quiet parts of the motion
            break
        if np.array_equal(wanted, kept):
            break
        kept = wanted
    rest = difference - table @ np.linalg.lstsq(table[kept], difference[kept], rcond=None)[0]
    return np.asarray(rest), kept


def _correlation(values: Array, kept: NDArray[np.bool_], deviation: float, lag: int) -> float:
    """Correlation of the kept values at a lag, in samples."""
    pairs = kept[lag:] & kept[:-lag]
    return float(np.sum((values[lag:] * values[:-lag])[pairs]) / max(float(pairs.sum()) * deviation**2, TINY))


def pooled(noises: Sequence[Noise]) -> Noise:
    """The noise of several logs as one: the drives and the logger are the same. Variances and correlations are means
    by the number of samples; the period is that of the first."""
    if len(noises) == 1:
        return noises[0]
    samples = [n.samples for n in noises]
    weights = np.array(samples, dtype=float)

    def mean(values: Sequence[Array]) -> Array:
        return np.asarray(np.average(np.array(values), axis=0, weights=weights))

    slow = None if any(n.slow is None for n in noises) else mean([n.slow for n in noises if n.slow is not None])
    return replace(
        noises[0],
        deviation=np.sqrt(mean([n.deviation**2 for n in noises])),
        correlation=mean([n.correlation for n in noises]),
        periods=sum(n.periods for n in noises),
        samples=sum(samples),
        slow=slow,
    )


def noise_from_residual(residual: Array, *, rate_hz: float, motion_hz: float, cutoff_hz: float | None = None) -> Noise:
    """Noise of a log without repetition, from what a residual (N, n) holds above the frequencies of the motion.

    The spectrum above four times the highest frequency of the motion is taken for white noise through a first-order
    filter; friction's steps reach up there too, so that the result is an upper bound. Behind a filter of the log it is
    taken up to the cut-off, by what the filter leaves there, and is that of the log without it.

    Args:
        motion_hz: highest frequency of the motion; cutoff_hz: of the filter of the log.
    """
    n = residual.shape[1]
    highest = rate_hz / 2 if cutoff_hz is None else min(cutoff_hz, rate_hz / 2)
    cut = min(ABOVE_MOTION * motion_hz, 2 * HIGHEST_CUT * highest)
    # The median of many short segments leaves out what visits a frequency only now and then, such as a sweep.
    segment = min(int(np.clip(residual.shape[0] // SEGMENTS, *SEGMENT)), residual.shape[0])
    deviation, correlation = np.zeros(n), np.zeros(n)
    for j in range(n):
        frequency, power = power_density(residual[:, j], rate_hz, segment, median=True)
        if cutoff_hz is not None:
            power = power / filter_response(frequency, cutoff_hz) ** 2
        shown = (frequency <= highest) | (cutoff_hz is None)
        upper = (frequency >= cut) & shown
        if upper.sum() < FEWEST_FREQUENCIES:
            upper = (frequency >= UPPER_HALF * min(highest, frequency[-1])) & shown
        trials = np.linspace(*CORRELATIONS, CORRELATION_COUNT)
        fits = [_misfit(power[upper], rho, frequency[upper] / rate_hz) for rho in trials]
        misfits = np.array([misfit for misfit, _ in fits])
        # Far up in frequency all colours look alike, and then the usual one is the best guess.
        unusual = (trials - USUAL[0]) / USUAL[1]
        doubt = 0.5 * upper.sum() * misfits / max(misfits.min(), SMALLEST_MISFIT) + 0.5 * unusual**2
        least = int(np.argmin(doubt))
        rho, level = trials[least], fits[least][1]
        deviation[j] = np.sqrt(max(level, TINY) * rate_hz / 2 / (1 - rho**2))
        correlation[j] = rho
    return Noise(deviation, correlation, "residual", samples=residual.shape[0])


def _misfit(power: Array, rho: float, phase: Array) -> tuple[float, float]:
    """Misfit of level / |1 - rho e^(-i w)|^2, in logarithms, and the level."""
    shape = 1.0 / (1 + rho**2 - 2 * rho * np.cos(2 * np.pi * phase))
    logs = np.log(np.maximum(power, TINY)) - np.log(shape)
    return float(np.var(logs)), float(np.exp(np.mean(logs)))


def effective_fraction(residual: Array) -> Array:
    """(n,) effective part f = (1 - rho)/(1 + rho) of the samples of a residual (N, n), rho its lag-one correlation."""
    centred = residual - residual.mean(axis=0)
    power = np.maximum(np.sum(centred**2, axis=0), TINY)
    rho = np.clip(np.sum(centred[1:] * centred[:-1], axis=0) / power, 0.0, LARGEST_CORRELATION)
    return np.asarray((1 - rho) / (1 + rho))


def joint_speed(reference: Trajectory, joint: int) -> Array:
    """(K,) velocity of a joint, counted from 1, as the reference gives it or as that of its position; raises
    UnknownNameError where it has neither."""
    given = f"dq{joint}"
    return (
        reference.column(given)
        if given in reference.names
        else np.gradient(reference.column(f"q{joint}"), reference.step)
    )


def motion_frequency(reference: Trajectory, joints: int) -> float:
    """Frequency in Hz below which 99.9 % of the power of the reference's velocities lies; 0 where nothing moves."""
    highest = 0.0
    for j in range(1, joints + 1):
        speed = joint_speed(reference, j)
        power = np.abs(np.fft.rfft(speed * np.hanning(speed.size))) ** 2
        if power.sum() <= TINY:
            continue  # a joint that rests, but for rounding
        total = np.cumsum(power) / float(power.sum())
        frequencies = np.fft.rfftfreq(speed.size, reference.step)
        highest = max(highest, float(frequencies[min(int(np.searchsorted(total, MOTION_POWER)), frequencies.size - 1)]))
    return highest
