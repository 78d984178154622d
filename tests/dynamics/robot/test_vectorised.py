"""Functions over many points by numpy: the same values as CasADi's own evaluation."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest

from fmu_didim.dynamics.robot import vectorised
from fmu_didim.dynamics.robot.vectorised import Vectorised

COUNT = 40
RNG = np.random.default_rng(5)
ONE = [
    ca.fabs, ca.sqrt, ca.sin, ca.cos, ca.tan, ca.exp, ca.log, ca.log1p, ca.expm1, ca.tanh, ca.sinh, ca.cosh, ca.floor,
    ca.ceil, ca.sign, ca.atan, lambda x: -x, lambda x: x**2, lambda x: 1 / x, lambda x: 2 * x, lambda x: x**2.5,
    lambda x: ca.asin(x / 10), lambda x: ca.acos(x / 10), ca.logic_not,
]  # fmt: skip
TWO = [
    lambda x, y: x + y, lambda x, y: x - y, lambda x, y: x * y, lambda x, y: x / y, lambda x, y: x**y, ca.fmin, ca.fmax,
    ca.atan2, ca.fmod, ca.copysign, ca.hypot, ca.le, ca.lt, ca.eq, ca.ne, lambda x, y: ca.logic_and(x > 1, y > 1),
    lambda x, y: ca.logic_or(x > 1, y > 1), lambda x, y: ca.if_else(x > y, x * y, x - 3 * y),
]  # fmt: skip


def expected(function: ca.Function, x: np.ndarray, y: float) -> np.ndarray:
    return np.array([function(a, y).full().ravel() for a in x])


@pytest.mark.parametrize("index", range(len(ONE) + len(TWO)))
def test_every_operation_gives_what_casadi_gives(index: int) -> None:
    x, y = ca.SX.sym("x", 2), ca.SX.sym("y")
    made = ONE[index](x[0]) if index < len(ONE) else TWO[index - len(ONE)](x[0], y)
    function = ca.Function("f", [x, y], [ca.densify(ca.vertcat(made, x[1] + 1.5, 7.0))])
    points = RNG.uniform(0.2, 3.0, (COUNT, 2))
    points[::3] = np.round(points[::3] + 0.5)
    own = Vectorised(function)
    assert own.is_known
    found = own(COUNT, [points.T, [2.0]])
    assert found.shape == (COUNT, 3)
    assert found == pytest.approx(expected(function, points, 2.0), rel=1e-14, abs=1e-14, nan_ok=True)


def test_an_operation_that_is_not_known_is_left_to_casadi(monkeypatch: pytest.MonkeyPatch) -> None:
    x, y = ca.SX.sym("x", 2), ca.SX.sym("y")
    function = ca.Function("f", [x, y], [ca.vertcat(ca.erf(x[0]) * y, ca.sin(x[1]))])
    own = Vectorised(function)
    assert not own.is_known
    assert ca.OP_ERF not in vectorised._OPERATIONS
    points = RNG.uniform(-2, 2, (COUNT, 2))
    assert own(COUNT, [points.T, [3.0]]) == pytest.approx(expected(function, points, 3.0), rel=1e-14)


@pytest.mark.parametrize("points", [3, 2 * vectorised.TOGETHER + 5])
@pytest.mark.parametrize("special", [ca.sin, ca.erf], ids=["known", "left to CasADi"])
def test_some_elements_are_those_of_all(special: Callable[[ca.SX], ca.SX], points: int) -> None:
    """In the order that is asked for, and no instruction that the others alone need."""
    x, y = ca.SX.sym("x", 2), ca.SX.sym("y")
    shared = ca.cos(x[0]) * y
    made = [shared + 1, special(x[1]) * shared, ca.exp(x[1]) - y, ca.SX(7.0)]
    own = Vectorised(ca.Function("f", [x, y], [ca.densify(ca.vertcat(*made))]))
    given = [RNG.uniform(-1, 1, (points, 2)).T, [3.0]]
    whole = own(points, given)
    for elements in ([2], [3, 0], [1, 2, 0]):
        parts = list(own.blocks(points, given, elements))
        np.testing.assert_array_equal(np.concatenate([part for _, part in parts], axis=1), whole[:, elements].T)
        assert [part.stop - part.start for part, _ in parts] == [block.shape[1] for _, block in parts]
    if own.is_known:
        kept = vectorised._needed_for(own._program, [2])
        assert ca.OP_COS not in [one.operation for one in kept]
        assert len(kept) < len(own._program) / 2


def test_functions_of_matrices_are_left_to_casadi() -> None:
    x, y = ca.MX.sym("x", 2), ca.MX.sym("y")
    function = ca.Function("f", [x, y], [ca.sin(x) * y])
    points = RNG.uniform(-2, 2, (COUNT, 2))
    assert Vectorised(function)(COUNT, [points.T, [3.0]]) == pytest.approx(expected(function, points, 3.0), rel=1e-14)
