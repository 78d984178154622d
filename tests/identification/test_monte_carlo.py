"""Coverage of the intervals and efficiency of the estimate, counted over many seeds."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom

from tests.tools.monte_carlo import Design, Summary, run

BY_CHANCE = 1e-4
"""[1] Probability with which the coverage of one parameter leaves its bounds though it is 95 %: 32 are looked at."""


def check_coverage(summary: Summary, seeds: int, *, least: float = 93.0) -> None:
    lowest, highest = (100 * binom.ppf(share, seeds, 0.95) / seeds for share in (BY_CHANCE, 1 - BY_CHANCE))
    for coverage in (summary.coverage, summary.coverage_didim):
        assert least <= coverage.mean() <= 97.0, summary.text()
        assert coverage.min() >= lowest, summary.text()
        assert coverage.max() <= highest, summary.text()


@pytest.mark.slow
@pytest.mark.parametrize("rate_hz", [pytest.param(200, marks=pytest.mark.slow), 10])
def test_coverage_over_200_seeds(rate_hz: int) -> None:
    summary = run(Design(rate_hz), 200)
    check_coverage(summary, 200)
    # 200 seeds give each empirical deviation to 5 %, their pooled value over eight parameters to about 2 %.
    assert abs(np.sqrt((summary.efficiency**2).mean()) - 1) <= 0.07, summary.text()


@pytest.mark.slow
def test_coverage_with_coloured_noise() -> None:
    """Half of the power remembers 50 ms; with white noise in mind 75 % would be inside."""
    summary = run(Design(50, coloured=True), 60)
    assert 92.0 <= summary.coverage.mean() <= 97.0, summary.text()


@pytest.mark.slow
@pytest.mark.parametrize("coloured", [False, True])
@pytest.mark.parametrize(
    ("rate_hz", "low_pass_hz"), [(200, None), (50, None), (20, None), (10, None), (4, None), (200, 4.0)]
)
def test_coverage_whatever_the_colour(rate_hz: int, low_pass_hz: float | None, coloured: bool) -> None:
    summary = run(Design(rate_hz, coloured, low_pass_hz), 200)
    check_coverage(summary, 200, least=92.0)


@pytest.mark.slow
@pytest.mark.parametrize("rate_hz", [200, 10])
def test_coverage_and_efficiency_over_1000_seeds(rate_hz: int) -> None:
    summary = run(Design(rate_hz), 1000)
    check_coverage(summary, 1000)
    assert (np.abs(summary.efficiency - 1) <= 0.07).all(), summary.text()
