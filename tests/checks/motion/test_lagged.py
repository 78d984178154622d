"""What a colour leaves of columns by sums over their lags: the same as of a table of it."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from scipy.signal import lfilter

from fmu_didim.base.tall import ROWS
from fmu_didim.checks.motion import colour, lagged
from fmu_didim.checks.motion.colour import Colour, Columns, Logs, Regression, orthonormal
from fmu_didim.checks.motion.lagged import LagSums, Run
from fmu_didim.fit.uncertainty import stretches

RNG = np.random.default_rng
WHOLE = (np.arange(900) / 100.0,)
WITH_A_GAP = (np.delete(np.arange(900) / 100.0, slice(300, 420)),)
TWO_RATES = (np.arange(700) / 100.0, np.arange(500) / 20.0)
LONG = (np.arange(2 * ROWS + 40) / 100.0,)
ORDERS = (0, 1, 3)


def rows_of(table: np.ndarray, first: int, last: int) -> np.ndarray:
    return table[first:last]


@pytest.mark.parametrize("order", [*ORDERS, 7])
@pytest.mark.parametrize("sizes", [[60], [20, 9, 33], [ROWS + 20]])
def test_the_sums_are_those_over_what_an_autoregression_leaves(sizes: list[int], order: int) -> None:
    """Of each run without its first samples, whatever lies beside it."""
    lags, rng, expected = 7, RNG(1), np.zeros((3, 3))
    parts, a = [rng.normal(size=(size, 3)) for size in sizes], rng.normal(size=order)
    for part in parts:
        left = part[lags:] - sum(c * part[lags - k : len(part) - k] for k, c in enumerate(a, start=1))
        expected += left.T @ left
    sums = LagSums([Run(partial(rows_of, part), len(part)) for part in parts], 3)
    found = next(found for found in (sums.products(a, lags) for _ in range(10)) if found is not None)
    np.testing.assert_allclose(found[0], expected, rtol=1e-10, atol=1e-10)
    assert (found[1] >= expected.diagonal()).all()
    few = RNG(2).normal(size=max(order - 1, 0))  # of an order that needs no further sums
    assert sums.products(few, lags) is not None


def test_sums_are_made_once_they_have_been_missed_often_enough() -> None:
    sums = LagSums([Run(partial(rows_of, np.ones((60, 2))), 60)], 2)
    asked = [sums.products(np.zeros(5), 5) is not None for _ in range(5)]
    first = int(np.ceil((5 + 1) / lagged.SAVED)) - 1
    assert asked == [k >= first for k in range(5)]


@pytest.mark.parametrize("times", [WHOLE, WITH_A_GAP, TWO_RATES, LONG], ids=["whole", "gap", "rates", "long"])
@pytest.mark.parametrize("memory", [0, 2])
def test_a_regression_is_that_of_the_whitened_table(
    times: tuple[np.ndarray, ...], memory: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the sums of the first columns, and by the table where these are not known."""
    logs, rng = Logs(tuple(stretches(times))), RNG(3)
    samples = sum(time.size for time in times)
    first = orthonormal(np.cumsum(rng.normal(size=(samples, 5)), axis=0))
    slow, coloured = np.cumsum(rng.normal(size=samples)), lfilter([1.0], [1.0, -0.7], rng.normal(size=samples))
    further = np.column_stack([slow, coloured])
    columns = Columns(logs, first).beside(further)
    coefficients = tuple(np.array([0.9, -0.3, 0.1])[: 3 - k] for k in range(len(logs.pasts)))
    own = Colour(memory, coefficients, (0.5, 2.0)[: len(coefficients)], np.inf)
    table = columns.whitened(own)
    values = np.asarray(np.linalg.lstsq(table[:, :-1], table[:, -1], rcond=None)[0], dtype=float)
    length = np.linalg.norm(table[:, -1] - table[:, :-1] @ values)
    monkeypatch.setattr(colour, "LONG_RUN", 10)
    for saved in (0, 100):
        monkeypatch.setattr(lagged, "SAVED", saved)
        regression = Regression.of(columns, range(7), memory)
        found = regression.by(own)
        np.testing.assert_allclose(found[0], values, rtol=1e-7, atol=1e-9)
        assert found[1] == pytest.approx(length, rel=1e-9)
        sums = columns.first.shared(memory)._sums
        assert all(bool(len(one._sums)) is bool(saved) for one in sums.values())
    left = regression.rest(values)
    np.testing.assert_allclose(
        left, columns.taken(memory, range(7)).of_rows(slice(0, samples)) @ [*-values, 1.0], atol=1e-9
    )


@pytest.mark.parametrize("at", [0, -1, 450])
def test_a_sample_that_is_far_larger_does_not_blur_what_is_left(at: int) -> None:
    """At an end it is no part of what is compared, but of the sums, which would drown the rest in rounding."""
    logs, rng = Logs(tuple(stretches(WHOLE))), RNG(4)
    first, further = rng.normal(size=(900, 3)), rng.normal(size=(900, 1))
    first[at, 1] = 1e9
    columns = Columns(logs, first).beside(further)
    own = Colour(0, (np.array([0.9, -0.3]),), (1.0,), np.inf)
    table = columns.whitened(own)
    values = np.linalg.lstsq(table[:, :-1], table[:, -1], rcond=None)[0]
    for _ in range(4):
        found, length = Regression.of(columns, range(4), 0).by(own)
        np.testing.assert_allclose(found, values, rtol=1e-6, atol=1e-12)
        assert length == pytest.approx(np.linalg.norm(table[:, -1] - table[:, :-1] @ values), rel=1e-9)
