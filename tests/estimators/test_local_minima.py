"""The scan for other minima along an inertia finds what a full grid finds, and looks closely only where one may be."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from fmu_didim.data.signals import Array
from fmu_didim.estimators.local_minima import scan

COUNT = 12
TIME = np.linspace(0.0, 1.0, 40)


class Residual:
    """A sampled motion whose swing has a frequency that falls with the inertia exp(0.15 k), against that of k = truth;
    and how often it was asked for."""

    def __init__(self, *, swing: float, rate: float, truth: int = 0, noise: float = 1.0, fails_above: int = 99) -> None:
        self._swing, self._rate, self._truth, self._fails_above = swing, rate, truth, fails_above
        self._noise = noise * np.random.default_rng(0).normal(size=TIME.size)
        self.asked: list[int] = []

    def _torque(self, k: float) -> Array:
        inertia = np.exp(0.15 * k)
        slow = 30.0 * inertia * np.sin(2 * np.pi * TIME)
        return slow * (self._swing == 0) + self._swing * np.sin(self._rate * TIME / np.sqrt(inertia))

    def size(self, k: int) -> float:
        if k > self._fails_above:
            return np.inf
        return float(np.linalg.norm(self._torque(k) - self._torque(self._truth) + self._noise))

    def sizes(self, places: Sequence[int]) -> Array:
        self.asked += places
        return np.array([self.size(k) for k in places])

    def speed(self, k: int) -> float:
        return float(np.linalg.norm(self._torque(1e-3) - self._torque(-1e-3)) / 2e-3 * np.exp(0.15 * max(k, 0)))

    def minima(self) -> list[int]:
        size = [self.size(k) for k in range(-COUNT, COUNT + 1)]
        inner = range(1, 2 * COUNT)
        lower = [i for i in inner if size[i] < size[i - 1] and size[i] <= size[i + 1] and i != COUNT]
        limit = np.sqrt(2 * size[COUNT] ** 2 + 10.8)
        return [i - COUNT for i in sorted(lower, key=lambda i: size[i]) if size[i] <= limit]


@pytest.mark.parametrize("swing", [3.0, 10.0, 30.0])
@pytest.mark.parametrize("rate", [20.0, 40.0, 90.0])
@pytest.mark.parametrize("truth", [-9, -4, 0, 3, 8])
def test_it_finds_the_minima_of_the_grid(swing: float, rate: float, truth: int) -> None:
    residual = Residual(swing=swing, rate=rate, truth=truth)
    assert scan(residual.sizes, COUNT, residual.speed) == residual.minima()
    assert not truth or truth in residual.minima()


def test_a_residual_that_only_grows_is_asked_for_at_few_places() -> None:
    residual = Residual(swing=0.0, rate=20.0)
    assert scan(residual.sizes, COUNT, residual.speed) == []
    assert len(residual.asked) <= COUNT + 1  # of 25
    assert sorted(set(residual.asked)) == sorted(residual.asked)


def test_beside_what_cannot_be_simulated_all_places_are_looked_at() -> None:
    residual = Residual(swing=10.0, rate=40.0, truth=3, fails_above=4)
    assert scan(residual.sizes, COUNT, residual.speed) == residual.minima()
