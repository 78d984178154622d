"""Tails and quantiles of the distributions that decide, by the functions of ``scipy.special``.

``scipy.stats`` computes them by the same functions, but importing it takes longer than a fit. As there, ``sf`` is the
probability of more, ``ppf`` the value that is exceeded with the probability 1 - p, ``isf`` the one exceeded with the
probability p. All take numbers and arrays.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy import special

Numbers: TypeAlias = float | NDArray[np.float64]
DEVIATION_OF_MEDIAN = 1.4826
"""[1] Standard deviation of a normal distribution over the median of its magnitude: few samples that are far off hardly
move that."""
SMALLEST_WEIGHT = 1e-12
"""[1] Of the largest one, below which a weight is rounding."""
LOGARITHMS = (-40.0, 80.0, 2401)
"""[1] Of u, and how many: what lies outside is below 1e-9 with two weights and more, steps of 0.05 err as little."""


def normal_sf(x: Numbers) -> Numbers:
    """Probability of more than x deviations."""
    return special.ndtr(-x)  # type: ignore[no-any-return]


def normal_isf(p: Numbers) -> Numbers:
    """The deviations that are exceeded with the probability p."""
    return -special.ndtri(p)  # type: ignore[no-any-return]


def chi2_sf(x: Numbers, freedom: float) -> Numbers:
    """Probability of a larger chi-square; one below zero, which a sum of squares may be by rounding, counts as zero."""
    return special.chdtrc(freedom, np.maximum(x, 0.0))  # type: ignore[no-any-return]


def chi2_isf(p: Numbers, freedom: float) -> Numbers:
    """The chi-square that is exceeded with the probability p."""
    return special.chdtri(freedom, p)  # type: ignore[no-any-return]


def chi2_ppf(p: Numbers, freedom: float) -> Numbers:
    """The chi-square that is exceeded with the probability 1 - p."""
    return 2 * special.gammaincinv(freedom / 2, p)  # type: ignore[no-any-return]


def f_sf(x: Numbers, first: Numbers, second: Numbers) -> Numbers:
    """Probability of a larger ratio of two variances with ``first`` and ``second`` degrees of freedom."""
    return special.fdtrc(first, second, np.maximum(x, 0.0))  # type: ignore[no-any-return]


def f_ppf(p: Numbers, first: float, second: float) -> Numbers:
    """The ratio of two variances that is exceeded with the probability 1 - p."""
    return special.fdtri(first, second, p)  # type: ignore[no-any-return]


def f_isf(p: Numbers, first: float, second: float) -> Numbers:
    """The ratio of two variances that is exceeded with the probability p, however small."""
    x = special.betaincinv(second / 2, first / 2, p)  # of the share that is left, which keeps its digits near zero
    return second * (1 - x) / (first * x)  # type: ignore[no-any-return]


def f_power(x: float, first: float, second: float, noncentrality: NDArray[np.float64]) -> NDArray[np.float64]:
    """Probability of a larger ratio of two variances whose first has these noncentralities, which rise.

    ``scipy.special`` fails at a few of them, at which it follows from those beside them.
    """
    found = np.asarray(special.ncfdtr(first, second, noncentrality, x))
    given = np.isfinite(found)
    return np.asarray(1 - np.interp(noncentrality, noncentrality[given], found[given]))


def t_sf(x: Numbers, freedom: float) -> Numbers:
    """Probability of a larger value of Student's t."""
    return special.stdtr(freedom, -x)  # type: ignore[no-any-return]


def t_ppf(p: Numbers, freedom: float) -> Numbers:
    """The value of Student's t that is exceeded with the probability 1 - p."""
    return special.stdtrit(freedom, p)  # type: ignore[no-any-return]


def quadratic_below_zero(weights: NDArray[np.float64]) -> float:
    """Probability that a weighted sum of squares of independent normal numbers, sum_i w_i z_i^2, is below zero.

        P = 1/2 - 1/pi int_0^inf sin(sum_i atan(w_i u) / 2) / (u prod_i (1 + w_i^2 u^2)^(1/4)) du

    in logarithms of u, where the integrand is smooth and fades on both sides. Source: Imhof, Biometrika 48 (1961).
    """
    largest = float(np.abs(weights).max(initial=0.0))
    kept = weights[np.abs(weights) > SMALLEST_WEIGHT * largest] / (largest or 1.0)
    if not kept.size:
        return 0.0
    s, step = np.linspace(*LOGARITHMS, retstep=True)  # type: ignore[call-overload]
    turned = np.outer(np.exp(s), kept)
    fading = np.exp(-np.sum(np.log1p(turned**2), axis=1) / 4)
    total = float(np.sum(np.sin(np.sum(np.arctan(turned), axis=1) / 2) * fading)) * step
    return float(np.clip(0.5 - total / np.pi, 0.0, 1.0))
