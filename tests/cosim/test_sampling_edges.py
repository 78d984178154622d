"""The edges of sampling: stamps a little early or late, windows at both ends, shifted operators that are cut."""

from __future__ import annotations

import numpy as np
import pytest

from fmu_didim.base.errors import InputError
from fmu_didim.cosim.instants import Instants
from fmu_didim.cosim.sampling import Kind, SampleOperator, Window, decimated_times, grid_places, sample_operator

STAIRS = np.cos(np.arange(8.0))


def operator(
    *times: float, kind: Kind = "point", window: Window = "preceding", window_s: float | None = 1.0
) -> SampleOperator:
    """Of eight ticks a second apart, from zero on."""
    return sample_operator(
        np.array(times), start=0.0, step=1.0, tick_count=8, kind=kind, window=window, window_s=window_s
    )  # fmt: skip


@pytest.mark.parametrize(
    ("time", "kind", "accepted"),
    [
        (-0.01, "point", True),
        (-0.0101, "point", False),
        (7.9899, "point", True),
        (8 - 0.01, "point", False),
        (-0.01, "average", True),
        (-0.0101, "average", False),
        (8.0099, "average", True),
        (8 + 0.01, "average", False),
    ],
)
def test_a_hundredth_of_a_period_is_rounding(time: float, kind: Kind, accepted: bool) -> None:
    if accepted:
        assert operator(3.0, time, kind=kind).count == 2
        return
    with pytest.raises(InputError, match=r"1 samples, the first one at t = [-0-9.]+ s[\s\S]*t from 0 s to 8 s"):
        operator(3.0, time, kind=kind)


@pytest.mark.parametrize(("time", "tick"), [(2.9899, 2), (2.9901, 3), (3.0, 3), (3.98, 3), (-0.005, 0)])
def test_a_point_takes_the_tick_that_begins_within_a_hundredth(time: float, tick: int) -> None:
    found = operator(time)
    assert found.ticks.tolist() == [tick]
    assert found.positions is not None and found.positions.tolist() == [time]


@pytest.mark.parametrize(
    ("window", "time", "length", "ticks", "weights"),
    [
        ("preceding", 3.0, 2.0, [1, 2], [0.5, 0.5]),
        ("centred", 3.0, 2.0, [2, 3], [0.5, 0.5]),
        ("following", 3.0, 2.0, [3, 4], [0.5, 0.5]),
        ("preceding", 3.5, 2.0, [1, 2, 3], [0.25, 0.5, 0.25]),
        ("following", 3.5, 0.25, [3], [1.0]),
        ("preceding", 3.25, 0.25, [3], [1.0]),
        ("centred", 0.0, 3.0, [0, 1], [2 / 3, 1 / 3]),  # cut where the data begin
        ("centred", 8.0, 3.0, [6, 7], [1 / 3, 2 / 3]),
        ("preceding", 0.0, 2.0, [0], [1.0]),  # nothing before the first sample
        ("following", 8.0, 2.0, [7], [1.0]),
        ("preceding", 1e-7, 2.0, [0], [1.0]),
        ("preceding", 3.0 + 0.95e-9, 2.0, [1, 2], [0.5, 0.5]),  # clocks are rounded
        ("following", 3.0 - 0.95e-9, 2.0, [3, 4], [0.5, 0.5]),
        ("preceding", 3.0 + 1.05e-9, 2.0, [1, 2, 3], [0.5, 0.5, 0.0]),
        ("following", 3.0 - 1.05e-9, 2.0, [2, 3, 4], [0.0, 0.5, 0.5]),
        ("preceding", 2e-6, 2.0, [0], [1.0]),
        ("preceding", 3.0, 1.05e-6, [2], [1.0]),
        ("preceding", 3.0, 0.95e-6, [3], [1.0]),  # hardly a window: the command that acts there
    ],
)
def test_weights_of_a_window(
    window: Window, time: float, length: float, ticks: list[int], weights: list[float]
) -> None:
    found = operator(time, kind="average", window=window, window_s=length)
    assert found.ticks.tolist() == ticks
    np.testing.assert_allclose(found.matrix.toarray()[0], weights, rtol=1e-6, atol=1e-8)
    assert found.positions is None


def test_the_usual_spacing_is_the_length_of_a_window() -> None:
    found = operator(2.0, 4.0, kind="average", window_s=None)
    assert found.matrix.toarray().tolist() == [[0.5, 0.5, 0.0, 0.0], [0.0, 0.0, 0.5, 0.5]]
    dropped = operator(2.0, 3.0, 4.0, 7.0, kind="average", window_s=None)  # two places of a grid are missing
    assert dropped.matrix.toarray().tolist() == np.eye(4).tolist() and dropped.ticks.tolist() == [1, 2, 3, 6]
    with pytest.raises(InputError, match="window of a single average"):
        operator(2.0, kind="average", window_s=None)


