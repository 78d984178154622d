"""Autoregressions and the test of whiteness, against closed forms, dense algebra and seeded noise."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal, stats

from fmu_didim.fit.noise.autoregression import (
    autocorrelation,
    autoregression,
    innovations,
    largest_order,
    portmanteau,
    portmanteau_p,
)

SECOND_ORDER = np.array([1.2, -0.5])


def by_impulse_response(coefficients: np.ndarray, count: int) -> np.ndarray:
    """Autocovariance of e_t = a_1 e_(t-1) + ... + u_t with var u = 1: sum of psi_i psi_(i + k)."""
    impulse = np.zeros(4000)
    impulse[0] = 1.0
    psi = signal.lfilter([1.0], np.append(1.0, -coefficients), impulse)
    return np.array([psi[: psi.size - k] @ psi[k:] for k in range(count)])


def sampled(values: np.ndarray, lags: int) -> np.ndarray:
    return np.array([values[: values.size - k] @ values[k:] for k in range(lags + 1)]) / values.size


@pytest.mark.parametrize(
    "coefficients", [np.array([0.9]), np.array([-0.6]), SECOND_ORDER, np.array([0.3, 0.1, 0.0, 0.4])]
)
def test_autocorrelation_is_that_of_the_impulse_response(coefficients: np.ndarray) -> None:
    expected = by_impulse_response(coefficients, 60)
    np.testing.assert_allclose(autocorrelation(coefficients, 60), expected / expected[0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(autocorrelation(coefficients, 2), expected[:2] / expected[0], rtol=0, atol=1e-12)


def test_white_noise_has_none() -> None:
    np.testing.assert_array_equal(autocorrelation(np.zeros(0), 4), [1.0, 0.0, 0.0, 0.0])


@pytest.mark.parametrize("coefficients", [np.array([0.9]), SECOND_ORDER, np.array([0.3, 0.1, 0.0, 0.4])])
def test_exact_autocovariances_give_order_and_coefficients(coefficients: np.ndarray) -> None:
    covariance = 7.0 * by_impulse_response(coefficients, 20)
    np.testing.assert_allclose(autoregression(covariance, 1000, 12), coefficients, rtol=0, atol=1e-10)
    left = innovations(covariance, coefficients, 8)
    np.testing.assert_allclose(left, [7.0, *np.zeros(8)], rtol=0, atol=1e-9)


def test_order_of_sampled_noise() -> None:
    """White noise is found white in 73 of 100 draws; two coefficients are found as two or a few more, with the right
    spectrum, whose deviation is 0.011."""
    rng, orders = np.random.default_rng(1), []
    for _ in range(300):
        white = rng.normal(size=1000)
        orders.append(autoregression(sampled(white, 10), 1000, 10).size)
        found = autoregression(sampled(signal.lfilter([1.0], [1.0, -1.2, 0.5], rng.normal(size=4000)), 10), 4000, 10)
        assert found.size >= 2
        assert 1 - found.sum() == pytest.approx(0.3, abs=0.1)  # the root of the spectrum at zero is its inverse
    # The standard deviation of a share of 300 draws is 0.026.
    assert np.mean(np.array(orders) == 0) == pytest.approx(0.73, abs=0.12)


@pytest.mark.parametrize(
    ("covariance", "samples"),
    [([1.0, 1.5, 1.0], 100), ([1.0, 0.9, 0.2, -0.9], 100), ([1.0, 0.9, 0.8, 0.7], 4)],
    ids=["no noise has these", "nor these", "too few samples"],
)
def test_what_no_noise_has_or_too_few_samples_show_ends_the_recursion(covariance: list[float], samples: int) -> None:
    found = autoregression(np.array(covariance), samples, len(covariance) - 1)
    roots = np.roots(np.append(1.0, -found))
    assert found.size <= 2
    assert (np.abs(roots) < 1).all()


def test_portmanteau_is_that_of_ljung_and_box() -> None:
    values = np.random.default_rng(3).normal(size=120)
    covariance = sampled(values, 5)
    rho = covariance[1:] / covariance[0]
    expected = 120 * 122 * np.sum(rho**2 / (120 - np.arange(1, 6)))
    pairs = 120.0 - np.arange(6)
    assert portmanteau(covariance * 120 / pairs, pairs, 5) == pytest.approx(expected, rel=1e-12)
    assert portmanteau_p(expected, 5) == pytest.approx(stats.chi2.sf(expected, 5))
    assert portmanteau(np.zeros(6), pairs, 5) == 0.0
    assert portmanteau_p(3.0, 0) == 1.0


@pytest.mark.parametrize(("samples", "order"), [(20, 4), (100, 20), (2000, 33)])
def test_largest_order(samples: int, order: int) -> None:
    assert largest_order(samples) == order
