"""The least value between two bounds."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from fmu_didim.fit.solver.bounded import least_between


@pytest.mark.parametrize(
    ("function", "place"),
    [
        (lambda x: (x - 0.3) ** 2, 0.3),
        (lambda x: abs(x - 0.7123), 0.7123),
        (lambda x: x, -1.0),  # at a bound
        (lambda x: -x, 1.5),
        (lambda x: min(3 * abs(x + 0.2), 1.0), -0.2),  # flat elsewhere
        (lambda x: math.exp(8 * x) - 30 * x, math.log(30 / 8) / 8),
    ],
)
def test_the_minimum_is_found_to_the_accuracy(function: Callable[[float], float], place: float) -> None:
    found, value = least_between(function, -1.0, 1.5, accuracy=1e-6)
    assert found == pytest.approx(place, abs=2e-6) and value == function(found)


def test_so_many_evaluations_are_made_at_most() -> None:
    asked: list[float] = []
    least_between(lambda x: (asked.append(x), abs(x - 0.7123))[1], -1.0, 1.5, accuracy=1e-9, evaluations=7)
    assert len(asked) <= 8
