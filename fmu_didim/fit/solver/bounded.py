"""The least value of a function of one number between two bounds.

``scipy.optimize`` finds it by the same steps, but importing it takes longer than a check of the data.
"""

from __future__ import annotations

import math
from collections.abc import Callable

GOLDEN = 0.5 * (3 - math.sqrt(5))
"""[1] Of the longer part, at which it is divided where no parabola is of use."""
ROUNDING = math.sqrt(2.2e-16)
"""[1] Of a place, below which values of a function at two places hardly differ."""
MOST = 500
"""[evaluations] After which the least value so far is returned."""


def least_between(
    function: Callable[[float], float], low: float, high: float, *, accuracy: float, evaluations: int = MOST
) -> tuple[float, float]:
    """Where a function is least between two bounds, and its value there, by parabolas through the three best places
    and golden sections where these are of no use (Brent, Algorithms for Minimization without Derivatives, 5); a local
    minimum where it has several.

    Args:
        accuracy: of the place; evaluations: of the function at most.
    """
    best = second = third = low + GOLDEN * (high - low)
    value = at_second = at_third = function(best)
    step = before = 0.0
    for _ in range(evaluations - 1):
        middle, finest = 0.5 * (low + high), ROUNDING * abs(best) + accuracy / 3
        if abs(best - middle) <= 2 * finest - 0.5 * (high - low):
            break
        last, parabola = before, None
        if abs(before) > finest:
            before = step
            parabola = _vertex((best, value), (second, at_second), (third, at_third))
        if parabola is not None and abs(parabola) < 0.5 * abs(last) and low < best + parabola < high:
            step = parabola
            if min(best + step - low, high - best - step) < 2 * finest:
                step = math.copysign(finest, middle - best)
        else:
            before = (low if best >= middle else high) - best
            step = GOLDEN * before
        place = best + math.copysign(max(abs(step), finest), step)
        found = function(place)
        if found <= value:
            low, high = (best, high) if place >= best else (low, best)
            third, at_third, second, at_second, best, value = second, at_second, best, value, place, found
            continue
        low, high = (place, high) if place < best else (low, place)
        if found <= at_second or second == best:
            third, at_third, second, at_second = second, at_second, place, found
        elif found <= at_third or third in (best, second):
            third, at_third = place, found
    return best, value


def _vertex(best: tuple[float, float], second: tuple[float, float], third: tuple[float, float]) -> float | None:
    """From the best of three places with their values to the vertex of the parabola through them; None without one."""
    (x, f), (x2, f2), (x3, f3) = best, second, third
    r, q = (x - x2) * (f - f3), (x - x3) * (f - f2)
    p, q = (x - x3) * q - (x - x2) * r, 2 * (q - r)
    return -p / q if q else None
