"""Which parameters are not needed: by the F-test of linear regression, whose reduced fit is known exactly."""

from __future__ import annotations

import numpy as np
import pytest

from fmu_didim.data.signals import Array
from fmu_didim.fit.exploration.essential import Elimination, as_if_zero, eliminated, f_of_zero

FREEDOM = 200.0


def regression(seed: int = 0, rows: int = 60, truth: tuple[float, ...] = (1.0, 0.0, 2.0, 0.0)) -> tuple[Array, Array]:
    rng = np.random.default_rng(seed)
    table = rng.normal(size=(rows, len(truth))) * np.array([1.0, 1e3, 1e-3, 10.0])[: len(truth)]
    return table, table @ np.array(truth) + 0.5 * rng.normal(size=rows)


def solved(table: Array, right: Array, scale: float | None = None) -> tuple[Array, Array, float]:
    """Values, covariance and the sum of squares that they leave."""
    value = np.linalg.lstsq(table, right, rcond=None)[0]
    squares = float(np.sum((right - table @ value) ** 2))
    variance = scale or squares / (len(right) - table.shape[1])
    return value, variance * np.linalg.inv(table.T @ table), squares


@pytest.mark.parametrize("zero", [[1], [3, 1], [0, 2], []])
def test_what_is_left_moves_and_is_known_as_if_fitted_anew(zero: list[int]) -> None:
    table, right = regression()
    value, covariance, squares = solved(table, right)
    variance = squares / (len(right) - 4)
    kept = [i for i in range(4) if i not in zero]
    less, known, _ = solved(table[:, kept], right, variance)
    found, rest = as_if_zero(value, covariance, zero)
    assert found[kept] == pytest.approx(less, rel=1e-9)
    assert rest[np.ix_(kept, kept)] == pytest.approx(known, rel=1e-8)
    assert not found[zero].any()
    assert not rest[zero].any()


@pytest.mark.parametrize("zero", [[1], [3, 1], [0, 2, 3]])
def test_f_is_that_of_the_sums_of_squares(zero: list[int]) -> None:
    table, right = regression()
    value, covariance, squares = solved(table, right)
    more = solved(np.delete(table, zero, axis=1), right)[2]
    by_squares = (more - squares) / len(zero) / (squares / (len(right) - 4))
    assert f_of_zero(value, covariance, zero) == pytest.approx(by_squares, rel=1e-8)


def judged(
    values: list[float], correlation: dict[tuple[int, int], float] | None = None, **options: object
) -> Elimination:
    """The elimination of values in units of their standard deviations."""
    covariance = np.eye(len(values))
    for (i, j), r in (correlation or {}).items():
        covariance[i, j] = covariance[j, i] = r
    chosen = {"candidates": range(len(values)), "problem": lambda v: "", **options}
    return eliminated(np.array(values), covariance, FREEDOM, **chosen)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("values", "options", "left_out"),
    [
        pytest.param([5.0, 0.1, -0.8], {}, (1, 2), id="small ones go, the smallest first"),
        pytest.param([5.0, 3.0, -4.0], {}, (), id="all are needed"),
        pytest.param([0.1, 0.1, 0.1], {}, (0, 1, 2), id="none is needed"),
        pytest.param([5.0, 1.98], {}, (), id="just significant"),
        pytest.param([5.0, 1.96], {}, (1,), id="just not"),
        pytest.param([0.5, 0.6], {"correlation": {(0, 1): -0.99}}, (0,), id="two that hide each other: one stays"),
        pytest.param([1.6, 1.6, 1.6, 1.6, 1.6, 1.6], {}, (0, 1, 2), id="too many small ones are much together"),
        pytest.param([0.0] * 20 + [3.2], {}, tuple(range(20)), id="many that are zero hide no other"),
        pytest.param([0.1, 0.2, 9.0], {"candidates": [1, 2]}, (1,), id="candidates alone"),
        pytest.param([0.1, 0.2], {"problem": lambda v: "no" if v[0] == 0 else ""}, (1,), id="the model needs it"),
    ],
)
def test_what_is_left_out(values: list[float], options: dict[str, object], left_out: tuple[int, ...]) -> None:
    assert judged(values, **options).left_out == left_out  # type: ignore[arg-type]


def test_the_last_one_of_many_is_tested_with_all_of_them() -> None:
    """Three of 1.6 sigma have F = 2.56 below 2.65, four would be above 2.42; each alone is nothing."""
    found = judged([1.6] * 6)
    assert found.f == pytest.approx(2.56)
    assert found.limit == pytest.approx(2.65, abs=0.005)
    assert found.p_value == pytest.approx(0.056, abs=0.001)


def test_what_the_model_needs_is_told_and_does_not_stop_the_others() -> None:
    found = judged([0.1, 0.2, 0.3], problem=lambda v: "no machine" if v[1] == 0 else "")
    assert found.left_out == (0, 2)
    assert dict(found.needed) == {1: "no machine"}
    assert found.values.tolist() == pytest.approx([0.0, 0.2, 0.0])


def test_a_value_that_is_known_is_needed() -> None:
    covariance = np.diag([1.0, 0.0])
    found = eliminated(np.array([0.1, 0.1]), covariance, FREEDOM, [0, 1], lambda v: "")
    assert found.left_out == (0,)


def test_zeros_go_and_others_stay_over_many_draws() -> None:
    """Six true zeros of ten: beside four at six sigma or more, one of these is never missed."""
    truth, gone, wrong = np.array([6.0, 7.0, 8.0, 20.0] + [0.0] * 6), 0, 0
    for seed in range(200):
        rng = np.random.default_rng(seed)
        root = np.linalg.cholesky(0.6 * np.eye(10) + 0.4)
        out = eliminated(truth + root @ rng.normal(size=10), root @ root.T, FREEDOM, range(10), lambda v: "").left_out
        gone += sum(place >= 4 for place in out)
        wrong += sum(place < 4 for place in out)
    assert wrong == 0
    assert gone / (6 * 200) > 0.9
