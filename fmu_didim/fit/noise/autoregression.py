"""The colour of noise: an autoregression of neighbouring samples,

    e_t = a_1 e_(t-1) + ... + a_p e_(t-p) + u_t,      u white,

from autocovariances by the recursion of Levinson and Durbin, its order by Akaike's criterion corrected for short logs.
Sources: Brockwell, Davis, Time Series: Theory and Methods, 2nd ed., 1991, 5.2, 9.3; Ljung, Box, Biometrika 65 (1978).
"""

from __future__ import annotations

import numpy as np
from scipy import linalg

from fmu_didim.base.distributions import chi2_sf
from fmu_didim.data.signals import Array

ORDERS = 10.0
"""[1] Largest order of an autoregression, over the decimal logarithm of the samples: usual, and enough for noise of
50 ms at 200 Hz, which needs about seven."""
SAMPLES_A_COEFFICIENT = 5.0
"""[samples] At least, for each coefficient tried."""


def largest_order(samples: int) -> int:
    """The largest order that is tried for this number of samples."""
    return int(min(ORDERS * np.log10(samples), samples / SAMPLES_A_COEFFICIENT))


def autoregression(covariance: Array, samples: int, largest: int) -> Array:
    """(p,) coefficients of the order p <= largest that Akaike's corrected criterion chooses; none: white.

    Args:
        covariance: (K + 1,) autocovariances at lags 0 ... K, K >= largest; samples: they were taken from.
    """
    whitening, power = np.ones(1), float(covariance[0])
    best, least = np.zeros(0), samples * np.log(power) + order_cost(samples, 0)
    for order in range(1, min(largest, samples - 3) + 1):
        reflection = -float(whitening @ covariance[order:0:-1]) / power
        if abs(reflection) >= 1:  # gaps and corrections may leave autocovariances that no noise has
            break
        whitening = np.append(whitening, 0.0)
        whitening = whitening + reflection * whitening[::-1]
        power *= 1 - reflection**2
        criterion = samples * np.log(power) + order_cost(samples, order)
        if criterion < least:
            best, least = -whitening[1:], criterion
    return best


def order_cost(samples: int, order: int, used: int = 0) -> float:
    """Cost of a variance and this number of coefficients: Hurvich, Tsai, Biometrika 76 (1989).

    Args:
        used: samples that a fit uses up beside them.
    """
    return 2.0 * (order + 1) * samples / max(samples - used - order - 2, 1)


def autocorrelation(coefficients: Array, count: int) -> Array:
    """(count,) autocorrelation at lags 0 ... count - 1 of an autoregression that is stable."""
    order = coefficients.size
    if not order:
        return np.asarray(np.eye(1, count)[0])
    # Yule and Walker: rho_i = sum_j a_j rho_|i - j|, i = 1 ... p, with rho_0 = 1.
    lags = np.abs(np.subtract.outer(np.arange(1, order + 1), np.arange(1, order + 1)))
    table = np.zeros((order, order + 1))
    np.add.at(table, (np.arange(order)[:, None], lags), coefficients)
    first = np.append(1.0, linalg.solve(np.eye(order) - table[:, 1:], table[:, 0]))
    whitening = np.append(1.0, -coefficients)
    right = np.zeros(max(count, first.size))
    right[: first.size] = np.convolve(whitening, first)[: first.size]
    band = np.repeat(whitening[:, None], right.size, axis=1)  # of the table that whitens: one below the other, a column
    return np.asarray(linalg.lapack.dtbtrs(band, right[:, None], uplo="L", diag="U")[0][:count, 0])


def innovations(covariance: Array, coefficients: Array, lags: int) -> Array:
    """(lags + 1,) autocovariances of what an autoregression leaves of noise with autocovariances (K + 1,)."""
    whitening = np.append(1.0, -coefficients)
    shifts = np.subtract.outer(np.arange(whitening.size), np.arange(whitening.size))
    weight = np.outer(whitening, whitening)
    return np.array([np.sum(weight * covariance[np.abs(k + shifts)]) for k in range(lags + 1)])


def portmanteau(covariance: Array, pairs: Array, lags: int) -> float:
    """Ljung and Box's sum over the lags 1 ... ``lags``, a chi-square with that many degrees of freedom if all is white.

    Args:
        covariance: (K + 1,) means of the products; pairs: (K + 1,) number of products in each mean.
    """
    if covariance[0] <= 0:
        return 0.0
    count = float(pairs[0])
    return float((count + 2) / count * np.sum(pairs[1 : lags + 1] * (covariance[1 : lags + 1] / covariance[0]) ** 2))


def portmanteau_p(sum_of_squares: float, freedom: int) -> float:
    """Probability that white noise gives more."""
    return float(chi2_sf(sum_of_squares, freedom)) if freedom > 0 else 1.0
