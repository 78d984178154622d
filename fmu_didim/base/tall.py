"""Tall tables, of far more rows than columns, a part of the rows at a time: a long log has many, and copies of all of
them at once would take the memory of the machine."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

ROWS = 8192
"""[rows] Of a table at a time: they stay in the caches of the processor."""

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
        r = np.asarray(np.linalg.qr(np.concatenate([r, block]), mode="r"))
    return r


def triangle_beside(table: Array, right: Array) -> tuple[Array, Array, float]:
    """R (r, m) and Q'b (r,) of a table Q R (N, m) beside a column b (N,), and the sum of squares that is left of b.

    r is m, or N where there are fewer rows.
    """
    count = table.shape[1]
    both = (np.column_stack(block) for block in zip(in_blocks(table), in_blocks(right), strict=True))
    r = triangle_by_parts(both, count + 1)
    return r[:count, :count], r[:count, count], float(np.sum(r[count:, count] ** 2))
