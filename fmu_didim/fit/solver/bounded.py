"""The least value of a function of one number between two bounds."""

from __future__ import annotations

from collections.abc import Callable

MOST = 500
"""[evaluations] After which the least value so far is returned."""


def least_between(
    function: Callable[[float], float], low: float, high: float, *, accuracy: float, evaluations: int = MOST
) -> tuple[float, float]:
    """Where a function is least between two bounds, and its value there; a local minimum where it has several.

    Args:
        accuracy: of the place; evaluations: of the function at most.

    Source: Brent, Algorithms for Minimization without Derivatives, ch. 5, by SciPy.
    """
    from scipy.optimize import minimize_scalar  # slow to import

    options = {"xatol": accuracy, "maxiter": evaluations}
    found = minimize_scalar(function, bounds=(low, high), method="bounded", options=options)
    return float(found.x), float(found.fun)
