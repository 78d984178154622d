"""Cubic splines through the rows of a table.

``scipy.interpolate`` has the same ones, but importing it takes as long as several simulations of a robot.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import solve_banded

from fmu_didim.base.errors import InputError
from fmu_didim.data.signals import Array

FEWEST = 2
"""[rows] A spline goes through, as a straight line; through three it is a parabola."""


@dataclass(frozen=True, eq=False)
class CubicSpline:
    """The cubic spline through values (N, ...) at instants (N,) that increase, without a knot at the second instant
    and the last but one (de Boor, A Practical Guide to Splines, IV); beyond its ends by its first and last polynomial.

    From the slopes s at the instants, with h_i = t_i+1 - t_i and d_i = (y_i+1 - y_i) / h_i:

        h_i s_i-1 + 2 (h_i-1 + h_i) s_i + h_i-1 s_i+1 = 3 (h_i d_i-1 + h_i-1 d_i)
        y(t_i + x) = y_i + x (s_i + x ((3 d_i - 2 s_i - s_i+1) / h_i + x (s_i + s_i+1 - 2 d_i) / h_i^2))

    Raises:
        InputError: there are fewer than two instants, they do not increase, or a value is not finite.
    """

    time: Array
    values: Array

    def __post_init__(self) -> None:
        reason = ""
        if self.time.size < FEWEST:
            reason = f"{self.time.size} rows"
        elif not (np.diff(self.time) > 0).all():
            reason = "instants that do not increase"
        elif not np.isfinite(self.values).all():
            reason = "values that are not finite"
        if reason:
            raise InputError(
                "There is no spline through these rows.", got=reason,
                next_step=f"Give at least {FEWEST} rows of finite values at instants that increase.",
            )  # fmt: skip

    def __call__(self, instants: Array) -> Array:
        """(K, ...) values at instants (K,)."""
        y, s, square, cube, x = self._at(np.asarray(instants, dtype=np.float64))
        return np.asarray(y + s * x + square * (x * x) + cube * (x * x * x))

    def derivative(self, instants: Array) -> Array:
        """(K, ...) first derivatives at instants (K,)."""
        _, s, square, cube, x = self._at(np.asarray(instants, dtype=np.float64))
        return np.asarray(s + square * x * 2 + cube * (x * x) * 3)

    def _at(self, instants: Array) -> tuple[Array, Array, Array, Array, Array]:
        """The coefficients of the polynomials (K, ...) at instants (K,), and the time in each of them."""
        place = np.clip(np.searchsorted(self.time, instants, side="right") - 1, 0, self.time.size - 2)
        square, cube = self._coefficients
        x = (instants - self.time[place]).reshape(-1, *[1] * (self.values.ndim - 1))
        return self.values[place], self._slopes[place], square[place], cube[place], x

    @cached_property
    def _steps(self) -> tuple[Array, Array]:
        """(N - 1, 1, ...) steps between the instants, and (N - 1, ...) slopes of the straight lines."""
        steps = np.diff(self.time).reshape(-1, *[1] * (self.values.ndim - 1))
        return steps, np.diff(self.values, axis=0) / steps

    @cached_property
    def _coefficients(self) -> tuple[Array, Array]:
        """(N - 1, ...) of the square and of the cube of the time in each polynomial."""
        (h, d), s = self._steps, self._slopes
        bend = (s[:-1] + s[1:] - 2 * d) / h
        return (d - s[:-1]) / h - bend, bend / h

    @cached_property
    def _slopes(self) -> Array:
        """(N, ...) at the instants."""
        (h, d), count = self._steps, self.time.size
        if count == FEWEST:
            return np.concatenate([d, d])
        if count == FEWEST + 1:  # both ends ask for the same: a parabola
            middle = (h[1:] * d[:1] + h[:1] * d[1:]) / (h[:1] + h[1:])
            return np.concatenate([2 * d[:1] - middle, middle, 2 * d[1:] - middle])
        steps, right = h.reshape(-1), np.empty_like(self.values, dtype=np.float64)
        bands = np.zeros((3, count))
        bands[0, 2:], bands[1, 1:-1], bands[2, :-2] = steps[:-1], 2 * (steps[:-1] + steps[1:]), steps[1:]
        right[1:-1] = 3 * (h[1:] * d[:-1] + h[:-1] * d[1:])
        # The third derivative does not jump at the second instant, nor at the last but one.
        widths = self.time[2] - self.time[0], self.time[-1] - self.time[-3]
        for end, within, row, (a, b), both in zip((0, -1), (1, -2), (0, 2), ((0, 1), (-1, -2)), widths, strict=True):
            bands[1, end], bands[row, within] = steps[b], both
            right[end] = ((steps[a] + 2 * both) * steps[b] * d[a] + steps[a] ** 2 * d[b]) / both
        return np.asarray(solve_banded((1, 1), bands, right.reshape(count, -1)).reshape(right.shape))


def derivative(time: Array, values: Array) -> Array:
    """Derivative of signals (N, ...) at their own instants (N,), by a cubic spline through them."""
    return CubicSpline(time, values).derivative(time)
