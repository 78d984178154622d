"""The least value between two bounds is searched by the steps of SciPy, without its slow package."""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Callable

import pytest

from fmu_didim.fit.solver.bounded import least_between

FUNCTIONS: dict[str, Callable[[float], float]] = {
    "parabola": lambda x: (x - 0.3) ** 2,
    "quartic": lambda x: (x - 0.3) ** 4 + 1,
    "edge": lambda x: x,
    "other edge": lambda x: -x,
    "flat": lambda x: 1.0,
    "kink": lambda x: abs(x - 0.7123),
    "capped": lambda x: min(3 * abs(x + 0.2), 1.0),
    "two minima": lambda x: math.cos(5 * x) + 0.1 * x,
    "steep": lambda x: math.exp(8 * x) - 30 * x,
}


@pytest.mark.parametrize("function", FUNCTIONS.values(), ids=FUNCTIONS)
@pytest.mark.parametrize(("accuracy", "most"), [(1e-5, 500), (0.02, 500), (1e-9, 500), (1e-5, 7), (1e-5, 2)])
def test_places_are_those_of_scipy(function: Callable[[float], float], accuracy: float, most: int) -> None:
    from scipy.optimize import minimize_scalar

    asked, places = list[float](), list[float]()
    options = {"xatol": accuracy, "maxiter": most}
    theirs = minimize_scalar(
        lambda x: (asked.append(x), function(x))[1], bounds=(-1.0, 1.5), method="bounded", options=options
    )
    x, value = least_between(
        lambda x: (places.append(x), function(x))[1], -1.0, 1.5, accuracy=accuracy, evaluations=most
    )
    assert places == pytest.approx(asked, abs=1e-12)
    assert (x, value) == pytest.approx((theirs.x, theirs.fun), abs=1e-12)


def test_the_minimum_is_found_to_the_accuracy() -> None:
    assert least_between(FUNCTIONS["kink"], -1.0, 1.5, accuracy=1e-6)[0] == pytest.approx(0.7123, abs=1e-6)


def test_no_slow_package_is_imported() -> None:
    code = "import sys, fmu_didim.fit.solver.bounded; sys.exit('scipy.optimize' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