@pytest.mark.parametrize("kind", ["point", "average"])
@pytest.mark.parametrize("lag", [0.0, 0.4, -0.3])
def test_cut_operators_keep_what_they_come_from(kind: Kind, lag: float) -> None:
    times = (1.2, 2.2, 3.2, 5.2, 6.2)
    whole = operator(*times, kind=kind).stamped_later(lag, 8)
    for cut, kept in (
        (whole.after(2), times[2:]),
        (whole.before(3), times[:3]),
        (whole.after(1).before(2), times[1:3]),
    ):
        for further in (0.0, 0.25, -lag):
            found = cut.stamped_later(further, 8)
            wanted = operator(*kept, kind=kind).stamped_later(lag + further, 8)
            np.testing.assert_allclose(found.apply(STAIRS[found.ticks]), wanted.apply(STAIRS[wanted.ticks]), atol=1e-12)
            assert found.lag == pytest.approx(lag + further) and found.count == len(kept)
        assert (cut.origin is None) == (lag == 0.0)


def test_the_first_samples_need_the_first_ticks_alone() -> None:
    found = operator(1.0, 4.0, 6.0).before(2)
    assert found.ticks.tolist() == [1, 4] and found.matrix.shape == (2, 2)
    assert found.positions is not None and found.positions.tolist() == [1.0, 4.0]


def test_lines_between_ticks_by_hand() -> None:
    found = operator(2.0, 5.5).stamped_later(0.25, 8)
    assert found.ticks.tolist() == [1, 2, 5, 6]
    assert found.matrix.toarray().tolist() == [[0.25, 0.75, 0, 0], [0, 0, 0.75, 0.25]]
    early = operator(0.0, 7.0).stamped_later(3.0, 8)
    np.testing.assert_allclose(early.apply(STAIRS[early.ticks]), STAIRS[[0, 4]])
    late = operator(2.0, 7.0).stamped_later(-2.0, 8)
    np.testing.assert_allclose(late.apply(STAIRS[late.ticks]), STAIRS[[4, 7]])


@pytest.mark.parametrize(
    ("times", "places"),
    [
        ([0.0], [0]),
        ([0.0, 1.0, 2.0, 4.0, 5.0], [0, 1, 2, 4, 5]),
        ([0.0, 1.0, 2.4, 3.4, 5.0, 6.0], [0, 1, 2, 3, 5, 6]),
        ([0.0, 1.0, 2.0, 2.4, 3.4], [0, 1, 2, 3, 4]),  # a step of less than half of the usual one: no grid
    ],
)
def test_places_on_a_grid(times: list[float], places: list[int]) -> None:
    assert grid_places(np.array(times)).tolist() == places


@pytest.mark.parametrize(
    ("rate", "phase", "wanted"),
    [
        (1.0, 0.0, [2.0, 3.0, 4.0]),
        (1.0, 0.5, [2.5, 3.5]),
        (1.0, 2.0, [4.0]),
        (0.4, 0.0, [2.0]),
        (1.0, 0.95e-6, [2.0, 3.0, 4.0]),  # the last one may lie a millionth beyond
        (1.0, 1.05e-6, [2.0, 3.0]),
    ],
)
def test_instants_of_a_lower_rate(rate: float, phase: float, wanted: list[float]) -> None:
    assert decimated_times(np.array([2.0, 3.0, 4.0]), rate, phase).tolist() == pytest.approx(wanted, abs=2e-6)


@pytest.mark.parametrize(
    ("rate", "phase", "what"),
    [
        (0.0, 0.0, "must be positive"),
        (-1.0, 0.0, "must be positive"),
        (1.0, -0.1, "must not be negative"),
        (1.0, 2.1, "No sample"),
    ],
)
def test_instants_that_cannot_be(rate: float, phase: float, what: str) -> None:
    with pytest.raises(InputError, match=what):
        decimated_times(np.array([2.0, 3.0, 4.0]), rate, phase)


def test_a_way_of_sampling_that_is_not_known_is_no_average() -> None:
    with pytest.raises(AssertionError, match="median"):
        sample_operator(np.zeros(1), start=0.0, step=1.0, tick_count=4, kind="median")  # type: ignore[arg-type]


def test_an_average_counts_each_command_for_as_long_as_it_was_held() -> None:
    clock = Instants(np.array([0.0, 1.0, 3.0, 4.0]), 1.0)
    found = sample_operator(
        np.array([3.0]), start=0.0, step=1.0, tick_count=4, kind="average", window="preceding", window_s=3.0,
        instants=clock,
    )  # fmt: skip
    assert found.apply(np.array([1.0, 4.0, 0.0, 0.0])[found.ticks]).tolist() == pytest.approx([(1 * 1.0 + 2 * 4.0) / 3])
