"""Rows that a program read at its own pace: their ticks are found in the motion, or it is said why not."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from fmu_didim.data.polled import Ticks, read_again, ticks_of
from fmu_didim.data.signals import Array

RATE, TICKS = 1000.0, 6000
Pace = Callable[[np.random.Generator], Array]


def motion(ticks: Array, rest: tuple[float, float] | None = None) -> Array:
    """(N, 2) positions of two joints; in ``rest``, s, both stand still, and slow down for 0.2 s before it."""
    t = ticks / RATE
    if rest is not None:
        grid = np.arange(0.0, TICKS / RATE + 20.0, 1e-4)
        far = np.maximum(rest[0] - grid, grid - rest[1]) / 0.2
        pace = np.clip(far, 0, 1) ** 2 * (3 - 2 * np.clip(far, 0, 1))
        t = np.interp(t, grid, np.cumsum(pace) * 1e-4)
    phase = 2 * np.pi * 0.31 * t
    return np.column_stack([0.8 * np.sin(phase), 0.5 * np.cos(1.7 * phase) + 0.1 * np.sin(3.1 * phase)])


def paced(mean: float, scatter: float) -> Pace:
    """Readings ``mean`` ticks apart, each wait drawn anew."""

    def draw(rng: np.random.Generator) -> Array:
        waits = mean * (1 + scatter * rng.uniform(-1, 1, int(TICKS / mean)))
        return np.cumsum(waits) + 1.0

    return draw


def with_delays(rng: np.random.Generator) -> Array:
    """A reader that is held up for up to twelve ticks now and then."""
    waits = 1.0 + 0.2 * rng.uniform(-1, 1, TICKS) + np.where(rng.random(TICKS) < 0.01, rng.uniform(2, 12, TICKS), 0)
    return np.cumsum(waits) + 1.0


PACES: dict[str, Pace] = {
    "as fast as the clock, beating": paced(1.0003, 0.05),
    "as fast, scattered": paced(1.0, 0.4),
    "a tenth faster": paced(0.9, 0.2),
    "half as fast": paced(2.03, 0.2),
    "held up now and then": with_delays,
}


def read(
    pace: Pace, rng: np.random.Generator, *, noise: float = 1e-5, rest: tuple[float, float] | None = None
) -> tuple[Array, Array, Array]:
    """Stamps, s, tick and positions of each row."""
    at = pace(rng)
    ticks = np.floor(at)
    # A sample is read again with its noise.
    q = motion(np.arange(ticks[-1] + 1), rest) + noise * rng.normal(size=(int(ticks[-1]) + 1, 2))
    return at / RATE, ticks, q[ticks.astype(int)]


def wrong_ticks(found: Ticks, ticks: Array) -> Array:
    """(N,) By how many ticks the rows are off, but for the constant that nobody can see."""
    off = np.rint(found.instants * RATE - found.instants[0] * RATE) - (ticks - ticks[0])
    return off - np.median(off)


@pytest.mark.parametrize("pace", PACES)
def test_ticks_are_found_in_the_motion(pace: str) -> None:
    for seed in range(10):
        stamps, ticks, q = read(PACES[pace], np.random.default_rng(seed))
        found = ticks_of(stamps, RATE, q)
        assert not found.fault, found.fault
        moving = np.abs(motion(ticks + 1) - motion(ticks)).max(axis=1) > 2e-4
        assert not wrong_ticks(found, ticks)[moving].any()
        assert found.fresh.sum() == np.unique(found.instants).size
        assert abs(found.skipped - (ticks[-1] - ticks[0] + 1 - np.unique(ticks).size)) <= 2
        # Late by a part of a tick at most, as a whole.
        assert -1e-9 <= np.median(found.instants * RATE - ticks) <= 1.1


def test_ticks_are_the_same_behind_a_rest() -> None:
    for seed in range(10):
        stamps, ticks, q = read(PACES["as fast, scattered"], np.random.default_rng(seed), rest=(2.0, 3.0))
        found = ticks_of(stamps, RATE, q)
        assert not found.fault, found.fault
        still = (ticks > 1990) & (ticks < 3010)
        assert np.abs(wrong_ticks(found, ticks)[~still]).max() <= 1
        assert 0.6 < found.told < 0.9


def averaged(rng: np.random.Generator) -> tuple[Array, Array]:
    """Positions that a logger interpolated to its own instants."""
    at = paced(1.0, 0.4)(rng)
    return at / RATE, motion(at) + 1e-5 * rng.normal(size=(at.size, 2))


def at_rest(rng: np.random.Generator) -> tuple[Array, Array]:
    at = paced(1.0, 0.4)(rng)
    return at / RATE, 1e-5 * rng.normal(size=(at.size, 2))


def another_rate(rng: np.random.Generator) -> tuple[Array, Array]:
    stamps, _, q = read(PACES["as fast, scattered"], rng)
    return stamps * 1.004, q


def much_another_rate(rng: np.random.Generator) -> tuple[Array, Array]:
    stamps, _, q = read(PACES["half as fast"], rng)
    return stamps * 0.8, q


def few(rng: np.random.Generator) -> tuple[Array, Array]:
    stamps, _, q = read(PACES["as fast, scattered"], rng)
    return stamps[:60], q[:60]


FAULTS: dict[str, tuple[Callable[[np.random.Generator], tuple[Array, Array]], str]] = {
    "interpolated": (averaged, "whole ticks"),
    "at rest": (at_rest, "hardly move"),
    "another rate": (another_rate, "996.0"),
    "quite another rate": (much_another_rate, "whole ticks"),
    "few rows": (few, "too few"),
}


@pytest.mark.parametrize("kind", FAULTS)
def test_what_is_no_polled_log_is_refused(kind: str) -> None:
    make, says = FAULTS[kind]
    for seed in range(5):
        stamps, q = make(np.random.default_rng(seed))
        found = ticks_of(stamps, RATE, q)
        assert found.fault
        assert says in found.fault, found.fault


def reader(pace: str) -> Array:
    return read(PACES[pace], np.random.default_rng(1))[2]


NOISY = np.random.default_rng(2).normal(size=(3000, 2))
ROWS: dict[str, tuple[Array, bool]] = {
    "read at another pace": (reader("a tenth faster"), True),
    "nearly as fast": (reader("as fast, scattered"), True),
    "slower": (reader("half as fast"), False),
    "each once": (NOISY, False),
    "held for two rows": (np.repeat(NOISY, 2, axis=0), False),
    "held for five rows": (np.repeat(NOISY, 5, axis=0), False),
    "at rest in a part of the time": (np.where(np.arange(3000)[:, None] < 1000, 0.0, NOISY), False),
    "coarse": (np.round(0.4 * NOISY), False),
    "a few": (reader("a tenth faster")[:50], False),
}


@pytest.mark.parametrize("kind", ROWS)
def test_rows_that_were_read_again_are_counted(kind: str) -> None:
    values, told = ROWS[kind]
    assert (read_again(values) > 0) == told
