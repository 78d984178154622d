"""Triangles of tall tables, made of a part of the rows at a time."""

import numpy as np
import pytest

from fmu_didim.base.tall import FACTORISED, in_blocks, triangle_beside, triangle_by_parts


@pytest.mark.parametrize(
    ("rows", "columns"), [(0, 3), (2, 5), (5, 5), (7, 0), (40, 3), (3 * FACTORISED + 1, 6), (10 * FACTORISED, 2)]
)
def test_a_triangle_has_the_products_of_its_table(rows, columns):
    table = np.random.default_rng(rows).normal(size=(rows, columns)) * np.logspace(0, 6, columns)
    r = triangle_by_parts(in_blocks(table), columns)
    assert r.shape == (min(rows, columns), columns)
    assert np.array_equal(r, np.triu(r))
    products = table.T @ table
    size = np.sqrt(np.outer(products.diagonal(), products.diagonal()))
    assert np.all(np.abs(r.T @ r - products) <= 1e-13 * rows * size)


def test_columns_that_are_nearly_dependent_are_told_apart():
    """By an orthogonal factorisation to rounding, where products of the columns would know nothing of it."""
    rng = np.random.default_rng(1)
    first, other = rng.normal(size=(2, 2 * FACTORISED + 3))
    r = triangle_by_parts(in_blocks(np.column_stack([first, first + 1e-11 * other])), 2)
    along = other - first * (first @ other) / (first @ first)
    assert abs(r[1, 1]) == pytest.approx(1e-11 * np.linalg.norm(along), rel=1e-3)


def test_a_table_is_left_as_it_was():
    table = np.asfortranarray(np.random.default_rng(2).normal(size=(20, 3)))
    before = table.copy()
    triangle_by_parts([table], 3)
    assert np.array_equal(table, before)


def test_a_triangle_beside_a_column_solves_the_least_squares_problem():
    rng = np.random.default_rng(3)
    table, right = rng.normal(size=(2 * FACTORISED, 4)), rng.normal(size=2 * FACTORISED)
    r, along, left = triangle_beside(table, right)
    values, squares, *_ = np.linalg.lstsq(table, right, rcond=None)
    assert np.allclose(np.linalg.solve(r, along), values, rtol=1e-12)
    assert left == pytest.approx(float(squares[0]), rel=1e-12)
