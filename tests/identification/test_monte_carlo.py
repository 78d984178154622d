"""Coverage of the intervals and efficiency of the estimate, counted over many seeds."""

from __future__ import annotations

import numpy as np
import pytest

from tests.monte_carlo import Summary, run


def check_coverage(summary: Summary) -> None:
    for coverage in (summary.coverage, summary.coverage_didim):
        assert 93.0 <= coverage.mean() <= 97.0, summary.text()
        assert coverage.min() >= 91.0, summary.text()
        assert coverage.max() <= 98.5, summary.text()


@pytest.mark.parametrize("rate_hz", [200, 10])
def test_coverage_over_200_seeds(rate_hz: int) -> None:
    summary = run(rate_hz, 200)
    check_coverage(summary)
    # 200 seeds give each empirical deviation to 5 %, their pooled value over eight parameters to about 2 %.
    assert abs(np.sqrt((summary.efficiency**2).mean()) - 1) <= 0.07, summary.text()


@pytest.mark.slow
@pytest.mark.parametrize("rate_hz", [200, 10])
def test_coverage_and_efficiency_over_1000_seeds(rate_hz: int) -> None:
    summary = run(rate_hz, 1000)
    check_coverage(summary)
    assert (np.abs(summary.efficiency - 1) <= 0.07).all(), summary.text()
