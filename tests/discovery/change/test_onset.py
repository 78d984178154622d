"""When a change began."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fmu_didim.data.signals import Array
from fmu_didim.discovery.change.onset import After, onset, order_chance

COUNT, SIZE = 3, 12


def after(rng: np.random.Generator, shape: Array, change: Array, time: Array | None = None) -> After:
    """Logs of unit noise whose values follow a shape."""
    values = rng.normal(size=(shape.size, COUNT)) + shape[:, None] * change
    spreads = np.broadcast_to(np.eye(COUNT), (shape.size, COUNT, COUNT))
    return After(
        np.zeros(COUNT), np.eye(COUNT) / 10, values, spreads, np.arange(1.0, shape.size + 1) if time is None else time
    )


CHANGE = np.array([5.0, 0.0, -3.0])
PLACES = np.arange(SIZE)


@pytest.mark.parametrize("first", [0, 4, 10])
def test_a_step_is_found_within_one_log(first: int) -> None:
    near = held = 0
    for seed in range(15):
        found = onset(after(np.random.default_rng(seed), (first <= PLACES).astype(float), CHANGE))
        near += found.kind == "step" and abs(found.first - first) <= 1 and found.last == SIZE - 1
        held += found.earliest <= first <= found.latest
    assert near >= 14
    assert held >= 13


@pytest.mark.gate
def test_the_interval_holds_as_often_as_it_says_where_the_change_is_small() -> None:
    held = [
        found.earliest <= 6 <= found.latest
        for seed in range(80)
        if (found := onset(after(np.random.default_rng(seed), (PLACES >= 6).astype(float), CHANGE / 3))).kind == "step"
    ]
    assert len(held) > 40
    assert np.mean(held) > 0.9


def test_a_single_log_an_episode_a_drift_and_the_last_log_are_told_apart() -> None:
    time = np.arange(1.0, SIZE + 1)
    shapes = {
        ("episode", 5, 5): (PLACES == 5).astype(float),
        ("episode", 3, 6): ((PLACES >= 3) & (PLACES <= 6)).astype(float),
        ("last", SIZE - 1, SIZE - 1): (PLACES == SIZE - 1).astype(float),
        ("drift", 0, SIZE - 1): 3 * time / SIZE,
    }
    for (kind, first, last), shape in shapes.items():
        right = 0
        for seed in range(20):
            found = onset(after(np.random.default_rng(seed), shape, 2 * CHANGE, time))
            right += found.kind == kind and abs(found.first - first) <= 1 and found.last == last
        assert right >= 19, kind


def test_a_drift_goes_by_the_date_and_not_by_the_number_of_the_log() -> None:
    time = np.array([1, 2, 3, 4, 5, 6, 7, 60, 70, 80, 90, 100.0])
    right = [
        onset(after(np.random.default_rng(seed), 3 * time / 100, 2 * CHANGE, time)).kind == "drift"
        for seed in range(20)
    ]
    assert np.mean(right) > 0.9


def test_two_kinds_that_explain_as_much_are_both_told() -> None:
    found = onset(after(np.random.default_rng(3), np.array([0.0, 0.5, 1.0]), CHANGE))
    assert {found.kind, *found.rivals} >= {"step", "drift"}


def test_one_log_alone_tells_nothing_of_lasting() -> None:
    assert onset(after(np.random.default_rng(1), np.ones(1), CHANGE)).kind == "last"


def test_a_wrong_mean_of_the_reference_is_no_change_from_the_first_log_on() -> None:
    shape = (PLACES >= 6).astype(float)
    right = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        logs = after(rng, shape, CHANGE)
        found = onset(replace(logs, mean=rng.normal(size=COUNT) / np.sqrt(10)))
        right += abs(found.first - 6) <= 1
        assert "step" in (found.kind, *found.rivals)
    assert right >= 18


def test_the_order_of_a_reference_shows_a_step_or_a_drift_and_seldom_by_chance() -> None:
    time = np.arange(10.0)
    chances = [
        order_chance(np.random.default_rng(seed).normal(size=(10, COUNT)), np.eye(COUNT), time)[0] for seed in range(30)
    ]
    assert 0.3 < np.mean(chances) < 0.7  # uniform
    rng = np.random.default_rng(1)
    step = rng.normal(size=(10, COUNT)) + (time >= 5)[:, None] * 2 * CHANGE
    chance, place = order_chance(step, np.eye(COUNT), time)
    assert chance < 0.02
    assert place == 5
    assert order_chance(rng.normal(size=(10, COUNT)) + time[:, None] * CHANGE, np.eye(COUNT), time)[0] < 0.002
    assert order_chance(step[:2], np.eye(COUNT), time[:2]) == (1.0, 0)
