"""The motion that was wanted, from references that are planned, rounded or measured."""

from __future__ import annotations

import numpy as np
import pytest

from fmu_didim.data.signals import Array, trajectory, white_noise
from fmu_didim.estimators.starts.reference_start import whole_reference
from tests.checks.data.right import loaded, with_experiment

RATE, TIME = 1000.0, np.arange(10_000) / 1000.0
FREQUENCIES = (0.4, 0.9)


def motion(order: int) -> Array:
    """Derivative of this order of a sum of two sines and cosines, for two joints."""
    turned = [[(2 * np.pi * f) ** order * np.sin(2 * np.pi * f * TIME + p + order * np.pi / 2) for f in FREQUENCIES]
              for p in (0.0, 1.0)]  # fmt: skip
    return np.array(turned).sum(axis=1).T


def wanted(columns: dict[str, Array]) -> tuple[Array, Array, Array]:
    model = with_experiment(loaded("scara"), reference=trajectory(TIME, columns))
    return whole_reference(model.simulation(model.start))


def columns(name: str, values: Array) -> dict[str, Array]:
    return {f"{name}{j + 1}": values[:, j] for j in range(2)}


def errors(found: tuple[Array, Array, Array]) -> list[float]:
    """Of q, dq, ddq, of their size, away from both ends."""
    inside = slice(500, -500)
    return [float((f - motion(k))[inside].std() / motion(k)[inside].std()) for k, f in enumerate(found)]


def test_a_planned_motion_is_left_as_it_is() -> None:
    found = wanted(columns("q", motion(0)))
    np.testing.assert_array_equal(found[0], motion(0))
    assert max(errors(found)) < 1e-6


@pytest.mark.parametrize("noise", [1e-5, 1e-4, 1e-3])
def test_the_accelerations_of_a_measured_motion_are_no_noise(noise: float) -> None:
    measured = motion(0) + noise * np.random.default_rng(3).normal(size=(TIME.size, 2))
    plain = np.gradient(np.gradient(measured, TIME, axis=0), TIME, axis=0)
    assert np.std(plain - motion(2)) > 0.2 * np.std(motion(2))  # what it would be without
    assert max(errors(wanted(columns("q", measured)))) < 0.1


def test_so_are_those_that_come_from_measured_velocities() -> None:
    rough = motion(1) + 1e-2 * np.random.default_rng(4).normal(size=(TIME.size, 2))
    q, dq, ddq = wanted({**columns("q", motion(0)), **columns("dq", rough)})
    np.testing.assert_array_equal(q, motion(0))
    assert max(errors((q, dq, ddq))) < 0.1


def test_accelerations_that_are_given_are_taken() -> None:
    given = motion(2) + 1.0
    found = wanted({**columns("q", motion(0)), **columns("ddq", given)})
    np.testing.assert_array_equal(found[2], given)


def test_white_noise_is_found_in_a_motion() -> None:
    noise = 1e-3 * np.random.default_rng(5).normal(size=TIME.size)
    assert white_noise(motion(0)[:, 0] + noise) == pytest.approx(1e-3, rel=0.05)
    assert white_noise(motion(0)[:, 0]) < 1e-8 and white_noise(np.zeros(100)) == 0.0
