"""Tails and quantiles, against those of ``scipy.stats``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy import stats

from fmu_didim.base import distributions as given

X = np.concatenate([[0.0, 1e-9], np.linspace(0.01, 60, 40)])
P = np.concatenate([[1e-9], np.linspace(0.001, 0.999, 40)])
FREEDOM = [1, 2.5, 40, 1700]


@pytest.mark.parametrize(
    ("own", "law", "name", "at"),
    [
        (given.normal_sf, lambda: stats.norm, "sf", X - 20),
        (given.normal_isf, lambda: stats.norm, "isf", P),
        *((lambda x, n=n: given.chi2_sf(x, n), lambda n=n: stats.chi2(n), "sf", X) for n in FREEDOM),
        *((lambda p, n=n: given.chi2_isf(p, n), lambda n=n: stats.chi2(n), "isf", P) for n in FREEDOM),
        *((lambda p, n=n: given.chi2_ppf(p, n), lambda n=n: stats.chi2(n), "ppf", P) for n in FREEDOM),
        *((lambda x, n=n: given.f_sf(x, n, 30), lambda n=n: stats.f(n, 30), "sf", X) for n in FREEDOM),
        *((lambda p, n=n: given.f_ppf(p, n, 30), lambda n=n: stats.f(n, 30), "ppf", P) for n in FREEDOM),
        *((lambda x, n=n: given.t_sf(x, n), lambda n=n: stats.t(n), "sf", X - 20) for n in FREEDOM),
        *((lambda p, n=n: given.t_ppf(p, n), lambda n=n: stats.t(n), "ppf", P) for n in FREEDOM),
    ],
)
def test_it_is_that_of_scipy(own: Callable[[Any], Any], law: Callable[[], Any], name: str, at: np.ndarray) -> None:
    np.testing.assert_allclose(own(at), getattr(law(), name)(at), rtol=1e-12, atol=1e-300)


def test_a_sum_of_squares_below_zero_by_rounding_counts_as_zero() -> None:
    assert given.chi2_sf(-1e-18, 3) == given.f_sf(-1e-18, 2, 3) == 1.0


@pytest.mark.parametrize("first", FREEDOM)
def test_small_probabilities_of_a_ratio_of_variances_keep_their_digits(first: float) -> None:
    """``scipy.stats`` rounds one minus them."""
    small = np.geomspace(1e-14, 0.9, 40)
    np.testing.assert_allclose(given.f_sf(given.f_isf(small, first, 30), first, 30), small, rtol=1e-9)


@pytest.mark.parametrize(("first", "second"), [(1, 450), (2, 40), (38, 450)])
def test_power_is_the_tail_of_the_noncentral_distribution(first: int, second: int) -> None:
    """Also between the few values at which ``scipy.special`` fails."""
    x, noncentrality = float(given.f_isf(1e-5, first, second)), np.geomspace(1.0, 3000.0, 90)
    found = given.f_power(x, first, second, noncentrality)
    assert (np.diff(found) > -1e-9).all()
    for k in range(0, 90, 10):
        by_draws = np.mean(np.random.default_rng(k).noncentral_f(first, second, noncentrality[k], size=20_000) > x)
        assert found[k] == pytest.approx(by_draws, abs=0.015)


@pytest.mark.parametrize(("first", "second"), [(1, 1), (1, 3), (2, 2), (4, 7), (30, 200)])
def test_a_ratio_of_two_sums_of_squares_is_below_a_bound_as_often_as_it_says(first: int, second: int) -> None:
    """P(chi2_1 / n_1 < x chi2_2 / n_2) is Fisher's distribution."""
    for x in (1e-3, 0.05, 0.5, 1.0, 3.0, 20.0):
        weights = np.concatenate([np.full(first, 1 / first), np.full(second, -x / second)])
        assert given.quadratic_below_zero(weights) == pytest.approx(stats.f(first, second).cdf(x), abs=1e-9)


def test_sums_of_squares_of_one_sign_and_of_nothing() -> None:
    assert given.quadratic_below_zero(np.ones(5)) == pytest.approx(0.0, abs=1e-9)
    assert given.quadratic_below_zero(-np.ones(5)) == pytest.approx(1.0, abs=1e-9)
    assert given.quadratic_below_zero(np.zeros(3)) == 0.0
