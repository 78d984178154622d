"""Cubic splines against those of SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from fmu_didim.data.spline import cubic_spline


@pytest.mark.parametrize("count", [2, 3, 4, 5, 6, 200])
@pytest.mark.parametrize("even", [True, False])
def test_it_is_the_spline_of_scipy(count: int, even: bool) -> None:
    """At its places, between them, and beyond both ends."""
    rng = np.random.default_rng(count)
    places = np.arange(count) * 0.1 - 3 if even else np.sort(rng.uniform(-3, 3, count))
    values = rng.normal(size=(count, 3)).cumsum(axis=0)
    step = places[1] - places[0]
    at = np.concatenate([places, rng.uniform(places[0], places[-1], 500), [places[0] - step, places[-1] + step]])
    wanted = CubicSpline(places, values)(at)
    np.testing.assert_allclose(cubic_spline(places, values, at), wanted, rtol=1e-9, atol=1e-9 * np.abs(wanted).max())
