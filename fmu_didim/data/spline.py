"""A cubic spline, without :mod:`scipy.interpolate`: importing that takes as long as a tenth of an identification."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

Array = NDArray[np.float64]


def cubic_spline(places: Array, values: Array, at: Array) -> Array:
    """(M, n) at places (M,) the cubic spline through values (K, n) at increasing places (K,), K > 1, whose third
    derivative does not jump at the second and the last but one of these; beyond the ends it goes on.

    Source: C. de Boor, A Practical Guide to Splines, 1978, chapter IV ("not a knot").
    """
    steps = np.diff(places)[:, None]
    rises = np.diff(values, axis=0) / steps
    slopes = _slopes(steps, rises)
    k = np.clip(np.searchsorted(places, at, side="right") - 1, 0, len(steps) - 1)
    x, third = (at - places[k])[:, None], ((slopes[:-1] + slopes[1:] - 2 * rises) / steps)[k]
    second = ((rises - slopes[:-1]) / steps)[k] - third
    return np.asarray(values[k] + x * (slopes[k] + x * (second + x * third / steps[k])))


def _slopes(steps: Array, rises: Array) -> Array:
    """(K, n) of the spline at its places, by the lengths (K - 1, 1) and slopes (K - 1, n) of the lines between them."""
    count, ends = len(steps) + 1, steps[:-1] + steps[1:]
    if count == 2:
        return np.repeat(rises, 2, axis=0)
    diagonals, right = np.zeros((3, count)), np.empty((count, rises.shape[1]))
    diagonals[0, 2:], diagonals[1, 1:-1], diagonals[2, :-2] = steps[:-1, 0], 2 * ends[:, 0], steps[1:, 0]
    right[1:-1] = 3 * (steps[1:] * rises[:-1] + steps[:-1] * rises[1:])
    if count == 3:  # both ends ask for the same: a parabola
        diagonals[0, 1] = diagonals[1, 0] = diagonals[1, 2] = diagonals[2, 1] = 1.0
        right[0], right[2] = 2 * rises[0], 2 * rises[1]
    else:
        diagonals[1, 0], diagonals[0, 1] = steps[1, 0], ends[0, 0]
        diagonals[1, -1], diagonals[2, -2] = steps[-2, 0], ends[-1, 0]
        right[0] = ((steps[0] + 2 * ends[0]) * steps[1] * rises[0] + steps[0] ** 2 * rises[1]) / ends[0]
        right[-1] = (steps[-1] ** 2 * rises[-2] + (2 * ends[-1] + steps[-1]) * steps[-2] * rises[-1]) / ends[-1]
    return np.asarray(linalg.solve_banded((1, 1), diagonals, right))
