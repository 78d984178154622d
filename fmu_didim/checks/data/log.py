"""Errors that a torque log shows by itself: missing samples, jitter, upsampling, saturation, outliers and so on."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, PROBLEM, REMARK, Diagnostic, by_weight
from fmu_didim.base.distributions import DEVIATION_OF_MEDIAN
from fmu_didim.checks.data.expected import Expected
from fmu_didim.checks.judgement import MATTERS
from fmu_didim.cosim import Indices, grid_places, period_change
from fmu_didim.cosim.instants import PeriodChange
from fmu_didim.data.even_clock import EvenClock, even_clock
from fmu_didim.data.filters import running_maximum, running_median
from fmu_didim.data.signals import Array
from fmu_didim.fit.base_projection import BaseProjection
from fmu_didim.fit.noise.noise import TINY, effective_fraction
from fmu_didim.model.experiment import Experiment

REFERENCE_STEP = 0.01
"""[1] Of a control period by which stamps of a reference may lie off, as in the master."""
OF_THE_LOOP = 0.1
"""[1] Of a control period by which the shortest period of a log may differ where the loop wrote it."""
SAME = 1e-9
"""[1] Of the range of a column within which values count as equal: rounding."""
STRAIGHT = 1e-5
"""[1] Of the range of a column within which three samples lie on a straight line: the rounding of a text file."""
FEWEST_STAIRS = 10
"""[steps] Of equal length, below which a staircase may be chance."""
ON_STAIRS = (1.0, 99.0)
"""[%] Between which the ends of its steps must lie on their grid."""
NEARLY_CONTROL_RATE = 0.9
"""[1] Of the control rate, from which stairs in a log are rightly those of the held command."""
JITTER = 0.05
"""[1] Of a sample period by which stamps may scatter: rounding of clocks is less."""
ON_TICKS = 0.9
"""[1] Of the steps between uneven stamps that are whole control periods, from which these are ticks: of stamps that are
late by chance a fiftieth are, and half where they are rounded to half a period."""
COARSE = 256
"""[steps] In the range of a column, up to which quantisation is reported: 8 bits; finer steps are below usual noise."""
TOO_COARSE = 24
"""[steps] In the range, up to which quantisation hardly acts as noise: it is above 1 % of the torque."""
ON_GRID = 0.02
"""[1] Of a step by which values may lie off the grid of a quantised log: rounding."""
STUCK = 0.05
"""[1] Part of the samples that have one value one after the other, from which a log may stand still,"""
FEWEST_STUCK = 20
"""[samples] and their smallest number."""
CLIPPED = 0.01
"""[1] Part of the samples at an extreme value from which a log may be saturated,"""
FEWEST_CLIPPED = 5
"""[samples] and their smallest number,"""
CLIPPED_SPREAD = 0.1
"""[1] and the part of its range by which the expected torque varies at those samples: at rest, or where the
controller saturates in the model too, it does not."""
PILED = 4.0
"""[1] Samples at an extreme value of a quantised log, over those one step from it, from which they are piled up there:
a sine has at most 2.4 times as many, one that is cut off at 95 % eight times."""
SPIKE = 0.5
"""[1] Of the range of a column (its 5 % to 95 % quantile) by which a sample must leave the median of its neighbours:
a reversal of friction that comes at another moment leaves less."""
ALONE = 0.3
"""[1] Of that range, from which a sample may be wrong that nothing else in the log comes near:"""
BEYOND = 4.0
"""[1] it leaves its neighbours, which it has on both sides, by so many times what"""
OTHERS = 0.01
"""[1] this part of the samples, two at least, leaves them: those at reversals and in noise."""
NEIGHBOURS = 5
"""[samples] Of that median: one or two of them may be spikes."""
FAR_FROM_NOISE = 6.0
"""[standard deviations] Of the noise about the median of the neighbours, from which a sample may be wrong."""
QUANTILES = (5.0, 95.0)
"""[%] Between which the range of a column is taken, free of outliers."""
MOST_SPIKES = 0.1
"""[1] Part of the samples above which they are no outliers but the rule."""

LOG_CONSTANT = CATALOGUE(
    "log-constant", PROBLEM, rank=6,
    meaning="A torque column does not change, throughout or for long, although the joint's torque must: the wrong "
    "column, a dead channel, or a logger that repeats its last value.",
    next_step="Check the columns of the log: torque: {columns: {tau1: ...}}.",
)  # fmt: skip
LOG_COPIED = CATALOGUE(
    "log-copied", PROBLEM, rank=2,
    meaning="Two torque columns are the same: one joint's torque stands in the place of another one's.",
    next_step="Check the columns of the log: torque: {columns: {tau1: ...}}; each joint has a torque of its own.",
)  # fmt: skip
RATE_ABOVE_LOG = CATALOGUE(
    "rate-above-log", PROBLEM, rank=7,
    meaning="rate_hz requests more samples than the log has: they would be counted as independent measurements.",
    next_step="Leave out torque.rate_hz, or choose at most the rate of the log.",
)  # fmt: skip
LOG_UPSAMPLED = CATALOGUE(
    "log-upsampled", DOUBT, rank=8,
    meaning="The log has been brought to a higher rate than it was measured at: samples are held or interpolated, so "
    "standard deviations are too small and the torque is late or smoothed.",
    next_step="Export the log at its own rate, or give that rate as torque.rate_hz.",
)  # fmt: skip
LOG_SATURATED = CATALOGUE(
    "log-saturated", DOUBT, rank=16,
    meaning="Many samples have the same extreme value where the torque must vary: the sensor, the drive or the export "
    "clips it.",
    next_step="Leave those samples out, widen the range of the logger, or model the limit (effect torque_saturation).",
)  # fmt: skip
LOG_OUTLIERS = CATALOGUE(
    "log-outliers", DOUBT, rank=17,
    meaning="Single samples differ from their neighbours, or from the model, by more than motion and noise explain: "
    "errors of the logger, or pushes from outside that last for some samples.",
    next_step="Remove wrong samples from the log (gaps are allowed), or leave them out: torque: {outliers: "
    "leave_out}; for pushes: fmu-didim discover CASE.yaml.",
)  # fmt: skip
FEW_OUTLIERS = CATALOGUE(
    "few-outliers", REMARK, rank=17,
    meaning="Single samples differ from their neighbours, or from the model, by more than motion and noise explain, "
    "but by too little, or too few of them, to move the values. In a held-out log they raise the error that is judged.",
    next_step="",
)  # fmt: skip
OUTLIERS_LEFT_OUT = CATALOGUE(
    "outliers-left-out", REMARK, rank=17,
    meaning="Outliers of the log were left out, as the case asks for: values and standard deviations come from the "
    "other samples. If they were pushes from outside, the model lacks those.",
    next_step="",
)  # fmt: skip
LOG_COARSE = CATALOGUE(
    "log-coarse", DOUBT, rank=18,
    meaning="The log is quantised so coarsely that its error is neither small nor like noise.",
    next_step="Log with a finer resolution, or over the full range of the converter.",
)  # fmt: skip
LOG_QUANTISED = CATALOGUE(
    "log-quantised", REMARK, rank=18,
    meaning="The log is quantised; the steps are small enough to act as noise.",
    next_step="",
)  # fmt: skip
STAMPS_JITTER = CATALOGUE(
    "stamps-jitter", DOUBT, rank=19,
    meaning="The stamps of the log scatter about equal steps: if they are those of arrival, not of measurement, the "
    "torque is compared at wrong instants.",
    next_step="Find out what the stamps mean; if the samples were taken at equal steps, say so where the file is "
    "named: time: {name: ..., jittered: true}, of torque and positions alike; if a program read the newest sample "
    "of the machine at its own pace: time: {name: ..., rate_hz: ..., polled: [columns of positions]}.",
)  # fmt: skip
STAMPS_ON_TICKS = CATALOGUE(
    "stamps-on-ticks", REMARK, rank=91,
    meaning="The rows of a log are uneven, and whole control periods apart: its stamps are ticks of the controller, of "
    "which the logger took some.",
    next_step="Nothing if the rate of the control loop is stated rightly.",
)  # fmt: skip
PERIOD_CHANGES = CATALOGUE(
    "period-changes", DOUBT, rank=3,
    meaning="The control period changes, and the loop is simulated with a constant one: the clock seems late, friction "
    "and inertia take up the rest.",
    next_step="Name the file whose rows are the instants of the controller in the experiment: instants: log.csv.",
)  # fmt: skip
LOG_RATE_CHANGES = CATALOGUE(
    "log-rate-changes", REMARK, rank=20,
    meaning="The log comes at a rate that changes, but not at that of the control. If the control loop writes it, its "
    "period changes, too.",
    next_step="Then log every control period, and name the file in the experiment: instants: log.csv.",
)  # fmt: skip
SAMPLES_MISSING = CATALOGUE(
    "samples-missing", REMARK, rank=20,
    meaning="The logger has dropped samples. The others are used; a gap near a reversal hides what happens there.",
    next_step="",
)  # fmt: skip


def log_diagnostics(
    experiment: Experiment, label: str, given: Expected, control_rate_hz: float, *, with_outliers: bool = True
) -> list[Diagnostic]:
    """The diagnostics of the log of one experiment.

    Args:
        given: the expected torque; control_rate_hz: of the loop.
        with_outliers: whether single samples that leave their neighbours are looked for.
    """
    found = [
        *_missing(experiment, label),
        *_of_stamps(experiment, label, control_rate_hz),
        *_upsampled(experiment, label, control_rate_hz),
        *_copied(experiment.torque, label),
    ]
    for j in range(experiment.torque.shape[1]):
        place, values = f"{label}: joint {j + 1}", experiment.torque[:, j]
        constant = [*_constant(experiment, j, place, given)] or [*_stuck(experiment, j, place, given)]
        found += constant or [
            *_quantised(values, place),
            *_saturated(values, j, place, given),
            *(_outliers(j, place, given, held_out=experiment.role == "validation") if with_outliers else ()),
        ]
    return found


def swings_in(j: int, given: Expected) -> bool:
    """Whether no sample of a joint (from 0) leaves its neighbours by more than the expected torque does near it."""
    return _spikes(j, given) is None


def _missing(experiment: Experiment, label: str) -> Iterator[Diagnostic]:
    places = experiment.places
    total = int(places[-1]) + 1
    missing = total - places.size
    if missing:
        first = experiment.time[np.argmax(np.diff(places) > 1)]
        text = (
            f"{missing} of {total} torque samples {'is' if missing == 1 else 'are'} missing, the first of them "
            f"after t = {first:.6g} s. The others are used; a gap near a reversal hides what happens there."
        )
        yield Diagnostic(SAMPLES_MISSING, text, label, float(missing), unit="samples")


def _of_period(change: PeriodChange, experiment: Experiment, label: str, period: float) -> Iterator[Diagnostic]:
    """A log whose rate changes: that of the loop itself, which the case does not know, or of a logger of its own."""
    if experiment.operator.instants is not None:
        return
    if abs(change.shortest / period - 1) <= OF_THE_LOOP:
        text = f"The control period changes {change.text}, and the case has {1000 * period:.4g} ms throughout."
        yield Diagnostic(PERIOD_CHANGES, text, label, 1000 * change.longest, 1000 * period, "ms")
        return
    text = f"The rows of the log come at a period that changes {change.text}: that of the loop, if this writes them."
    yield Diagnostic(LOG_RATE_CHANGES, text, label)


def scatter_of_steps(stamps: Array, places: Indices) -> float:
    """Standard deviation (s) of white jitter that scatters the steps between stamps as much as they do.

    A clock that wanders, such as that of a loop with a late cycle now and then, scatters about one line, its steps
    hardly.
    """
    steps = np.diff(stamps) / np.diff(places)
    return float(np.std(steps) / np.sqrt(2))


def _of_stamps(experiment: Experiment, label: str, control_rate_hz: float) -> Iterator[Diagnostic]:
    stamps = experiment.time if experiment.stamps is None else experiment.stamps
    places = grid_places(stamps)
    change = period_change(stamps)
    if change is not None:
        yield from _of_period(change, experiment, label, 1 / control_rate_hz)
    elif stamps.size > 2:
        slope, origin = np.polyfit(places, stamps, 1)
        scatter = min(float(np.std(stamps - origin - slope * places)), scatter_of_steps(stamps, places)) / slope
        if scatter > JITTER:
            text = f"The stamps scatter by {1000 * scatter * slope:.3g} ms about steps of {1000 * slope:.4g} ms"
            if (share := on_ticks(stamps, 1 / control_rate_hz)) >= ON_TICKS:
                text += f", and {100 * share:.3g} % of them are whole control periods apart, as its ticks are."
                yield Diagnostic(STAMPS_ON_TICKS, text, label, share, ON_TICKS, "1")
            else:
                yield _of_jitter(even_clock(stamps), text, label, scatter)
    rate = float(places[-1] / (stamps[-1] - stamps[0]))
    if experiment.rate_hz > rate * (1 + REFERENCE_STEP):
        text = f"rate_hz requests {experiment.rate_hz:.4g} Hz, but the log has {rate:.4g} Hz."
        yield Diagnostic(RATE_ABOVE_LOG, text, label, experiment.rate_hz, rate, "Hz")


def on_ticks(stamps: Array, period: float) -> float:
    """Share of the steps between stamps (N,), s, that are whole numbers of a control period, s; 0 of a period that is
    such a part of a second, 1 ms say, as stamps are rounded to anyhow."""
    decimals = -np.log10(period)
    if abs(decimals - np.rint(decimals)) < REFERENCE_STEP:
        return 0.0
    steps = np.diff(stamps) / period
    return float(np.mean(np.abs(steps - np.rint(steps)) < REFERENCE_STEP))


def _of_jitter(clock: EvenClock, text: str, label: str, scatter: float) -> Diagnostic:
    """Scattered stamps: whether they are those of an even clock, and what to do then."""
    if clock.fault:
        text += f", and are not those of an even clock with all its rows: {clock.fault}."
        step = (
            "Find out what the stamps mean. Where a program read a machine's newest sample at its own pace, some "
            "twice and others never, positions in the same rows show the ticks: time: {name: ..., rate_hz: that of "
            "the machine, polled: [columns of positions]}; else log the machine's own clock, too."
        )
        return Diagnostic(STAMPS_JITTER, text, label, scatter, JITTER, "1", step)
    text += (
        f", as readings of an even clock of {1 / clock.period:.6g} Hz do that a program stamps late: no row is missing."
    )
    return Diagnostic(STAMPS_JITTER, text, label, scatter, JITTER, "1")


def _upsampled(experiment: Experiment, label: str, control_rate_hz: float) -> Iterator[Diagnostic]:
    for order, how in ((1, "held"), (2, "interpolated")):
        every = stairs(experiment.torque, order)
        rate = experiment.rate_hz / every
        if every > 1 and not (order == 1 and rate > NEARLY_CONTROL_RATE * control_rate_hz):
            text = (
                f"The log at {experiment.rate_hz:.4g} Hz seems to be measured at {rate:.4g} Hz: the samples between "
                f"are {how}."
            )
            step = f"Give torque: {{rate_hz: {rate:.6g}}}, or export the log at its own rate."
            yield Diagnostic(LOG_UPSAMPLED, text, label, experiment.rate_hz, rate, "Hz", step)
            return


def stairs(torque: Array, order: int) -> float:
    """Samples in a step of a log (N, n) that is held (order 1) or interpolated (order 2) between steps; otherwise 1.

    A difference of that order vanishes except at the ends of the steps. These lie on a grid m k + c, to within a sample
    where the ratio m of the rates is no whole number; a quantised signal stays constant at irregular intervals.
    """
    rounding = SAME if order == 1 else STRAIGHT
    moved = (np.abs(np.diff(torque, order, axis=0)) > rounding * np.ptp(torque, axis=0)).any(axis=1)
    places = np.flatnonzero(moved)
    steps = np.diff(places)
    if steps.size < FEWEST_STAIRS or np.median(steps) < 2:
        return 1.0
    counts = np.maximum(np.rint(steps / np.median(steps)), 1)
    every = float(steps.sum() / counts.sum())
    phase = places - every * np.concatenate([[0.0], np.cumsum(counts)])
    return every if np.ptp(np.percentile(phase, ON_STAIRS)) < 1 else 1.0


def _copied(torque: Array, label: str) -> Iterator[Diagnostic]:
    """Columns of a log (N, n) that are the same, those that vary."""
    ranges = np.ptp(torque, axis=0)
    for j, k in itertools.combinations(range(torque.shape[1]), 2):
        apart = float(np.abs(torque[:, j] - torque[:, k]).max())
        if ranges[j] > SAME * float(np.abs(torque).max()) and apart <= SAME * float(ranges[j]):
            text = f"Its torque is that of joint {j + 1}, sample by sample."
            yield Diagnostic(LOG_COPIED, text, f"{label}: joint {k + 1}", apart)


def _constant(experiment: Experiment, j: int, place: str, given: Expected) -> Iterator[Diagnostic]:
    values, best = experiment.torque[:, j], given.nominal if given.nominal is not None else given.fitted
    size = float(np.abs(experiment.torque).max())
    if np.ptp(values) > SAME * size or best is None:
        return
    varies = float(np.ptp(best[:, j]))
    if varies > STRAIGHT * float(np.abs(best).max()):
        text = f"The log is {values[0]:.4g} throughout, where the motion needs a torque that varies by {varies:.4g}."
        yield Diagnostic(LOG_CONSTANT, text, place, float(np.ptp(values)))


def _standing(values: Array) -> slice:
    """The longest part of a column (N,) that has one value."""
    same = np.abs(np.diff(values)) <= SAME * np.ptp(values)
    edges = np.flatnonzero(np.diff(same, prepend=False, append=False))
    if not edges.size:
        return slice(0, 0)
    begins, ends = edges[::2], edges[1::2]
    k = int(np.argmax(ends - begins))
    return slice(int(begins[k]), int(ends[k]) + 1)


def _stuck(experiment: Experiment, j: int, place: str, given: Expected) -> Iterator[Diagnostic]:
    """A part of the log that stands still at a value that is no extreme, as one that is clipped would."""
    values, best, part = experiment.torque[:, j], given.best, _standing_still(experiment.torque[:, j], j, given)
    if best is None or part is None:
        return
    time = experiment.time
    begin, end = time[part.start], time[part.stop - 1]
    text = (
        f"The log is {values[part.start]:.4g} from t = {begin:.6g} s to {end:.6g} s, where the expected torque varies "
        f"by {np.ptp(best[part, j]):.4g}."
    )
    left = f"to_s: {begin:.6g}" if part.stop == values.size else f"from_s: {end:.6g}"
    step = f"Leave that part out, {left}, or take the rows out of the log (gaps are allowed), or record anew."
    yield Diagnostic(LOG_CONSTANT, text, place, float(part.stop - part.start), unit="samples", next_step=step)


def _standing_still(values: Array, j: int, given: Expected) -> slice | None:
    """The part of a column (N,) that stands still where the torque must vary; None without one."""
    part, best = _standing(values), given.best
    if best is None or part.stop - part.start < max(FEWEST_STUCK, STUCK * values.size):
        return None
    value = float(values[part.start])
    is_extreme = min(value - values.min(), values.max() - value) <= SAME * np.ptp(values)
    bound = max(CLIPPED_SPREAD, 2 / (steps_in_range(values) or np.inf))
    varies = float(np.ptp(best[part, j])) > bound * max(float(np.ptp(best[:, j])), TINY)
    return part if varies and not is_extreme else None


def wrong_by_themselves(experiment: Experiment, given: Expected) -> NDArray[np.bool_]:
    """(N, n) samples that are no torque of any motion: of columns and parts that stand still, and outliers."""
    wrong = np.zeros(experiment.torque.shape, dtype=bool)
    for j in range(experiment.torque.shape[1]):
        values = experiment.torque[:, j]
        if [*_constant(experiment, j, "", given)]:
            wrong[:, j] = True
        elif part := _standing_still(values, j, given):
            wrong[part, j] = True
        elif (found := _spikes(j, given)) is not None:
            wrong[found.rows, j] = True
    return wrong


def column_diagnostics(values: Array, place: str) -> list[Diagnostic]:
    """What a column (N,) shows by itself, whatever it is."""
    return list(_quantised(values, place))


def _quantised(values: Array, place: str) -> Iterator[Diagnostic]:
    steps = steps_in_range(values)
    if steps is None or steps > COARSE:
        return
    text = f"The log has {steps} steps of {np.ptp(values) / steps:.4g} in its range."
    code, bound = (LOG_COARSE, TOO_COARSE) if steps <= TOO_COARSE else (LOG_QUANTISED, COARSE)
    yield Diagnostic(code, text, place, float(steps), float(bound), "steps")


def steps_in_range(values: Array) -> int | None:
    """Number of equal steps in the range of a log (N,); None where its values lie on no grid."""
    own = np.unique(values)
    gaps = np.diff(own)
    gaps = gaps[gaps > STRAIGHT * np.ptp(values)]
    if gaps.size == 0:
        return None
    steps = float(np.rint(np.ptp(values) / gaps.min()))
    places = (own - own[0]) * steps / np.ptp(values)
    return int(steps) if np.abs(places - np.rint(places)).max() <= ON_GRID else None


def _saturated(values: Array, j: int, place: str, given: Expected) -> Iterator[Diagnostic]:
    best = given.best
    if best is None:
        return
    found, steps = [], steps_in_range(values)
    for extreme in (float(values.max()), float(values.min())):
        at = np.abs(values - extreme) <= SAME * np.ptp(values)
        if at.sum() < max(FEWEST_CLIPPED, CLIPPED * values.size) or not is_piled(values, extreme, steps):
            continue
        spread = float(np.ptp(best[at, j])) / max(float(np.ptp(best[:, j])), TINY)
        bound = max(CLIPPED_SPREAD, 2 / (steps or np.inf))
        if spread > bound:
            text = (
                f"{at.sum()} of {values.size} samples have the extreme value {extreme:.4g}, where the expected torque "
                f"varies by {100 * spread:.0f} % of its range."
            )
            found.append(Diagnostic(LOG_SATURATED, text, place, spread, bound, "1"))
    yield from by_weight(found)[:1]


def is_piled(values: Array, extreme: float, steps: int | None) -> bool:
    """Whether more values (N,) have an extreme value than steps alone bring there; always where there are none."""
    if steps is None:
        return True
    places = np.rint(np.abs(values - extreme) * steps / np.ptp(values))
    return bool(np.sum(places == 0) > PILED * np.sum(places == 1))


@dataclass(frozen=True)
class _Spikes:
    """Samples that leave their neighbours by up to ``largest``, more than ``bound``; ``spread``: of the log."""

    rows: Indices
    largest: float
    bound: float
    spread: float


def _spikes(j: int, given: Expected) -> _Spikes | None:
    """The samples of a joint that motion and noise do not explain; None without any, or where they are the rule."""
    best = given.best
    if best is None:
        return None
    values = given.measured[:, j]
    if values.size < NEIGHBOURS:
        return None
    spread = float(np.ptp(np.percentile(values, QUANTILES)))
    rests = [signal - running_median(signal, NEIGHBOURS, outside=0.0) for signal in (values, values - best[:, j])]
    deviation = np.min(np.abs(rests), axis=0)
    if given.nominal is not None:  # a loop that swings in leaves its neighbours, too, a sample earlier or later
        simulated = given.nominal[:, j]
        swings = np.abs(simulated - running_median(simulated, NEIGHBOURS, outside=0.0))
        deviation = np.maximum(deviation - running_maximum(swings, NEIGHBOURS), 0.0)
    noise = FAR_FROM_NOISE * DEVIATION_OF_MEDIAN * float(np.median(np.abs(rests[1])))
    lowest = max(_lone(deviation, spread), noise)
    rows = np.flatnonzero(deviation > np.where(_is_inside(values.size), lowest, max(SPIKE * spread, noise)))
    if 0 < rows.size <= MOST_SPIKES * values.size:
        return _Spikes(rows, float(deviation.max()), lowest, spread)
    return None


def _outliers(j: int, place: str, given: Expected, *, held_out: bool) -> Iterator[Diagnostic]:
    found, best = _spikes(j, given), given.best
    if found is None or best is None:
        return
    values, spikes = given.measured[:, j], found.rows
    text = (
        f"{spikes.size} of {values.size} samples differ from their neighbours by up to {found.largest:.4g}; "
        f"nine tenths of the log lie within {found.spread:.4g}."
    )
    if held_out:
        squares = (values - best[:, j]) ** 2
        share = 100 * float(squares[spikes].sum() / max(squares.sum(), TINY))
        text += f" They are {share:.2g} % of the squared difference from the expected torque."
    moved = _moved(j, spikes, given)
    if moved <= MATTERS:
        text += f" They move the values by {moved:.2g} standard deviations, all together."
        yield Diagnostic(FEW_OUTLIERS, text, place, moved, MATTERS, "1")
    else:
        yield Diagnostic(LOG_OUTLIERS, text, place, found.largest, found.bound)


def _lone(deviation: Array, spread: float) -> float:
    """From what a deviation (N,) of samples from their neighbours is no motion: half the range of the log, or less
    where hardly any sample comes near."""
    rank = min(1 + max(2, round(OTHERS * deviation.size)), deviation.size)
    others = float(np.sort(deviation)[-rank])
    return min(SPIKE * spread, max(ALONE * spread, BEYOND * others))


def _is_inside(count: int) -> NDArray[np.bool_]:
    """(N,) which samples have neighbours on both sides, and come after those in which a loop swings in."""
    places = np.arange(count)
    return np.asarray((places >= NEIGHBOURS) & (places < count - NEIGHBOURS))


def _moved(j: int, spikes: Indices, given: Expected) -> float:
    """Standard deviations by which outliers of joint ``j`` (from 0) move the base parameters, all together; infinite
    where these are not known.

        | Q' w x |    x what the outliers differ by, Q a basis of the weighted regressor, w = sqrt(f)/s

    with deviation s and independent part f of the residual along the reference, without the outliers.
    """
    if given.columns is None or given.fitted is None:
        return np.inf
    residual = given.measured - given.fitted
    wrong = np.zeros_like(residual)
    wrong[spikes, j] = (residual[:, j] - running_median(residual[:, j], NEIGHBOURS, outside=0.0))[spikes]
    residual = residual - wrong
    size = np.maximum(residual.std(axis=0), TINY)
    base = BaseProjection.of(given.columns, np.sqrt(effective_fraction(residual)) / size)
    return float(np.linalg.norm(base.basis.T @ base.weighted(wrong)))
