"""The power of the test for what follows the motion: against draws of noise, and where nothing can be seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fmu_didim.checks.motion.colour import Logs
from fmu_didim.checks.motion.dependence import MOTION_CHANCE, JointResidual, Left
from fmu_didim.checks.power.power import POWER, JointTest, smallest_size
from fmu_didim.fit.uncertainty import stretches

RNG = np.random.default_rng
TIME = np.linspace(0, 10, 500)
MOTION = np.column_stack([np.sin((k + 1) * TIME) for k in range(12)])
NAMES = [f"function {k}" for k in range(12)]
SENSITIVITY = np.column_stack([np.cos(TIME), np.cos(2 * TIME), np.sign(np.cos(TIME))])
SIGNATURES = {
    "a function": MOTION[:, 11],
    "two functions": MOTION[:, 1] + 0.8 * MOTION[:, 7],
    "most of it a function": MOTION[:, 2] + 0.5 * np.sign(np.sin(40 * TIME)),
    "a function beside the fit": MOTION[:, 10] + 5 * SENSITIVITY[:, 1],
}
LARGEST = 10.0
DRAWS = 40


def looked_at(residual: np.ndarray) -> JointResidual:
    return JointResidual(1, Left(residual, SENSITIVITY, Logs(tuple(stretches([TIME])))), MOTION, NAMES)


def by_noise(signature: np.ndarray, *, seed: int = 0, noise: float = 1.0, joints: int = 1) -> JointTest:
    found = JointTest.of(looked_at(noise * RNG(seed).normal(size=TIME.size)), [signature], joints)
    assert found is not None
    return found


@pytest.mark.parametrize("name", SIGNATURES)
def test_as_many_draws_are_doubted_as_the_power_says(name: str) -> None:
    """Each draw by the size that another draw of the noise states; none where a misfit may pass for coloured noise."""
    doubted = []
    for seed in range(DRAWS):
        size = smallest_size([by_noise(SIGNATURES[name], seed=1000 + seed)], 0, LARGEST)
        if size is None:
            continue
        one = looked_at(RNG(seed).normal(size=TIME.size) + size * SIGNATURES[name])
        doubted.append(one.dependence().p_value < MOTION_CHANCE)
    assert len(doubted) > DRAWS / 2
    assert abs(np.mean(doubted) - POWER) < 0.1 + 2 * np.sqrt(POWER * (1 - POWER) / len(doubted))


def test_the_size_grows_with_the_noise_and_with_the_joints_among_which_it_is_told() -> None:
    signature = SIGNATURES["a function"]
    one, twice = (smallest_size([by_noise(signature, noise=noise)], 0, LARGEST) for noise in (1.0, 2.0))
    of_six = smallest_size([by_noise(signature, joints=6)], 0, LARGEST)
    assert one is not None and twice is not None and of_six is not None
    assert twice == pytest.approx(2 * one, rel=0.01)
    assert one < of_six < 1.3 * one


def test_two_joints_see_more_than_one() -> None:
    alone = by_noise(SIGNATURES["a function"])
    one, both = smallest_size([alone], 0, LARGEST), smallest_size([alone, alone], 0, LARGEST)
    assert one is not None and both is not None
    assert 0.7 * one < both < one


@pytest.mark.parametrize(
    "signature",
    [SENSITIVITY @ (1.0, -2.0, 3.0), RNG(9).normal(size=TIME.size), np.zeros(TIME.size)],
    ids=["what the fit absorbs", "what no function follows", "nothing"],
)
def test_what_the_test_cannot_see_has_no_size(signature: np.ndarray) -> None:
    assert smallest_size([by_noise(signature)], 0, LARGEST) is None


def test_a_size_beyond_the_largest_is_none() -> None:
    assert smallest_size([by_noise(SIGNATURES["a function"])], 0, 0.05) is None


def test_loud_noise_where_a_function_is_large_hides_it() -> None:
    """The test allows for it, and so does its power."""
    signature = np.exp(-(((TIME - 5) / 0.5) ** 2))
    loud = 1.0 + 4.0 * signature
    sizes = []
    for deviation in (np.full(TIME.size, np.sqrt(np.mean(loud**2))), loud):
        one = looked_at(deviation * RNG(3).normal(size=TIME.size))
        one = replace(one, motion=np.column_stack([signature, MOTION]))
        found = JointTest.of(one, [signature], 1)
        assert found is not None
        sizes.append(smallest_size([found], 0, 100.0))
    even, hidden = sizes
    assert even is not None and hidden is not None
    assert hidden > 1.5 * even


def test_too_few_samples_have_no_power() -> None:
    left = Left(np.ones(5), SENSITIVITY[:5], Logs(tuple(stretches([TIME[:5]]))))
    short = JointResidual(1, left, MOTION[:5], NAMES)
    assert JointTest.of(short, [np.ones(5)], 1) is None


def test_a_misfit_that_passes_for_coloured_noise_is_not_stated() -> None:
    """Slow, and mostly beside all functions: it is learnt as the colour of the noise, the more the larger it is."""
    slow = np.convolve(RNG(2).normal(size=TIME.size + 40), np.hanning(41), mode="valid")
    signature = slow / np.std(slow) + 0.9 * MOTION[:, 3]
    test = by_noise(signature)
    assert test.power(0, np.array([3.0])) > POWER
    assert smallest_size([test], 0, LARGEST) is None
    draws = [looked_at(RNG(seed).normal(size=TIME.size) + 3.0 * signature) for seed in range(20)]
    assert np.mean([one.dependence().p_value < MOTION_CHANCE for one in draws]) < 0.5


@pytest.mark.parametrize("name", ["a function", "a function beside the fit"])
def test_a_size_does_not_hang_on_rounding(name: str) -> None:
    """Where one function is the misfit itself nothing is left for another one, which rounding would choose."""
    for seed in range(5):
        noise = RNG(seed).normal(size=TIME.size)
        sizes = []
        for part in (0.0, 1e-13):
            one = looked_at(noise * (1 + part * RNG(100 + seed).normal(size=TIME.size)))
            test = JointTest.of(one, [SIGNATURES[name]], 1)
            assert test is not None
            assert [step.count for step in test.steps(0)] == [1]
            sizes.append(smallest_size([test], 0, LARGEST))
        assert sizes[0] == pytest.approx(sizes[1], rel=1e-8)
