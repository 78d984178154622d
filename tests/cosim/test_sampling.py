"""Logged torque from the held command: points, averages, and instants of a slower log."""

from __future__ import annotations

import numpy as np
import pytest

from fmu_didim.base.errors import InputError
from fmu_didim.cosim import decimated_times, grid_places, sample_operator
from fmu_didim.cosim.sampling import JITTER, Kind, SampleOperator, Window

START, STEP, COUNT = 0.3, 0.005, 200
STAIRS = np.random.default_rng(1).normal(size=COUNT)
SHIFT = {"preceding": -1.0, "centred": -0.5, "following": 0.0}


def sampled(times: np.ndarray, **options: object) -> np.ndarray:
    operator = plain(times, **options)
    return operator.apply(STAIRS[operator.ticks])


def plain(times: np.ndarray, **options: object) -> SampleOperator:
    return sample_operator(times, start=START, step=STEP, tick_count=COUNT, **options)  # type: ignore[arg-type]


def mean_of_stairs(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Mean of the held values over [low, high], from their antiderivative."""
    edges = START + STEP * np.arange(COUNT + 1)
    area = np.concatenate([[0.0], np.cumsum(STAIRS) * STEP])
    low, high = np.clip(low, edges[0], edges[-1]), np.clip(high, edges[0], edges[-1])
    return (np.interp(high, edges, area) - np.interp(low, edges, area)) / (high - low)


@pytest.mark.parametrize("divisor", [1, 4, 10, 2.5, 3.7, np.pi])
@pytest.mark.parametrize("phase", [0.0, 0.4, 0.985])
def test_points_take_the_tick_that_acts(divisor: float, phase: float) -> None:
    position = phase + np.arange(int((COUNT - 1) / divisor)) * divisor
    operator = sample_operator(START + STEP * position, start=START, step=STEP, tick_count=COUNT)
    expected = np.array([int(p + JITTER) for p in position])
    np.testing.assert_array_equal(operator.apply(np.arange(COUNT)[operator.ticks]), expected)
    np.testing.assert_array_equal(operator.ticks, np.unique(expected))
    assert operator.count == position.size


def test_instants_with_few_digits_fall_on_their_tick() -> None:
    times = np.array([float(f"{START + k * STEP:.9g}") for k in range(COUNT)])
    operator = sample_operator(times - 4e-9, start=START, step=STEP, tick_count=COUNT)
    np.testing.assert_array_equal(operator.ticks, np.arange(COUNT))


@pytest.mark.parametrize(("position", "tick"), [(4.98, 4), (4.992, 5), (5.0, 5), (5.98, 5), (-0.008, 0)])
def test_stamps_a_little_early_belong_to_their_tick(position: float, tick: int) -> None:
    times = START + STEP * np.array([position])
    assert sample_operator(times, start=START, step=STEP, tick_count=COUNT).ticks.tolist() == [tick]


def test_points_of_one_tick_share_it() -> None:
    operator = sample_operator(START + STEP * np.array([3.0, 3.4, 3.8, 7.0]), start=START, step=STEP, tick_count=COUNT)
    assert operator.ticks.tolist() == [3, 7]
    assert operator.apply(np.array([10.0, 20.0])).tolist() == [10.0, 10.0, 10.0, 20.0]


@pytest.mark.parametrize("window", ["preceding", "centred", "following"])
@pytest.mark.parametrize("ratio", [1.0, 4.0, 3.7, 0.6])
@pytest.mark.parametrize("phase", [0.0, 0.35])
def test_averages_of_a_staircase_are_exact(window: Window, ratio: float, phase: float) -> None:
    times = START + STEP * (10 + phase + 5.3 * np.arange(30))
    length = ratio * STEP
    low = times + SHIFT[window] * length
    got = sampled(times, kind="average", window=window, window_s=length)
    np.testing.assert_allclose(got, mean_of_stairs(low, low + length), rtol=0, atol=1e-10)


def test_average_of_a_small_staircase_by_hand() -> None:
    operator = sample_operator(np.array([2.5]), start=0.0, step=1.0, tick_count=4, kind="average", window_s=2.0)
    weights = dict(zip(operator.ticks.tolist(), operator.matrix.toarray()[0].tolist(), strict=True))
    assert weights == pytest.approx({0: 0.25, 1: 0.5, 2: 0.25})


def test_the_window_is_the_spacing_unless_it_is_given() -> None:
    times = START + STEP * (8.0 + 4.0 * np.arange(20))
    expected = STAIRS[4:84].reshape(20, 4).mean(axis=1)
    np.testing.assert_allclose(sampled(times, kind="average"), expected, atol=1e-12)
    with pytest.raises(InputError, match="window_s"):
        sampled(times[:1], kind="average")
    kept = np.delete(np.arange(20), [5, 11, 12])  # samples that the logger has dropped make no window longer
    np.testing.assert_allclose(sampled(times[kept], kind="average"), expected[kept], atol=1e-12)


@pytest.mark.parametrize(
    ("steps", "places"),
    [
        ([1, 1, 1], [0, 1, 2, 3]),
        ([1, 2, 1, 3, 1], [0, 1, 3, 4, 7, 8]),
        ([1.2, 0.9, 1.0, 0.8, 2.1, 1.0], [0, 1, 2, 3, 4, 6, 7]),
        ([1, 0.3, 1, 1, 2], [0, 1, 2, 3, 4, 5]),
        ([], [0]),
    ],
)
def test_places_count_the_samples_that_are_missing(steps: list[float], places: list[int]) -> None:
    """Stamps may lie beside the grid; a log with much shorter steps has none."""
    times = 0.7 + 0.01 * np.concatenate([[0.0], np.cumsum(steps)])
    assert grid_places(times).tolist() == places


@pytest.mark.parametrize("window", ["preceding", "centred", "following"])
def test_windows_are_cut_at_both_ends_of_the_data(window: Window) -> None:
    times = START + STEP * np.array([1.5, COUNT - 1.5])
    length = 6 * STEP
    low = times + SHIFT[window] * length
    got = sampled(times, kind="average", window=window, window_s=length)
    np.testing.assert_allclose(got, mean_of_stairs(low, low + length), atol=1e-10)


def test_first_sample_without_a_window_takes_the_first_command() -> None:
    got = sampled(START + STEP * np.array([0.0, 4.0]), kind="average")
    np.testing.assert_allclose(got, [STAIRS[0], STAIRS[:4].mean()], atol=1e-12)


def test_the_last_window_may_end_with_the_last_command() -> None:
    got = sampled(START + STEP * np.array([COUNT - 4.0, float(COUNT)]), kind="average")
    np.testing.assert_allclose(got[1], STAIRS[-4:].mean(), atol=1e-12)


@pytest.mark.parametrize("kind", ["point", "average"])
def test_weights_sum_to_one(kind: Kind) -> None:
    times = START + STEP * np.linspace(0, COUNT - 0.2, 77)
    operator = sample_operator(times, start=START, step=STEP, tick_count=COUNT, kind=kind)
    np.testing.assert_allclose(operator.matrix.sum(axis=1), 1.0, rtol=1e-12)
    assert (operator.matrix.toarray() >= 0).all()


@pytest.mark.parametrize("kind", ["point", "average"])
def test_regressor_rows_are_sampled_like_each_column(kind: Kind) -> None:
    times = START + STEP * (5 + 3.3 * np.arange(40))
    operator = sample_operator(times, start=START, step=STEP, tick_count=COUNT, kind=kind)
    table = np.random.default_rng(2).normal(size=(operator.ticks.size, 2, 3))
    got = operator.apply(table)
    assert got.shape == (40, 2, 3)
    for j in range(2):
        for i in range(3):
            np.testing.assert_allclose(got[:, j, i], operator.apply(table[:, j, i]), rtol=1e-13)


@pytest.mark.parametrize(
    ("position", "kind"), [(-0.5, "point"), (-0.5, "average"), (COUNT, "point"), (COUNT + 5, "average")]
)
def test_instants_beyond_the_reference_are_refused(position: float, kind: Kind) -> None:
    times = START + STEP * np.array([max(position - 1, 0), 20.0, position])
    with pytest.raises(InputError, match=r"beyond the reference[\s\S]*t from 0\.3 s to 1\.3 s") as caught:
        sampled(times, kind=kind, window_s=STEP)
    assert f"t = {times[-1]:g} s" in str(caught.value) or position > COUNT


def test_the_first_instant_beyond_the_reference_is_told() -> None:
    times = START + STEP * np.array([5.0, COUNT + 3.0, COUNT + 7.0])
    with pytest.raises(InputError, match=rf"2 samples, the first one at t = {times[1]:g} s"):
        sampled(times)


def test_averages_just_beyond_the_reference_are_refused() -> None:
    with pytest.raises(InputError):
        sampled(START + STEP * np.array([COUNT - 4.0, COUNT + 0.9]), kind="average")


def test_operator_counts_rows() -> None:
    operator = sample_operator(np.array([0.0, 0.1, 0.2]), start=0.0, step=0.1, tick_count=3)
    assert isinstance(operator, SampleOperator)
    assert operator.count == 3


# ---- a log whose clock is late or early ------------------------------------------------------------


LATE_S = 3.4 * STEP


@pytest.mark.parametrize("lag_s", [LATE_S, -LATE_S, 0.2 * STEP, 7 * STEP])
def test_late_points_lie_on_straight_lines_between_ticks(lag_s: float) -> None:
    """On stamps between ticks, too; the ends of the command go on."""
    times = START + STEP * np.sort(np.random.default_rng(5).uniform(0, COUNT - 0.1, 90))
    operator = plain(times).stamped_later(lag_s / STEP, COUNT)
    wanted = np.interp(times - lag_s, START + STEP * np.arange(COUNT), STAIRS)
    np.testing.assert_allclose(operator.apply(STAIRS[operator.ticks]), wanted, atol=1e-11)
    np.testing.assert_allclose(operator.matrix.sum(axis=1), 1.0, rtol=1e-12)


@pytest.mark.parametrize("lag_s", [LATE_S, -LATE_S])
@pytest.mark.parametrize("window", ["preceding", "following"])
def test_windows_of_a_late_log_lie_earlier(lag_s: float, window: Window) -> None:
    times = START + STEP * np.arange(20, 180, 4)
    operator = plain(times, kind="average", window=window).stamped_later(lag_s / STEP, COUNT)
    low = times - lag_s + SHIFT[window] * 4 * STEP
    np.testing.assert_allclose(operator.apply(STAIRS[operator.ticks]), mean_of_stairs(low, low + 4 * STEP), atol=1e-11)


@pytest.mark.parametrize("kind", ["point", "average"])
def test_lags_add_up_and_none_holds_the_command_again(kind: Kind) -> None:
    operator = plain(START + STEP * (8.3 + 4.0 * np.arange(40)), kind=kind)
    assert operator.stamped_later(0.0, COUNT) is operator
    once, twice = operator.stamped_later(3.4, COUNT), operator.stamped_later(5.0, COUNT).stamped_later(-1.6, COUNT)
    np.testing.assert_allclose(twice.apply(STAIRS[twice.ticks]), once.apply(STAIRS[once.ticks]), atol=1e-12)
    assert twice.lag == pytest.approx(3.4)
    assert once.stamped_later(-once.lag, COUNT) is operator


@pytest.mark.parametrize("kind", ["point", "average"])
@pytest.mark.parametrize("order", ["cut first", "shifted first"])
def test_a_log_may_be_cut_and_shifted_in_any_order(kind: Kind, order: str) -> None:
    operator = plain(START + STEP * (8.3 + 4.0 * np.arange(40)), kind=kind)
    whole = operator.stamped_later(3.4, COUNT)
    later = operator.after(7).stamped_later(3.4, COUNT) if order == "cut first" else whole.after(7)
    again = later.stamped_later(1.0, COUNT).stamped_later(-1.0, COUNT)
    for cut in (later, again):
        wanted = whole.apply(STAIRS[whole.ticks])[7:]
        np.testing.assert_allclose(cut.apply(STAIRS[cut.ticks]), wanted, atol=1e-12)


@pytest.mark.parametrize("kind", ["point", "average"])
@pytest.mark.parametrize("lag", [0.0, 3.4])
def test_one_sample_in_so_many_needs_its_own_ticks_alone(kind: Kind, lag: float) -> None:
    whole = plain(START + STEP * (8.3 + 4.0 * np.arange(40)), kind=kind).stamped_later(lag, COUNT)
    some = whole.every(8)
    np.testing.assert_allclose(some.apply(STAIRS[some.ticks]), whole.apply(STAIRS[whole.ticks])[::8], atol=1e-12)
    assert set(some.ticks) <= set(whole.ticks)
    assert some.ticks.size < whole.ticks.size / 4
    assert (np.diff(some.ticks) > 0).all()
    later, also = (operator.stamped_later(1.5, COUNT) for operator in (some, whole))
    np.testing.assert_allclose(later.apply(STAIRS[later.ticks]), also.apply(STAIRS[also.ticks])[::8], atol=1e-12)


@pytest.mark.parametrize("kind", ["point", "average"])
def test_samples_are_continuous_in_the_lag(kind: Kind) -> None:
    operator = plain(START + STEP * (8.0 + 4.0 * np.arange(40)), kind=kind)

    def at(lag: float) -> np.ndarray:
        later = operator.stamped_later(lag, COUNT)
        return later.apply(STAIRS[later.ticks])

    for lag in (-3.0, 0.0, 0.5, 2.0):
        assert np.abs(at(lag + 1e-9) - at(lag - 1e-9)).max() < 1e-7


# ---- a slower log ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("rate", "phase", "count", "last"),
    [(100.0, 0.0, 101, 1.3), (20.0, 0.0, 21, 1.3), (30.0, 0.0, 31, 1.3), (70.0, 0.01, 70, 0.31 + 69 / 70)],
)
def test_decimated_times(rate: float, phase: float, count: int, last: float) -> None:
    log = START + STEP * np.arange(COUNT + 1)
    got = decimated_times(log, rate, phase)
    assert got.size == count
    np.testing.assert_allclose(np.diff(got), 1 / rate, rtol=1e-9)
    assert got[0] == pytest.approx(START + phase, abs=1e-12)
    assert got[-1] == pytest.approx(last, abs=1e-9)


def test_decimated_times_do_not_drift() -> None:
    log = np.arange(200_001) * 0.005
    got = decimated_times(log, 30.0)
    np.testing.assert_array_equal(got, np.arange(got.size) * (1 / 30.0))


@pytest.mark.parametrize("rate", [0.0, -5.0, float("nan")])
def test_rates_that_are_not_positive_are_refused(rate: float) -> None:
    with pytest.raises(InputError, match="must be positive"):
        decimated_times(np.arange(10.0), rate)


def test_a_phase_beyond_the_log_is_refused() -> None:
    with pytest.raises(InputError, match="No sample of that rate"):
        decimated_times(np.arange(10.0), 1.0, phase_s=20.0)


def test_a_negative_phase_is_refused() -> None:
    with pytest.raises(InputError, match="must not be negative"):
        decimated_times(np.arange(10.0), 1.0, phase_s=-3.0)


def test_a_rate_beyond_all_logs_is_refused() -> None:
    with pytest.raises(InputError, match="fewer samples than that"):
        decimated_times(np.arange(10.0), 1e12)


@pytest.mark.parametrize("window", ["preceding", "centred", "following"])
@pytest.mark.parametrize("window_s", [0.05, 0.0511])
def test_averages_by_some_of_the_ticks(window: Window, window_s: float) -> None:
    """They are exact for straight lines, also over logs with gaps, and near for smooth signals; few ticks are left."""
    step, count = 0.0002, 5000
    times = np.delete(0.06 * np.arange(1, 15), [4, 5])
    whole = sample_operator(
        times, start=0.0, step=step, tick_count=count, kind="average", window=window, window_s=window_s
    )
    few = whole.thinned(10)
    assert few.ticks.size < 0.13 * whole.ticks.size
    at = step * np.arange(count)
    np.testing.assert_allclose(few.apply(1 + at[few.ticks]), whole.apply(1 + at[whole.ticks]), rtol=1e-13)
    swing = np.sin(2 * np.pi * 3 * at)
    np.testing.assert_allclose(few.apply(swing[few.ticks]), whole.apply(swing[whole.ticks]), atol=1e-3)
    assert whole.thinned(whole.ticks.size) is whole
    points = plain(START + STEP * np.arange(10))
    assert points.thinned(1) is points
