"""Weights of the joints from triangles of each joint: the same as from all samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fmu_didim.base.errors import IdentificationError
from fmu_didim.fit.noise.weighting import OutputTriangles, output_deviation
from fmu_didim.model.loop_model import LoopModel
from tests.helpers import model_of, with_torque


def problem(samples: int = 40, joints: int = 3, count: int = 5) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    columns = rng.normal(size=(samples, joints, count))
    return columns, columns @ rng.normal(size=count) + rng.normal(size=(samples, joints)) * [0.1, 1.0, 3.0][:joints]


@pytest.mark.parametrize("samples", [40, 3])  # with three samples a joint has fewer rows than columns
def test_weighted_solution_and_leverages(samples: int) -> None:
    columns, target = problem(samples)
    deviation = np.array([0.1, 1.0, 3.0])
    found, leverage = OutputTriangles.of(columns, target).solved(deviation, ())
    rows = (columns / deviation[:, None]).reshape(-1, 5)
    wanted = np.linalg.lstsq(rows, (target / deviation).ravel(), rcond=None)[0]
    hat = np.diag(rows @ np.linalg.pinv(rows)).reshape(samples, 3)
    np.testing.assert_allclose(found, wanted, rtol=1e-10)
    np.testing.assert_allclose(leverage, hat.sum(axis=0), rtol=1e-10)


def test_sums_of_squares() -> None:
    columns, target = problem()
    solution = np.arange(5.0)
    found = OutputTriangles.of(columns, target).squares(solution)
    np.testing.assert_allclose(found, ((target - columns @ solution) ** 2).sum(axis=0), rtol=1e-12)


@pytest.fixture(scope="module")
def arm() -> LoopModel:
    return model_of("examples/scara/identify.yaml")


def test_deviation_counts_the_parameters_that_each_joint_has_spent(arm: LoopModel) -> None:
    """A joint that all parameters follow loses all their degrees of freedom."""
    rng = np.random.default_rng(4)
    columns = rng.normal(size=(50, 2, 4))
    columns[:, 1] = 0.0
    residual = rng.normal(size=(50, 2)) * [1.0, 2.0]
    model = with_torque(replace(arm, torque_deviation=None), rng.normal(size=(50, 2)))
    found = output_deviation(model, residual, columns)
    np.testing.assert_allclose(found, np.sqrt((residual**2).sum(axis=0) / np.array([46.0, 50.0])), rtol=1e-10)


def test_equal_weights_take_the_residual_of_all_joints(arm: LoopModel) -> None:
    columns, residual = problem(joints=2)
    model = with_torque(replace(arm, joint_weights="equal", torque_deviation=None), residual)
    np.testing.assert_allclose(output_deviation(model, residual, columns), np.sqrt((residual**2).mean()) * np.ones(2))


def test_what_is_not_finite_is_refused() -> None:
    columns, target = problem()
    target[7, 1] = np.nan
    with pytest.raises(IdentificationError, match="not finite"):
        OutputTriangles.of(columns, target)
