"""Inertia matrices by their derivatives by the parameters, and whether they are positive definite."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from fmu_didim.dynamics.robot import RobotModel, read_robot
from fmu_didim.dynamics.robot.inertia import KEPT, all_positive, scaled_eigenvalues

ROBOTS = ("fmus/scara/robot.yaml", "fmus/tx40/robot.yaml", "tests/tools/verdict/robots/puma560.yaml")


@pytest.mark.parametrize("file", ROBOTS)
def test_columns_are_the_derivatives_of_the_inertia_matrix(file: str) -> None:
    model = RobotModel(read_robot(file))
    n, rng = model.joint_count, np.random.default_rng(3)
    q, chi = rng.uniform(-3, 3, (7, n)), rng.normal(size=len(model.parameters))
    columns, position, parameters = model.inertia_columns(q), ca.SX.sym("q", n), ca.SX.sym("chi", chi.size)
    assert columns.shape == (7, n, n, chi.size)
    of_all = ca.jacobian(ca.vec(model.mass_matrix(position, parameters)), parameters)
    derivatives = ca.Function("all", [position], [ca.densify(of_all)])
    for k in range(7):
        expected = np.array(derivatives(q[k])).reshape(n, n, -1, order="F")
        np.testing.assert_allclose(columns[k], expected, rtol=0, atol=1e-14)
        mass = np.array(model.mass_matrix(q[k], chi))
        np.testing.assert_allclose(columns[k] @ chi, mass, rtol=0, atol=1e-12)
        np.testing.assert_allclose(model._inertia_columns.mass(q, chi)[k], mass, rtol=0, atol=1e-12)


def test_columns_of_many_sets_of_positions_are_computed_again() -> None:
    model, sets = RobotModel(read_robot(ROBOTS[0])), np.random.default_rng(1).normal(size=(KEPT + 3, 4, 2))
    first = [model.inertia_columns(q) for q in sets]
    for q, found in zip(sets, first, strict=True):
        np.testing.assert_array_equal(model.inertia_columns(q), found)


@pytest.mark.parametrize("file", ROBOTS)
def test_positive_is_what_the_smallest_eigenvalue_says(file: str) -> None:
    """With values that a machine may have and with such as none has."""
    model = RobotModel(read_robot(file))
    rng, own, found = np.random.default_rng(5), model.parameter_values, set()
    q = rng.uniform(-3, 3, (20, model.joint_count))
    for spread in (0.0, 0.1, 0.5, 2.0):
        for _ in range(6):
            chi = own * np.exp(rng.normal(scale=spread, size=own.size)) + spread * rng.normal(size=own.size) / 20
            positive = bool(model.inertia_along(q, chi).min() > 1e-9)
            assert model.inertia_is_positive(q, chi, 1e-9) == positive
            found.add(positive)
    assert found == {True, False}


@pytest.mark.parametrize(
    ("mass", "positive"),
    [
        ([[[2.0, 0.5], [0.5, 1.0]]], True),
        ([[[2.0, 0.5], [0.5, 1.0]], [[1.0, 1.0], [1.0, 1.0]]], False),  # singular at one of two positions
        ([[[1.0, 2.0], [2.0, 1.0]]], False),
        ([[[0.0, 0.0], [0.0, 1.0]]], False),
        ([[[-1.0, 0.0], [0.0, 1.0]]], False),
        ([[[1.0, np.nan], [np.nan, 1.0]]], False),
        ([[[1e12, 0.0], [0.0, 1e-12]]], True),  # of other sizes: it is scaled
        ([[[1.0, 0.9995], [0.9995, 1.0]]], False),  # below the bound
    ],
)
def test_positive_above_a_bound(mass: list[list[list[float]]], positive: bool) -> None:
    assert all_positive(np.array(mass), 1e-3) == positive
    assert bool(scaled_eigenvalues(np.array(mass)).min() > 1e-3) == positive
