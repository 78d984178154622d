"""What a base model cannot absorb, table by table and many together."""

from __future__ import annotations

import numpy as np
import pytest

from fmu_didim.fit.base_projection import BLOCK, BaseProjection


@pytest.mark.parametrize("count", [0, 1, BLOCK, 2 * BLOCK + 3])
def test_many_tables_together_leave_what_each_leaves_alone(count: int) -> None:
    rng = np.random.default_rng(count)
    base = BaseProjection.of(rng.normal(size=(50, 2, 4)), np.array([1.0, 3.0]))
    tables = [rng.normal(size=(50, 2, 1 + i % 3)) for i in range(count)]
    found = list(base.rests_of(iter(tables)))
    assert len(found) == count
    for table, (weighted, rest) in zip(tables, found, strict=True):
        np.testing.assert_array_equal(weighted, base.weighted(table))
        np.testing.assert_allclose(rest, base.rest_of(base.weighted(table)), rtol=0, atol=1e-13)


def test_what_the_base_spans_leaves_nothing() -> None:
    columns = np.random.default_rng(1).normal(size=(50, 2, 4))
    ((weighted, rest),) = BaseProjection.of(columns).rests_of([columns @ np.ones((4, 1))])
    assert np.linalg.norm(rest) <= 1e-12 * np.linalg.norm(weighted)


def test_columns_of_nothing_take_nothing_away() -> None:
    """As of an effect at a shape at which another one is the same, such as a power of one beside viscous friction."""
    projection, target = BaseProjection.of(np.zeros((20, 2, 3))), np.arange(40.0)
    assert projection.basis.shape == (40, 0)
    np.testing.assert_array_equal(projection.rest_of(target), target)
