"""Tall tables, of far more rows than columns, a part of the rows at a time: a long log has many, and copies of all of
them at once would take the memory of the machine."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

ROWS = 8192
"""[rows] Of a table at a time: they stay in the caches of the processor."""
FACTORISED = 1024
"""[rows] Of them that are factorised at a time: of sixty columns, half a megabyte."""

Array = NDArray[np.float64]


def in_blocks(table: Array) -> Iterator[Array]:
    """(b, ...) rows of a table (N, ...), some at a time."""
    return (table[first : first + ROWS] for first in range(0, len(table), ROWS))


def with_rows(table: Array, blocks: Iterable[Array]) -> Iterator[tuple[Array, Array]]:
    """Blocks (b, m) of rows, with those of a table (N, ...) before each."""
    first = 0
    for block in blocks:
        yield table[first : first + len(block)], block
        first += len(block)


def triangle_by_parts(blocks: Iterable[Array], count: int) -> Array:
    """Upper triangle R (min(N, m), m) with R'R = T'T of a table T (N, m) of so many columns, by orthogonal
    factorisations of some rows (b, m) at a time below the triangle of those before (Demmel et al., SIAM Journal on
    Scientific Computing 34 (2012))."""
    r = np.zeros((0, count))
    for block in blocks:
        for first in range(0, len(block), FACTORISED):
            r = _triangle(r, block[first : first + FACTORISED])
    return r


def _triangle(above: Array, rows: Array) -> Array:
    """That of some rows (b, m) below another triangle (r, m), column by column as LAPACK works: in half of the time of
    :func:`numpy.linalg.qr`, which turns the table over twice."""
    table = np.empty((len(above) + len(rows), above.shape[1]), order="F")
    table[: len(above)], table[len(above) :] = above, rows
    if not table.size:
        return table[: above.shape[1]]
    packed = lapack.dgeqrf(table, overwrite_a=True)[0]
    return np.triu(packed[: above.shape[1]])


def triangle_beside(table: Array, right: Array) -> tuple[Array, Array, float]:
    """R (r, m) and Q'b (r,) of a table Q R (N, m) beside a column b (N,), and the sum of squares that is left of b.

    r is m, or N where there are fewer rows.
    """
    count = table.shape[1]
    both = (np.column_stack(block) for block in zip(in_blocks(table), in_blocks(right), strict=True))
    r = triangle_by_parts(both, count + 1)
    return r[:count, :count], r[:count, count], float(np.sum(r[count:, count] ** 2))
