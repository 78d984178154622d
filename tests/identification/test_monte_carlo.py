"""Coverage of the intervals and efficiency of the estimate, counted over many seeds."""

from __future__ import annotations

import numpy as np
import pytest

from tests.tools.monte_carlo import Design, Summary, run


def check_coverage(summary: Summary, *, least: float = 93.0) -> None:
    for coverage in (summary.coverage, summary.coverage_didim):
        assert least <= coverage.mean() <= 97.0, summary.text()
        assert coverage.min() >= 91.0, summary.text()
        assert coverage.max() <= 98.5, summary.text()


@pytest.mark.gate
@pytest.mark.parametrize("rate_hz", [200, 10])
def test_coverage_over_200_seeds(rate_hz: int) -> None:
    summary = run(Design(rate_hz), 200)
    check_coverage(summary)
    # 200 seeds give each empirical deviation to 5 %, their pooled value over eight parameters to about 2 %.
    assert abs(np.sqrt((summary.efficiency**2).mean()) - 1) <= 0.07, summary.text()


@pytest.mark.gate
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
    check_coverage(summary, least=92.0)


@pytest.mark.slow
@pytest.mark.parametrize("rate_hz", [200, 10])
def test_coverage_and_efficiency_over_1000_seeds(rate_hz: int) -> None:
    summary = run(Design(rate_hz), 1000)
    check_coverage(summary)
    assert (np.abs(summary.efficiency - 1) <= 0.07).all(), summary.text()
