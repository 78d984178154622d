"""Of what a large torque error is made."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fmu_didim.checks.validation import LARGE_PERCENT, Validation, error_diagnostics, parts_of_error

N = np.arange(1000)
TIME = 0.01 * N
SPEED = np.sin(2 * np.pi * 0.5 * TIME)
TORQUE = 10 * np.sin(2 * np.pi * 0.3 * TIME)
NOISE = np.random.default_rng(5).normal(size=N.size)
SLOW = np.abs(SPEED) < 0.05


def of(error: np.ndarray, percent: float = 20.0) -> Validation:
    """A fitted joint with this error."""
    return Validation(
        "train", "estimation", TIME, (TORQUE + error)[:, None], TORQUE[:, None], percent, np.array([percent]),
        motion={"dq1": SPEED},
    )  # fmt: skip


@pytest.mark.parametrize(
    ("error", "near_rest", "growth", "fast"),
    [
        (NOISE, SLOW.mean(), 1.0, 0.97),  # even noise
        (np.where(SLOW, 3 * NOISE, 0.01 * NOISE), 1.0, None, 0.97),  # backlash
        (0.1 * np.abs(TORQUE) * NOISE, SLOW.mean(), 4.5, 0.97),  # of the drive
        (np.sin(2 * np.pi * 0.8 * TIME), SLOW.mean(), 1.0, 0.0),  # something slow
        (np.sin(2 * np.pi * 20.0 * TIME), SLOW.mean(), 1.0, 1.0),  # a rattle
    ],
)
def test_of_what_an_error_is_made(error: np.ndarray, near_rest: float, growth: float | None, fast: float) -> None:
    rest, sizes, above = parts_of_error(of(error), 0, motion_hz=0.75)
    assert float(rest.split(" %")[0]) == pytest.approx(100 * near_rest, abs=3)
    if growth is not None:
        assert float(sizes.split(" times")[0]) == pytest.approx(growth, rel=0.25)
    assert float(above.split(" %")[0]) == pytest.approx(100 * fast, abs=2)


def test_what_cannot_be_told_is_left_out() -> None:
    uneven = replace(of(NOISE), time=TIME + 0.005 * (N % 2), motion={})
    (sizes,) = parts_of_error(uneven, 0, motion_hz=0.75)
    assert "quarter" in sizes
    assert len(parts_of_error(of(NOISE), 0, motion_hz=np.inf)) == 2
    few = replace(uneven, time=TIME[:10], measured=uneven.measured[:10], simulated=uneven.simulated[:10])
    assert parts_of_error(few, 0, motion_hz=0.75) == ["too few samples to tell of what it is made"]


def test_a_large_error_of_a_fitted_joint_is_remarked() -> None:
    large, small = of(NOISE), of(NOISE, LARGE_PERCENT)
    others = [replace(large, role="validation"), replace(large, failure="diverged"), small]
    (told,) = error_diagnostics([large, *others], 0.75)
    assert (told.code.name, told.code.severity.name, told.place, told.value) == (
        "torque-error-large", "REMARK", "train: joint 1", 20.0,
    )  # fmt: skip
    assert told.text.startswith("The torque error is 20 %: ")
