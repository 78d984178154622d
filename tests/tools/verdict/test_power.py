"""Sizes that a valid verdict states: a few draws at a multiple and at a part of them, and the whole table."""

from __future__ import annotations

import numpy as np
import pytest

from tests.tools.verdict.power import draws, grouped, main

KINDS = {"dead_zone", "thermal_friction_drift", "quadratic_viscous"}


@pytest.mark.slow
@pytest.mark.parametrize("robot", ["scara", "arm"])
def test_twice_the_stated_size_is_doubted_and_a_third_of_it_is_not(robot: str) -> None:
    """Twice the size has four times the noncentrality: a power of one; a third of it a ninth: one of some 1 %."""
    larger = [one for seed in (1, 2) for one in draws(robot, seed, KINDS, times=2.0)]
    assert len(larger) >= 2 * len(KINDS) - 1
    assert [(one.effect, one.seed) for one in larger if not one.is_doubted] == []
    smaller = [one for seed in (1, 2) for one in draws(robot, seed, KINDS, times=1 / 3)]
    assert np.mean([one.is_doubted for one in smaller]) < 0.3


@pytest.mark.gate
@pytest.mark.parametrize("times", [3.0, 10.0])
def test_a_larger_offset_is_doubted_too(times: float) -> None:
    """It is as slow as slow noise, and the larger the more the residual looks like it: ten times the stated size passed
    as coloured noise in all draws."""
    found = [one for seed in (1, 2) for one in draws("scara", seed, {"torque_offset"}, times=times)]
    assert [one.is_doubted for one in found] == [True, True]


@pytest.mark.slow
def test_stated_sizes_are_doubted_in_nine_of_ten_draws() -> None:
    assert main(["--draws", "50"]) == 0


def test_draws_are_grouped_by_robot_and_effect() -> None:
    assert grouped([]) == []
