"""A torque that is a free function of one variable: the form of something that has no name yet."""

from __future__ import annotations

from abc import abstractmethod
from itertools import pairwise
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from fmu_didim.data.signals import Array
from fmu_didim.dynamics.effects.base import TorqueEffect
from fmu_didim.dynamics.effects.joint import Parameter, Search, Surroundings, Values

LETTERS = "abcdefghijklmnopqrst"
"""One of each spline: twenty follow what is a seventeenth of the range wide. A detent a tenth of it wide is missed by
1 % of its height, by 7 % with twelve."""


class Curve(TorqueEffect):
    """tau_e = sum_k c_k B(17 (x - from)/(to - from) + 1 - k), k = 0 to 19, of a variable x of the motion.

    B(u) = (max(0, 2 - |u|)^3 - 4 max(0, 1 - |u|)^3)/6 is the cubic B-spline with knots one apart: the curve and its
    slope and curvature are continuous, and all amplitudes equal give a constant. Beyond the range ``from``, ``to`` it
    stays as at its end. The amplitudes c_k are torques, in N.m (N).
    """

    class_name = "curve"
    source = "de Boor: A practical guide to splines, 1978"
    signature = "Residual that is a smooth function of one variable and no effect of the catalogue."
    is_form: ClassVar[bool] = True
    symbol: ClassVar[str]
    """Of the variable, in the names of its parameters."""
    variable: ClassVar[str]
    """In words."""

    @abstractmethod
    def along(self, at: Surroundings, shapes: Values) -> ca.SX:
        """The variable x."""

    def ends_on(self, at: Surroundings) -> tuple[float, float]:
        """The range of x on a motion, of which ``at`` has arrays."""
        x = np.asarray(self.along(at, {}))
        return float(x.min()), float(x.max())

    def columns(self, at: Surroundings, shapes: Values) -> tuple[ca.SX, ...]:
        return _splines(self.along(at, shapes), *self.ends(shapes))

    def shape_values(self, low: float, high: float) -> dict[str, float]:
        """Its shapes for a range."""
        return {f"{self.symbol}from": low, f"{self.symbol}to": high}

    def basis(self, x: Array, low: float, high: float) -> Array:
        """(K, m) the splines at values of the variable (K,), for a range."""
        return np.hstack([column.full() for column in _splines(ca.DM(x), low, high)])

    def ends(self, shapes: Values) -> tuple[ca.SX, ca.SX]:
        """Begin and end of its range."""
        return shapes[f"{self.symbol}from"], shapes[f"{self.symbol}to"]

    def largest(self, parameters: Values) -> ca.SX:
        """A bound of its size."""
        return ca.mmax(ca.fabs(ca.vertcat(*self._sizes(parameters))))

    def _sizes(self, parameters: Values) -> list[ca.SX]:
        return [parameters[f"c{self.symbol}{letter}"] for letter in LETTERS]

    def steepest(self, parameters: Values, shapes: Values) -> ca.SX:
        """A bound of its slope."""
        low, high = self.ends(shapes)
        steps = [ca.fabs(b - a) for a, b in pairwise(self._sizes(parameters))]
        return ca.mmax(ca.vertcat(*steps)) * (len(LETTERS) - 3) / (high - low)


def curve_parameters(symbol: str) -> tuple[Parameter, ...]:
    """The amplitudes of a curve of this variable."""
    return tuple(Parameter(f"c{symbol}{x}", "torque", f"amplitude {x} of the curve") for x in LETTERS)


def curve_ends(symbol: str, unit: str, low: float, high: float) -> tuple[Parameter, ...]:
    """The shapes of a curve: the ends of its range, which are those of a motion."""
    known = Search(low, high, 2, logarithmic=False, cost=0.0)
    return (
        Parameter(f"{symbol}from", unit, "begin of the range of the curve", low, search=known),
        Parameter(f"{symbol}to", unit, "end of the range of the curve", high, search=known),
    )


def _splines(x: Any, low: Any, high: Any) -> tuple[Any, ...]:
    """All splines at x, expressions or numbers, over a range."""
    place = (len(LETTERS) - 3) * (ca.fmin(ca.fmax(x, low), high) - low) / (high - low) + 1
    away = [ca.fabs(place - k) for k in range(len(LETTERS))]
    return tuple((ca.fmax(2 - u, 0) ** 3 - 4 * ca.fmax(1 - u, 0) ** 3) / 6 for u in away)
