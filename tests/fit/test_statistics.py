"""Least squares and its statistics, against numpy, SciPy, closed forms and Monte Carlo."""

from __future__ import annotations

import numpy as np
import pytest

from fmu_didim.base.errors import IdentificationError
from fmu_didim.fit.statistics import (
    confidence_interval,
    correlation,
    covariance_white,
    influence_efficient,
    influence_of_instruments,
    least_squares,
    noise_deviation,
    relative_deviation_percent,
    relative_error_percent,
)

DRAWS = 4000


def regressor(rows: int = 60, columns: int = 3, seed: int = 1) -> np.ndarray:
    """Correlated columns of very different sizes."""
    rng = np.random.default_rng(seed)
    return rng.normal(size=(rows, columns)) @ (np.eye(columns) + 0.5) * 10.0 ** np.arange(columns)


def sandwich(w: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Covariance of the fixed point of W'(y - S chi) = 0 with white noise."""
    influence = influence_of_instruments(w, s)
    return influence.T @ influence


def test_least_squares_equals_numpy() -> None:
    a, b = regressor(), np.random.default_rng(2).normal(size=60)
    got = least_squares(a, b)
    expected = np.linalg.lstsq(a, b, rcond=None)[0]
    np.testing.assert_allclose(got.solution, expected, rtol=1e-12)
    np.testing.assert_allclose(got.residual, b - a @ expected, rtol=0, atol=1e-12)
    assert got.condition_number == pytest.approx(np.linalg.cond(a / np.linalg.norm(a, axis=0)), rel=1e-10)
    projection = a @ np.linalg.pinv(a)
    np.testing.assert_allclose(got.leverage, np.diag(projection), rtol=1e-10)


def test_condition_number_does_not_depend_on_units() -> None:
    a, b = regressor(), np.ones(60)
    other = least_squares(a * np.array([1e6, 1.0, 1e-3]), b)
    assert other.condition_number == pytest.approx(least_squares(a, b).condition_number, rel=1e-10)


def test_unexcited_columns_are_named() -> None:
    a = regressor(columns=4)
    a[:, [1, 3]] = 0.0
    with pytest.raises(IdentificationError, match=r"does not excite[\s\S]*got:   Fv1, Fc1"):
        least_squares(a, np.ones(60), names=("ZZ1", "Fv1", "ZZ2", "Fc1"))


def test_dependent_columns_are_refused() -> None:
    a = regressor(columns=3)
    a[:, 2] = 2 * a[:, 0] - a[:, 1]
    with pytest.raises(IdentificationError, match=r"cannot tell some parameters apart[\s\S]*got:   Fv, Fc, J"):
        least_squares(a, np.ones(60), names=("Fv", "Fc", "J"))


@pytest.mark.parametrize("rows", [2, 3])
def test_too_few_rows_are_refused(rows: int) -> None:
    with pytest.raises(IdentificationError, match=rf"{rows} samples, 3 parameters"):
        least_squares(regressor(rows), np.ones(rows))


def test_values_that_are_not_finite_are_refused() -> None:
    a, b = regressor(), np.ones(60)
    for bad in (np.nan, np.inf):
        changed = a.copy()
        changed[3, 1] = bad
        with pytest.raises(IdentificationError, match="not finite"):
            least_squares(changed, b)
        target = b.copy()
        target[3] = bad
        with pytest.raises(IdentificationError, match="not finite"):
            least_squares(a, target)


def test_covariances_equal_their_closed_forms() -> None:
    w, s = regressor(seed=3), regressor(seed=4)
    s = w + 0.2 * s
    np.testing.assert_allclose(covariance_white(w), np.linalg.inv(w.T @ w), rtol=1e-10)
    np.testing.assert_allclose(covariance_white(s), np.linalg.inv(s.T @ s), rtol=1e-10)
    left, right = np.linalg.inv(w.T @ s), np.linalg.inv(s.T @ w)
    np.testing.assert_allclose(sandwich(w, s), left @ (w.T @ w) @ right, rtol=1e-8)
    np.testing.assert_allclose(sandwich(w, w), covariance_white(w), rtol=1e-8)
    np.testing.assert_allclose(influence_efficient(s), np.linalg.pinv(s).T, rtol=1e-8)


@pytest.mark.parametrize("apart", [0.0, 1e-17, 1e-15])
def test_columns_that_only_rounding_tells_apart_are_unknown_and_leave_the_others_known(apart: float) -> None:
    """As two values of a start that has long died away in the log."""
    rng = np.random.default_rng(12)
    known, dying = regressor(seed=11), rng.normal(size=60)
    columns = np.column_stack([known, 1e-9 * dying, 3e-9 * (dying + apart * rng.normal(size=60))])
    alone = covariance_white(np.column_stack([known, dying]))
    influence = influence_efficient(columns)
    for covariance in (influence.T @ influence, covariance_white(columns)):
        np.testing.assert_allclose(covariance[:3, :3], alone[:3, :3], rtol=1e-3)
        assert np.sqrt(np.diag(covariance)[3:]).min() > 1e15


@pytest.mark.parametrize("rows", [0, 1, 2])
def test_fewer_rows_than_columns_have_no_covariance(rows: int) -> None:
    for of in (covariance_white, influence_efficient):
        with pytest.raises(np.linalg.LinAlgError):
            of(regressor(rows))


def test_covariances_equal_the_scatter_of_the_estimates() -> None:
    """y = S chi + e: the fixed point W'(y - S chi) = 0 scatters as the sandwich, least squares as (S'S)^-1."""
    rng = np.random.default_rng(5)
    w = regressor(seed=6)
    s = w @ np.array([[0.8, 0.3, 0.0], [0.0, 1.3, 0.2], [0.1, 0.0, 0.7]]) + 0.5 * regressor(seed=7)
    noise = rng.normal(size=(60, DRAWS))
    for matrix, formula in (
        (np.linalg.solve(w.T @ s, w.T), sandwich(w, s)),
        (np.linalg.pinv(s), covariance_white(s)),
        (np.linalg.pinv(w), covariance_white(w)),
    ):
        scatter = np.cov(matrix @ noise)
        sizes = np.sqrt(np.diag(formula))
        # The standard deviation of a sampled variance is sqrt(2 / DRAWS) = 2.2 % of it.
        np.testing.assert_allclose(scatter / np.outer(sizes, sizes), correlation(formula), rtol=0, atol=0.09)
    # In the sense of matrices no unbiased estimator is better than the efficient one.
    excess = sandwich(w, s) - covariance_white(s)
    sizes = np.sqrt(np.diag(excess))
    assert np.linalg.eigvalsh(excess / np.outer(sizes, sizes)).min() > -1e-10


def test_noise_deviation_is_unbiased() -> None:
    """Two joints that share parameters but not equally: each joint has its own degrees of freedom."""
    rng = np.random.default_rng(8)
    count, sigma = 12, 0.3
    rows = rng.normal(size=(count, 2, 5))
    rows[:, 1, :3] = 0.0
    flat = rows.reshape(-1, 5)
    shape, variances = (count, 2), []
    for _ in range(800):
        fit = least_squares(flat, flat @ np.arange(5.0) + rng.normal(scale=sigma, size=2 * count))
        sigmas = noise_deviation(fit.residual.reshape(shape), fit.leverage.reshape(shape), floor=np.zeros(2))
        variances.append(sigmas**2)
    mean = np.mean(variances, axis=0) / sigma**2
    error = np.std(variances, axis=0) / sigma**2 / np.sqrt(len(variances))
    assert (error < 0.03).all()
    assert (np.abs(mean - 1) < 4 * error).all(), mean


def test_noise_deviation_has_a_floor() -> None:
    residual = np.column_stack([np.zeros(10), np.full(10, 2.0)])
    got = noise_deviation(residual, np.full((10, 2), 0.1), floor=np.array([0.5, 0.5]))
    np.testing.assert_allclose(got, [0.5, np.sqrt(40 / 9)])


def test_confidence_interval_is_students() -> None:
    value, deviation = np.array([1.0, -2.0]), np.array([0.1, 3.0])
    # From tables of Student's distribution.
    for freedom, level, quantile in ((4.0, 0.95, 2.776445), (10.0, 0.9, 1.812461), (500.0, 0.99, 2.585698)):
        got = confidence_interval(value, deviation, freedom, level)
        expected = np.column_stack([value - quantile * deviation, value + quantile * deviation])
        np.testing.assert_allclose(got, expected, rtol=1e-6)
    assert confidence_interval(value, deviation, 1e9)[0, 1] == pytest.approx(1.0 + 0.1 * 1.959964, rel=1e-6)


def test_interval_covers_as_often_as_it_says() -> None:
    rng = np.random.default_rng(9)
    a, truth = regressor(rows=8, columns=2), np.array([1.0, 2.0])
    hits, draws = np.zeros(2), 600
    for _ in range(draws):
        fit = least_squares(a, a @ truth + rng.normal(scale=0.7, size=8))
        sigma = noise_deviation(fit.residual[:, None], fit.leverage[:, None], floor=np.zeros(1))
        deviation = np.sqrt(np.diag(covariance_white(a / sigma)))
        low, high = confidence_interval(fit.solution, deviation, 6.0, 0.9).T
        hits += (low < truth) & (truth < high)
    np.testing.assert_allclose(hits / draws, 0.9, rtol=0, atol=0.04)


def test_relative_deviation() -> None:
    got = relative_deviation_percent(np.array([-2.0, 0.0, 4.0]), np.array([0.1, 0.2, 1.0]))
    np.testing.assert_allclose(got, [5.0, np.inf, 25.0])


def test_correlation_of_known_covariance() -> None:
    got = correlation(np.array([[4.0, -3.0], [-3.0, 9.0]]))
    np.testing.assert_allclose(got, [[1.0, -0.5], [-0.5, 1.0]], rtol=1e-15)


def test_relative_error() -> None:
    measured = np.array([[3.0, 0.0], [4.0, 12.0]])
    simulated = np.array([[3.0, 1.0], [3.0, 12.0]])
    total, joints = relative_error_percent(measured, simulated)
    np.testing.assert_allclose(joints, [100 / 5, 100 / 12])
    assert total == pytest.approx(100 * np.sqrt(2) / 13)
