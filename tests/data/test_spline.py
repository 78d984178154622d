"""Splines are those of SciPy, and need none of its slow packages."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from fmu_didim.base.errors import InputError
from fmu_didim.data.spline import CubicSpline


@pytest.mark.parametrize("count", [2, 3, 4, 5, 60])
@pytest.mark.parametrize("shape", [(), (3,), (2, 3)])
def test_values_and_derivatives_are_those_of_scipy(count: int, shape: tuple[int, ...]) -> None:
    from scipy import interpolate

    rng = np.random.default_rng(count)
    time = np.cumsum(rng.uniform(0.2, 1.8, count))
    values = rng.normal(size=(count, *shape))
    instants = np.concatenate([time, rng.uniform(time[0] - 1, time[-1] + 1, 200)])
    own, theirs = CubicSpline(time, values), interpolate.CubicSpline(time, values)
    np.testing.assert_allclose(own(instants), theirs(instants), rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(own.derivative(instants), theirs(instants, 1), rtol=1e-10, atol=1e-10)


def test_a_cubic_polynomial_is_met_within_and_beyond_the_instants() -> None:
    time = np.array([0.0, 0.3, 1.0, 1.1, 2.5, 4.0])
    polynomial = np.polynomial.Polynomial([1.0, -2.0, 0.5, 0.25])
    spline, instants = CubicSpline(time, polynomial(time)), np.linspace(-1, 5, 31)
    np.testing.assert_allclose(spline(instants), polynomial(instants), atol=1e-12)
    np.testing.assert_allclose(spline.derivative(instants), polynomial.deriv()(instants), atol=1e-12)


@pytest.mark.parametrize(
    ("time", "values", "got"),
    [
        ([0.0], [1.0], "1 rows"),
        ([0.0, 1.0, 1.0], [1.0, 2.0, 3.0], "do not increase"),
        ([0.0, 2.0, 1.0], [1.0, 2.0, 3.0], "do not increase"),
        ([0.0, np.nan, 1.0], [1.0, 2.0, 3.0], "do not increase"),
        ([0.0, 1.0, 2.0], [1.0, np.nan, 3.0], "not finite"),
    ],
)
def test_rows_without_a_spline_are_refused(time: list[float], values: list[float], got: str) -> None:
    with pytest.raises(InputError, match="no spline") as error:
        CubicSpline(np.array(time), np.array(values))
    assert got in str(error.value)


def test_no_slow_package_is_imported() -> None:
    code = "import sys, fmu_didim.data.spline; sys.exit('scipy.interpolate' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
