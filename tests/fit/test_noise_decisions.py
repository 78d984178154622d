"""What counts as noise and as a period, on logs made by hand."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fmu_didim.cosim import sample_operator
from fmu_didim.data.signals import Array, Trajectory, trajectory
from fmu_didim.fit.derivatives.repetition import repetition
from fmu_didim.fit.noise.noise import (
    Noise,
    effective_fraction,
    motion_frequency,
    noise_from_periods,
    noise_from_residual,
    period_in_ticks,
    pooled,
)
from tests.discovery.by_hand import noise


def signs(count: int, length: int = 1) -> Array:
    """1 and -1 in turn, each so many samples long."""
    return np.where(np.arange(count) // length % 2 == 0, 1.0, -1.0)


def reference(values: Array, step: float = 0.01) -> Trajectory:
    return trajectory(step * np.arange(values.size), {"q1": values})


def periodic(period: int, count: int, off: float = 0.0) -> Trajectory:
    """A motion of range one that repeats, but for one sample that is off."""
    values = np.tile(np.linspace(0, 1, period) ** 2, 50)[:count].copy()
    values[count - 1] += off
    return reference(values)


# ---- periods


@pytest.mark.parametrize(
    ("period", "count", "off", "found"),
    [
        (40, 200, 0.0, 40),
        (10, 200, 0.0, 10),
        (9, 200, 0.0, 18),  # a period of nine ticks would be one of the control
        (40, 200, 0.9e-6, 40),
        (40, 200, 1.1e-6, None),
        # A quarter must be there twice.
        (149, 200, 0.0, 149),
        (150, 200, 0.0, None),
    ],
)
def test_the_period_of_a_reference(period: int, count: int, off: float, found: int | None) -> None:
    assert period_in_ticks(periodic(period, count, off)) == found


def test_differences_count_relative_to_the_range_of_each_column() -> None:
    small = 1e3 * np.tile(np.linspace(0, 1, 40) ** 2, 5)
    small[-1] += 0.9e-3
    assert period_in_ticks(reference(small)) == 40
    both = trajectory(0.01 * np.arange(200), {"q1": small, "still": np.ones(200)})
    assert period_in_ticks(both) == 40
    assert period_in_ticks(reference(np.ones(200))) is None


# ---- noise from periods


def log(difference: Array, samples: int, periods: int = 2) -> Array:
    """A log whose periods differ by this, in units of a standard deviation: sqrt(2) times it between two."""
    base = np.sin(np.linspace(0, 6, samples))
    return np.concatenate([base, *(base + k * np.sqrt(2) * difference for k in range(1, periods))])[:, None]


def test_white_noise_by_hand() -> None:
    found = noise_from_periods(log(3.0 * signs(200), 200), 200, rate_hz=100.0, skip=0)
    assert found is not None
    assert found.deviation.tolist() == [pytest.approx(3.0 * np.sqrt(200 / 199), rel=1e-3)]
    assert found.correlation.tolist() == [0.0]  # that of neighbours is negative
    assert (found.source, found.period_s) == ("periods", None)


def test_correlations_of_neighbours_and_of_slow_samples() -> None:
    found = noise_from_periods(log(signs(200, 10), 200), 200, rate_hz=100.0, skip=0)
    assert found is not None
    assert found.correlation.tolist() == [pytest.approx(1 - 2 / 10, abs=0.02)]
    assert found.slow is not None and found.slow.tolist() == [pytest.approx(0.0, abs=0.03)]  # 5 samples of ten
    slower = noise_from_periods(log(signs(200, 10), 200), 200, rate_hz=40.0, skip=0)
    assert slower is not None and slower.slow is not None
    assert slower.slow.tolist() == [pytest.approx(0.6, abs=0.03)]  # 2 samples of ten
    fast = noise_from_periods(log(signs(200, 10), 200), 200, rate_hz=1.0, skip=0)
    assert fast is not None and fast.slow is not None and fast.slow.tolist() == fast.correlation.tolist()


def test_the_correlation_that_is_believed() -> None:
    found = noise_from_periods(log(signs(2000, 500), 2000), 2000, rate_hz=100.0, skip=0)
    assert found is not None and found.correlation.tolist() == [0.98]


@pytest.mark.parametrize(
    ("count", "skip", "there"),
    [(300, 0, True), (299, 0, False), (300, 1, False), (400, 100, True), (400, 101, False)],
)
def test_half_a_period_must_be_there_twice(count: int, skip: int, there: bool) -> None:
    found = noise_from_periods(log(signs(200), 200)[:count], 200, rate_hz=100.0, skip=skip)
    assert (found is not None) is there


@pytest.mark.parametrize(("samples", "there"), [(30, True), (29, False)])
def test_thirty_differences_must_be_there(samples: int, there: bool) -> None:
    found = noise_from_periods(log(signs(samples), samples), samples, rate_hz=100.0, skip=0)
    assert (found is not None) is there


def test_whole_periods_are_counted() -> None:
    found = noise_from_periods(log(signs(100), 100, periods=4)[:399], 100, rate_hz=100.0, skip=10)
    assert found is not None and found.periods == 4


def test_a_log_that_repeats_exactly_has_the_smallest_noise() -> None:
    found = noise_from_periods(np.tile([[2.0], [-2.0]], (100, 1)), 100, rate_hz=100.0, skip=0)
    assert found is not None and found.deviation.tolist() == [pytest.approx(2e-9)]


@pytest.mark.parametrize(("size", "counts"), [(2.4, True), (2.6, False)])
def test_a_block_of_six_times_the_power_is_no_noise(size: float, counts: bool) -> None:
    """A block of 20 of 400 samples, of the power of 1 but for one that has size^2; the mean takes nothing of it."""
    difference = signs(400)
    difference[100:120] *= size
    found = noise_from_periods(log(difference, 400), 400, rate_hz=100.0, skip=0)
    wanted = np.sqrt((380 + 20 * size**2) / 399) if counts else np.sqrt(380 / 379)
    assert found is not None and found.deviation.tolist() == [pytest.approx(wanted, rel=1e-3)]


@pytest.mark.parametrize(("loud", "counts"), [(7, False), (9, True)])
def test_unless_they_are_the_rule(loud: int, counts: bool) -> None:
    difference = signs(400)
    difference[: 20 * loud] *= 10.0
    found = noise_from_periods(log(difference, 400), 400, rate_hz=100.0, skip=0)
    wanted = np.sqrt((400 - 20 * loud + 2000 * loud) / 400) if counts else 1.0
    assert found is not None and found.deviation.tolist() == [pytest.approx(wanted, rel=2e-2)]


def test_samples_that_are_missing_are_left_out() -> None:
    table = log(signs(400), 400)
    table[10:12] = np.nan
    table[500:510] = np.nan
    found = noise_from_periods(table, 400, rate_hz=100.0, skip=0)
    assert found is not None and found.deviation.tolist() == [pytest.approx(np.sqrt(388 / 387), rel=1e-3)]


def test_slow_changes_along_given_columns_are_no_noise() -> None:
    along = np.linspace(-1, 1, 400)
    table = log(0.1 * signs(400) + 5.0 * along, 400)
    columns = np.tile(np.column_stack([along, np.zeros(400)]), (2, 1))[:, None, :]
    found = noise_from_periods(table, 400, rate_hz=100.0, skip=0, regressors=columns)
    assert found is not None and found.deviation.tolist() == [pytest.approx(0.1, rel=1e-2)]
    assert noise_from_periods(table, 400, rate_hz=100.0, skip=0).deviation[0] > 2.0


# ---- several logs, colours, frequencies


def test_logs_are_pooled_by_their_samples() -> None:
    one, other = noise([1.0], correlation=0.2, period_s=3.0), noise([3.0], correlation=0.6)
    found = pooled([replace(one, samples=300), replace(other, samples=100)])
    assert found.deviation.tolist() == [pytest.approx(np.sqrt((3 * 1 + 9) / 4))]
    assert found.correlation.tolist() == [pytest.approx(0.3)]
    assert (found.period_s, found.periods, found.samples, found.slow) == (3.0, 2, 400, None)
    assert pooled([one]) is one
    slow = [
        Noise(np.ones(1), np.zeros(1), "periods", samples=count, slow=np.array([v]))
        for count, v in ((100, 0.1), (300, 0.5))
    ]
    assert pooled(slow).slow.tolist() == [pytest.approx(0.4)]
    assert pooled([slow[0], one]).slow is None


def test_weights_of_noise() -> None:
    found = noise([2.0], correlation=0.6)
    assert found.factor.tolist() == [pytest.approx(0.25)] and found.weight.tolist() == [pytest.approx(0.25)]


@pytest.mark.parametrize(("length", "wanted"), [(1, 1.0), (2, None), (10, None), (1000, 0.02 / 1.98)])
def test_the_part_of_the_samples_that_counts(length: int, wanted: float | None) -> None:
    values = signs(2000, length)
    rho = min(float(np.sum(values[1:] * values[:-1]) / 2000), 0.98)
    expected = (1 - rho) / (1 + rho) if wanted is None else wanted
    assert effective_fraction(5.0 + values[:, None]).tolist() == [pytest.approx(expected, rel=1e-9)]


def test_noise_of_a_residual_above_the_motion() -> None:
    rng = np.random.default_rng(4)
    slow = 30.0 * np.sin(2 * np.pi * 0.5 * 0.01 * np.arange(6000))
    found = noise_from_residual((slow + 2.0 * rng.normal(size=6000))[:, None], rate_hz=100.0, motion_hz=1.0)
    assert found.deviation.tolist() == [pytest.approx(2.0, rel=0.1)]
    assert abs(found.correlation[0]) < 0.2 and found.source == "residual"


def test_the_frequency_of_a_motion() -> None:
    time = 0.01 * np.arange(2000)
    slow, fast = np.sin(2 * np.pi * 1.0 * time), np.cos(2 * np.pi * 4.0 * time)
    both = trajectory(time, {"q1": slow, "q2": slow, "dq2": fast})
    assert motion_frequency(both, 1) == pytest.approx(1.0, abs=0.1)
    assert motion_frequency(both, 2) == pytest.approx(4.0, abs=0.1)


# ---- a simulated log that repeats


def experiment(period: int, count: int) -> tuple[Any, Any]:
    motion = periodic(period, count)
    times = motion.time
    operator = sample_operator(times, start=0.0, step=0.01, tick_count=count)
    return SimpleNamespace(reference=motion, rate_hz=100.0), operator


@pytest.mark.parametrize(
    ("count", "late", "size", "settled"),
    [
        # A tenth of a period later than the torque: slopes take longer to forget the start.
        (400, 0, 0.0, 10),
        (400, 30, 2e-5, 41),  # the first 31 samples differ by more than 1e-5 of the torque
        (400, 30, 0.9e-5, 10),
        (149, 0, 0.0, None),  # not one and a half periods
        (150, 0, 0.0, 10),
        # Settled sample, a period and a tenth of it within 80 % of the log.
        (400, 199, 1.0, 210),
        (400, 200, 1.0, None),
    ],
)
def test_from_when_on_a_torque_repeats(count: int, late: int, size: float, settled: int | None) -> None:
    one, operator = experiment(100, count)
    torque = np.tile(signs(100), 4)[:count, None].copy()
    torque[: late + 1] += size if late else 0.0
    found = repetition(one, operator, 0.01, torque)
    assert (None if found is None else found.settled) == settled
    if found is not None:
        assert (found.period, found.count) == (100, count)
        assert found.operator.count == found.settled + 110


def test_a_period_between_samples_is_not_continued() -> None:
    one, operator = experiment(100, 400)
    torque = np.tile(signs(100), 4)[:, None]
    for rate, there in ((100.0, True), (100.0 * (1 + 0.9e-8), True), (100.0 * (1 + 1.1e-8), False)):
        one.rate_hz = rate
        assert (repetition(one, operator, 0.01, torque) is not None) is there
    assert (
        repetition(SimpleNamespace(reference=reference(np.linspace(0, 1, 400)), rate_hz=100.0), operator, 0.01, torque)
        is None
    )


@pytest.mark.parametrize(("off", "continued"), [(0.99e-3, True), (1.01e-3, False)])
def test_columns_are_continued_where_the_overlap_repeats(off: float, continued: bool) -> None:
    one, operator = experiment(100, 400)
    found = repetition(one, operator, 0.01, np.tile(signs(100), 4)[:, None])
    assert found is not None
    column = np.sin(np.arange(100) / 7)
    column /= np.sqrt(np.mean(column**2))
    first = np.concatenate([column, column[:20]])[:, None]
    first[115] += off * np.sqrt(np.mean(first**2))
    result = found.continued(first)
    assert (result is not None) is continued
    if result is not None:
        np.testing.assert_allclose(result[:, 0], np.tile(column, 4), atol=0)
