"""Jittered stamps of an even clock are put right; whatever is none is told, and never put right."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
import pytest

from fmu_didim.data.even_clock import even_clock
from fmu_didim.data.signals import Array

ROWS, PERIOD, DRAWS = 3000, 0.001, 20
GRID = 4.0 + PERIOD * np.arange(ROWS)
Draw = Callable[[np.random.Generator], Array]

JITTERS: dict[str, Draw] = {
    "none": lambda rng: GRID,
    "rounded": lambda rng: np.round(GRID + 0.0003, 4),
    "uniform": lambda rng: GRID + rng.uniform(0, 0.9 * PERIOD, ROWS),
    "late by chance": lambda rng: GRID + rng.exponential(0.2 * PERIOD, ROWS),
    "seldom late by four": lambda rng: GRID + PERIOD * (0.1 * rng.normal(size=ROWS) + 4 * (rng.random(ROWS) < 0.01)),
}  # fmt: skip


def uniform(rng: np.random.Generator, count: int) -> Array:
    return rng.uniform(0, 0.8 * PERIOD, count)


def without(rows: Array, rng: np.random.Generator) -> Array:
    """Stamps of a log from which rows were dropped."""
    kept = np.delete(4.0 + PERIOD * np.arange(ROWS + rows.size), rows)
    return np.asarray(kept + uniform(rng, kept.size))


def _slows(rng: np.random.Generator) -> Array:
    return np.asarray(4.0 + np.cumsum(np.linspace(1, 1.002, ROWS)) * PERIOD + uniform(rng, ROWS))


FAULTS: dict[str, tuple[Draw, str]] = {
    "one row": (lambda rng: without(np.array([1300]), rng), "lacking"),
    "a gap": (lambda rng: without(np.arange(1300, 1340), rng), "lacking"),
    "two that make up": (lambda rng: np.insert(without(np.array([800]), rng), 2000, 4.0 + 2001.4 * PERIOD), "row"),
    "one in fifty": (lambda rng: without(rng.choice(ROWS, 60, replace=False), rng), "lacking"),
    "read twice": (lambda rng: np.sort(np.append(GRID, GRID[1500] + 0.4 * PERIOD)) + uniform(rng, ROWS + 1), "twice"),
    "slows down": (_slows, "wander"),
    "scatters by a period": (lambda rng: GRID + PERIOD * rng.normal(size=ROWS), "scatter by"),
    "a few rows": (lambda rng: GRID[:50] + uniform(rng, 50), "too few"),
}  # fmt: skip


@pytest.mark.parametrize("jitter", JITTERS)
def test_an_even_clock_is_seen_behind_its_stamps(jitter: str) -> None:
    for seed in range(DRAWS):
        stamps = JITTERS[jitter](np.random.default_rng(seed))
        found = even_clock(stamps)
        assert not found.fault, found.fault
        late = found.instants(ROWS) - GRID  # a constant cannot be seen
        assert np.ptp(late) < 0.1 * PERIOD
        assert -0.01 * PERIOD < late.mean() < PERIOD


@pytest.mark.parametrize("fault", FAULTS)
def test_what_is_no_even_clock_is_told(fault: str) -> None:
    make, word = FAULTS[fault]
    for seed in range(DRAWS):
        assert word in even_clock(make(np.random.default_rng(seed))).fault


def test_a_row_that_lacks_is_found_where_it_lacks() -> None:
    fault = even_clock(without(np.array([1300]), np.random.default_rng(1))).fault
    row = int(fault.split("near row ")[1].split()[0])
    assert abs(row - 1300) < 30


def test_a_stated_rate_is_held_against_the_stamps() -> None:
    stamps = JITTERS["uniform"](np.random.default_rng(1))
    assert not even_clock(stamps, 1000.0).fault
    fault = even_clock(stamps, 1001.0).fault
    best = re.search(r"wander .* \(([0-9.]+) Hz fits best\)", fault)
    assert best is not None and float(best[1]) == pytest.approx(1000, abs=0.1)
