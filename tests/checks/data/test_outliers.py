"""Outliers are named at any rate of the log, and noise is not; without them the other checks see right data."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from fmu_didim.checks.data.checks import data_diagnostics
from fmu_didim.checks.data.linear_fit import fitted_motion
from fmu_didim.checks.data.outliers import CHANCE, _above_gap, _follows_motion, _settled, outliers, without
from fmu_didim.model.loop_model import LoopModel
from tests.checks.data.right import right, with_log
from tests.tools.verdict.catalogue import gains, with_effect

Array = np.ndarray
Draw = Callable[[np.random.Generator, int], Array]
NOISE = 0.01


def spiked(model: LoopModel, draw: Draw, *, seed: int = 1, share: float = 0.02) -> LoopModel:
    """The log with errors, in standard deviations of its noise, at a share of the samples of each joint."""
    rng = np.random.default_rng([seed, 77])

    def change(torque: Array) -> Array:
        noise = NOISE * torque.std(axis=0)
        for j in range(torque.shape[1]):
            at = rng.choice(torque.shape[0], max(round(share * torque.shape[0]), 1), replace=False)
            torque[at, j] += draw(rng, at.size) * noise[j]
        return torque

    return with_log(model, change)


def signs(rng: np.random.Generator, count: int) -> Array:
    return rng.choice([-1.0, 1.0], count)


def burst(model: LoopModel) -> LoopModel:
    """Eight samples in a row."""

    def change(torque: Array) -> Array:
        torque[60:68, 0] += 20 * NOISE * torque[:, 0].std()
        return torque

    return with_log(model, change)


SPIKES: dict[str, Callable[[LoopModel], LoopModel]] = {
    "both signs": lambda m: spiked(m, lambda rng, n: 20 * signs(rng, n)),
    "one sign": lambda m: spiked(m, lambda rng, n: np.full(n, 20.0)),
    "sizes drawn": lambda m: spiked(m, lambda rng, n: rng.uniform(8, 20, n) * signs(rng, n)),
    "a burst": burst,
}
every_rate = pytest.mark.parametrize("rate_hz", [20.0, 200.0])
every_robot = pytest.mark.parametrize("robot", ["scara", "arm"])


def codes(model: LoopModel) -> list[str]:
    return [d.code.name for d in data_diagnostics(model)]


@every_rate
@every_robot
@pytest.mark.parametrize("kind", SPIKES)
def test_spikes_are_named_and_nothing_else(robot: str, rate_hz: float, kind: str) -> None:
    found = codes(SPIKES[kind](right(robot, 1, rate_hz=rate_hz, noise=NOISE)))
    assert found and set(found) == {"log-outliers"}


def heavy(robot: str, rate_hz: float) -> LoopModel:
    """Noise by Student's t with three degrees of freedom."""
    model, rng = right(robot, 1, rate_hz=rate_hz, noise=0.0), np.random.default_rng(78)
    for label in model.experiments:
        model = with_log(
            model, lambda torque: torque + NOISE * torque.std(axis=0) * rng.standard_t(3, torque.shape), label
        )
    return model


RIGHT: dict[str, Callable[[str, float], LoopModel]] = {
    "heavy tails": heavy,
    "loud noise": lambda robot, rate_hz: right(robot, 1, rate_hz=rate_hz, noise=1.0),
    "slow noise": lambda robot, rate_hz: right(robot, 1, rate_hz=rate_hz, noise=NOISE, coloured=0.8),
    "no noise": lambda robot, rate_hz: right(robot, 1, rate_hz=rate_hz, noise=0.0),
}


@every_rate
@every_robot
@pytest.mark.parametrize("kind", RIGHT)
def test_noise_is_no_outlier(robot: str, rate_hz: float, kind: str) -> None:
    assert not [code for code in codes(RIGHT[kind](robot, rate_hz)) if "outliers" in code]


def test_the_samples_that_are_wrong_are_found_and_left_out() -> None:
    model = right("scara", 1, noise=NOISE)
    rows = np.array([40, 41, 130, 300])

    def change(torque: Array) -> Array:
        torque[rows, 1] -= 20 * NOISE * torque[:, 1].std()
        return torque

    fitted = fitted_motion(with_log(model, change).on("estimation"))
    assert fitted is not None
    found = outliers(fitted)
    assert {j: places.tolist() for j, places in found.items()} == {1: rows.tolist()}
    left, log = without(fitted, found.values()), model.experiments["estimation"]
    np.testing.assert_array_equal(left.experiment.time, np.delete(log.time, rows))
    np.testing.assert_array_equal(left.experiment.torque, np.delete(log.torque, rows, axis=0))
    for own, of_all in zip(left.sampled, fitted.sampled, strict=True):
        np.testing.assert_array_equal(own, np.delete(of_all, rows, axis=0))
    assert outliers(left) == {}


def test_a_heavy_tail_leaves_a_gap_as_seldom_as_is_said() -> None:
    """Sizes of index three; 2 000 logs of 200 samples."""
    rng = np.random.default_rng(6)
    found = sum(_above_gap(rng.pareto(3.0, 200) + 1, 0.0).size > 0 for _ in range(2000))
    assert found <= 2000 * CHANCE + 4 * np.sqrt(2000 * CHANCE)


N = np.arange(400)
SPEED = np.abs(np.cos(np.pi * N / 40))
"""At rest at 20, 60, ..."""


@pytest.mark.parametrize(
    ("rows", "beside", "told"),
    [
        (N[17::23], 1.0, False),
        (N[20::40], 1.0, True),  # at reversals
        (N[60:80], 1.0, False),  # a burst
        (N[60:80], 4.0, True),  # a slow error, whose sides rise and fall
    ],
)
def test_what_belongs_to_the_motion_is_no_outlier(rows: Array, beside: float, told: bool) -> None:
    sizes = np.abs(np.random.default_rng(2).normal(size=N.size))
    sizes[[58, 59, 80, 81]] *= beside
    sizes[[58, 59, 80, 81]] += beside - 1
    sizes[rows] = 20.0
    assert _follows_motion(rows, sizes, SPEED) is told


@pytest.mark.parametrize(
    ("rows", "left"), [([0, 1, 2, 4], []), ([3, 7, 9, 200], [200]), ([6, 7], [6, 7]), ([50], [50]), ([], [])]
)
def test_a_loop_that_swings_in_is_no_outlier(rows: list[int], left: list[int]) -> None:
    assert _settled(np.array(rows, dtype=int)).tolist() == left


@pytest.mark.parametrize(
    ("robot", "name", "number", "values"),
    [
        ("scara", "quadratic_viscous", 1, {"Fq": 1.0}),
        ("scara", "cubic_viscous", 1, {"Fcube": 1.0}),
        ("arm", "torque_offset", 2, {"offset": 1.0}),
    ],
)
def test_missing_effects_are_no_outliers(robot: str, name: str, number: int, values: dict[str, float]) -> None:
    found = codes(right(robot, 1, noise=NOISE, change=with_effect(name, number, **values)))
    assert not [code for code in found if "outliers" in code]


@pytest.mark.parametrize("factor", [0.8, 1.2, 1.66])
def test_other_gains_are_no_outliers(factor: float) -> None:
    """The loop swings in otherwise."""
    assert not [code for code in codes(right("arm", 1, noise=NOISE, change=gains(factor))) if "outliers" in code]
