"""A part of long logs, in stretches from their whole length, as logs of their own.

What looks at the shape of a residual costs much more a sample than a simulation does, and a tenth of a million samples
shows all but the smallest misfits. The stretches of a log stand one behind the other, with a clock of their own. Where
the motion repeats they are whole periods and join without a seam; elsewhere the reference goes from the end of one to
the beginning of the next along a polynomial of fifth degree, and the loop follows the next one for a while, before
samples count again.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray
from scipy import sparse

from fmu_didim.cosim import Indices, SampleOperator
from fmu_didim.data.signals import Array, Trajectory
from fmu_didim.model.experiment import Experiment
from fmu_didim.model.loop_model import LoopModel

LONG = 60_000
"""[samples] Of a log, from which a part of it is judged: whole, such a log takes ten seconds and more."""
PART = 24_000
"""[samples] Of such a log that are judged, about."""
STRETCHES = 6
"""[stretches] Of a log, so that each tenth of it or so has a part in them."""
AFTER_SEAM = 0.2
"""[1] Of a stretch, that the loop follows before samples count, where the motion does not repeat."""
REPEATS_WITHIN = 1e-6
"""[1] Of the range of a column, within which a motion repeats: rounding of a file."""
ROUNDING_S = 1e-9
"""[s] Of stamps, beside the ends of a stretch."""
FEWEST_PERIODS = 2
"""[periods] In all stretches, of a motion that counts as one that repeats."""
FEWEST = 0.7
"""[1] Of the samples that are to be judged, that the stretches have at least: of a log that covers its reference."""
SPEED, ACCELERATION = 2.0, 6.0
"""[1] Largest speed and acceleration of a polynomial of fifth degree from rest to rest, of distance over time and its
square: 1.875 and 5.77."""
CLOSE = 0.75
"""[1] Of the usual spacing of samples, below which the first one behind a seam does not count: the others have a
grid."""


@dataclass(frozen=True)
class PartOfLogs:
    """The part of a model's logs that is judged.

    Attributes:
        model: with that part as its logs.
        rows: label -> (N,) rows of the whole log, of those that are longer; spans: label -> (k, 2) s, where its
            stretches begin and end.
    """

    model: LoopModel
    rows: Mapping[str, Indices]
    spans: Mapping[str, Array]


def part_of_logs(model: LoopModel) -> PartOfLogs | None:
    """The part of a model whose logs are long; None where none is, or where a part is no log of its own: logs without
    signs, with further signals beside the torque or pushes from outside, filtered ones, a period of the control that
    changes, outliers that are to be left out."""
    experiments = model.experiments
    long = [label for label, experiment in experiments.items() if experiment.time.size > LONG]
    if not long or not model.loop.shows_torque or model.loop.torque_is_given or model.loop.subdivision > 1:
        return None
    if experiments.low_pass is not None or not all(_is_plain(experiment) for experiment in experiments.values()):
        return None
    rows, spans, part = dict[str, Indices](), dict[str, Array](), model
    for label in long:
        found = _shortened(experiments[label], _motion_period(experiments[label].reference))
        if found is None:
            return None
        own, rows[label], spans[label] = found
        part = part.with_experiment(label, own)
    return PartOfLogs(part, rows, spans)


def _is_plain(experiment: Experiment) -> bool:
    operator = experiment.operator
    return (
        not (experiment.channels or experiment.external_torques or experiment.errors)
        and experiment.scale is None and experiment.recorded is None and operator.instants is None
        and operator.origin is None and not experiment.is_unsigned and not experiment.leaves_out_outliers
    )  # fmt: skip


def _motion_period(reference: Trajectory) -> int | None:
    """Ticks after which the whole reference repeats; None where it does not, or so late that it does not matter."""
    from fmu_didim.data.spectrum import lagged_products

    values = reference.values[:, np.ptp(reference.values, axis=0) > 0]
    begin = values[:LONG]
    if not values.shape[1]:
        return None
    scaled = (begin - begin.mean(axis=0)) / np.ptp(values, axis=0)
    lags = np.arange(1, PART)
    products = np.sum([lagged_products(v, v, np.arange(len(begin))) for v in scaled.T], axis=0)
    squares = np.concatenate([[0.0], np.cumsum((scaled**2).sum(axis=1))])
    both = squares[len(begin) - lags] + squares[-1] - squares[lags]
    near = lags[(both - 2 * products[lags]) / (len(begin) - lags) < REPEATS_WITHIN]
    size = REPEATS_WITHIN * np.ptp(values, axis=0)
    return next((int(lag) for lag in near if (np.abs(values[lag:] - values[:-lag]) < size).all()), None)


@dataclass(frozen=True)
class _Stretch:
    """Ticks of a run: the loop is on its motion from ``begin`` on, and samples count from ``counted`` to ``end``; where
    ``begin`` comes after a seam of so many ticks."""

    begin: int
    counted: int
    end: int
    seam: int = 0


def _shortened(experiment: Experiment, period: int | None) -> tuple[Experiment, Indices, Array] | None:
    """The experiment of a part of its samples, their rows, and where the stretches lie, s; None where it has none."""
    reference, step = experiment.reference, experiment.reference.step
    first, last = _support(experiment.operator)
    count = int(last.max()) + 1
    ticks = math.ceil(PART * (count - int(first.min())) / experiment.time.size)
    if ticks < STRETCHES:
        return None
    if period is not None and ticks >= FEWEST_PERIODS * period:
        stretches = _whole_periods(count, ticks, period)
    else:
        stretches = _anywhere(reference, count, ticks // STRETCHES)
    kept, moved = list[Indices](), list[NDArray[np.int64]]()
    values, place, ends = list[Array](), 0, float(-np.inf)
    later = list[int]()
    for stretch in stretches:
        if stretch.seam:
            values.append(_seam(reference, values[-1], stretch, step))
            place += stretch.seam
        own = np.flatnonzero((first >= stretch.counted) & (last < stretch.end))
        shift = place - stretch.begin
        usual = float(np.median(np.diff(experiment.time[own]))) if own.size > 1 else 0.0
        if own.size and experiment.time[own[0]] + shift * step - ends < CLOSE * usual:
            own = own[1:]
        kept.append(own)
        moved.append(np.full(own.size, shift))
        if own.size:
            ends = float(experiment.time[own[-1]]) + shift * step
        values.append(reference.values[stretch.begin : stretch.end])
        place += stretch.end - stretch.begin
        later.append(shift)
    rows, shifts = np.concatenate(kept), np.concatenate(moved)
    if rows.size < FEWEST * PART:
        return None
    time = reference.time[0] + step * np.arange(place)
    short = Trajectory(time, np.concatenate(values), reference.variables, reference.source)
    at = experiment.time[rows] + shifts * step
    spans = np.array([[reference.time[s.counted], reference.time[s.end - 1] + step] for s in stretches])
    result = replace(
        experiment, reference=short, time=at, torque=experiment.torque[rows],
        operator=_moved(experiment.operator, rows, shifts, place), stamps=at,
        positions=_cut(experiment.positions, spans, step * np.array(later)),
    )  # fmt: skip
    return result, rows, spans


def _cut(positions: Trajectory | None, spans: Array, later: Array) -> Trajectory | None:
    """Measured positions in stretches (k, 2) s, so much later (k,)."""
    if positions is None:
        return None
    own = [
        np.flatnonzero((positions.time > begin - ROUNDING_S) & (positions.time < end - ROUNDING_S))
        for begin, end in spans
    ]
    time = np.concatenate([positions.time[rows] + shift for rows, shift in zip(own, later, strict=True)])
    return replace(positions, time=time, values=positions.values[np.concatenate(own)])


def _whole_periods(count: int, ticks: int, period: int) -> list[_Stretch]:
    """Stretches of whole periods, about so many ticks in all, evenly from the first ``count``."""
    wanted, there = ticks // period, count // period
    stretches = min(STRETCHES, wanted)
    length = wanted // stretches
    begins = np.unique(np.rint(np.linspace(0, there - length, stretches)).astype(int)) * period
    return [_Stretch(int(b), int(b), int(b) + length * period) for b in begins]


def _anywhere(reference: Trajectory, count: int, length: int) -> list[_Stretch]:
    """Stretches of ``length`` ticks that count, evenly from the first ``count``, with what lies before them."""
    before = math.ceil(AFTER_SEAM * length)
    begins = np.linspace(0, count - length - before, STRETCHES).astype(int)
    found = [_Stretch(0, 0, length)]
    for begin in begins[1:]:
        seam = _ticks_between(reference, found[-1].end - 1, int(begin))
        found.append(_Stretch(int(begin), int(begin) + before, int(begin) + before + length, seam))
    return found


def _ticks_between(reference: Trajectory, end: int, begin: int) -> int:
    """Ticks of a seam in which no joint is faster, or accelerates more, than somewhere in the reference."""
    step, needed = reference.step, 1.0
    for name in reference.names:
        if not name.startswith("q"):
            continue
        q = reference.column(name)
        speed = np.gradient(q, step)
        fastest, most = float(np.abs(speed).max()), float(np.abs(np.diff(speed)).max()) / step
        distance, turn = abs(q[begin] - q[end]), abs(speed[begin]) + abs(speed[end])
        if fastest > 0 and most > 0:
            needed = max(needed, SPEED * distance / fastest / step, math.sqrt(ACCELERATION * distance / most) / step,
                         SPEED * turn / most / step)  # fmt: skip
    return math.ceil(needed)


def _seam(reference: Trajectory, before: Array, stretch: _Stretch, step: float) -> Array:
    """(seam, m) rows between the last one of those before (N, m), and the first of a stretch: positions, speeds and
    accelerations of polynomials of fifth degree, other columns along straight lines."""
    index = {name: i for i, name in enumerate(reference.names)}
    after = reference.values[stretch.begin : stretch.begin + 3]
    share = np.arange(1, stretch.seam + 1)[:, None] / (stretch.seam + 1)
    rows: Array = before[-1] + share * (after[0] - before[-1])
    duration = (stretch.seam + 1) * step
    for name, i in index.items():
        if not name.startswith("q"):
            continue
        speed, acceleration = index.get(f"d{name}"), index.get(f"dd{name}")
        ends = []
        for part, at in ((before[-3:], -1), (after, 0)):
            slope = np.gradient(part[:, i], step)
            ends += [part[at, i], slope[at] if speed is None else part[at, speed]]
            ends += [np.gradient(slope, step)[at] if acceleration is None else part[at, acceleration]]
        polynomial, along = _fifth(np.array(ends), duration), share[:, 0] * duration
        for order, column in enumerate((i, speed, acceleration)):
            if column is not None:
                rows[:, column] = polynomial.deriv(order)(along)
    return rows


def _fifth(ends: Array, duration: float) -> Polynomial:
    """The polynomial with these values, slopes and curvatures (6,) at 0 and at a duration."""
    powers = np.arange(6)
    table = np.zeros((6, 6))
    for row, (at, order) in enumerate((a, k) for a in (0.0, duration) for k in range(3)):
        factors = np.array([math.perm(int(n), order) for n in powers], dtype=float)
        table[row] = factors * np.power(at, np.maximum(powers - order, 0))
    return Polynomial(np.asarray(np.linalg.solve(table, ends)))


def _support(operator: SampleOperator) -> tuple[Indices, Indices]:
    """(N,) first and last tick that each sample needs."""
    matrix = operator.matrix
    if (np.diff(matrix.indptr) == 1).all():
        ticks = operator.ticks[matrix.indices]
        return ticks, ticks
    ticks = operator.ticks[matrix.indices]
    begins = matrix.indptr[:-1]
    return np.minimum.reduceat(ticks, begins), np.maximum.reduceat(ticks, begins)


def _moved(operator: SampleOperator, rows: Indices, shifts: NDArray[np.int64], count: int) -> SampleOperator:
    """The operator of some samples, whose ticks come so much later."""
    matrix = sparse.csr_array(operator.matrix[rows])
    own = operator.ticks[matrix.indices] + np.repeat(shifts, np.diff(matrix.indptr))
    ticks, places = np.unique(own, return_inverse=True)
    positions = None if operator.positions is None else operator.positions[rows] + shifts
    weights = sparse.csr_array((matrix.data, places, matrix.indptr), shape=(rows.size, ticks.size))
    return SampleOperator(ticks.astype(np.int64), weights, positions, cutoff_hz=operator.cutoff_hz)


def whole_logs(model: LoopModel, whole: LoopModel) -> LoopModel:
    """A model of a part of the logs, as a fit has left it, with the whole ones."""
    for label, experiment in whole.experiments.items():
        own = replace(
            model.experiments[label], reference=experiment.reference, time=experiment.time, torque=experiment.torque,
            operator=experiment.operator, stamps=experiment.stamps, positions=experiment.positions,
        )  # fmt: skip
        model = model.with_experiment(label, own)
    return model
