"""Power density and products of signals by Fourier transforms."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from fmu_didim.data.signals import Array


def power_density(values: Array, rate_hz: float, segment: int, *, median: bool = False) -> tuple[Array, Array]:
    """Frequencies (m,) in Hz and one-sided power density (m,) of (N,) values by Welch (IEEE Trans. Audio 15, 1967).

    Segments that overlap by half, less their means, in periodic Hann windows w:  2 |DFT(w x)|^2 / (f sum w^2)

    Args:
        segment: samples in a segment, at most N.
        median: of the segments instead of their mean; what visits a frequency in a few of them only is left out.
    """
    window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(segment) / segment)
    parts = np.lib.stride_tricks.sliding_window_view(values, segment)[:: segment - segment // 2]
    parts = parts - parts.mean(axis=1, keepdims=True)
    power = np.abs(fft.rfft(parts * window)) ** 2 / (rate_hz * np.sum(window**2))
    power[:, 1 : (segment + 1) // 2] *= 2  # all but the mean and, of an even segment, half the rate stand for two
    frequency = fft.rfftfreq(segment, 1 / rate_hz)
    return frequency, np.median(power, axis=0) / _median_bias(len(power)) if median else power.mean(axis=0)


def _median_bias(count: int) -> float:
    """Mean of the median of ``count`` values of an exponential distribution, over that distribution's mean:
    1 - 1/2 + 1/3 - ... + 1/n, n the last odd number (Allen et al., Phys. Rev. D 85, 122006, 2012, appendix B)."""
    terms = np.arange(1, count + count % 2)
    return float(np.sum((-1.0) ** (terms + 1) / terms))


def lagged_products(a: Array, b: Array, lags: NDArray[np.int64]) -> Array:
    """(K,) sums over t of a_t b_(t - lag) of (N,) and (M,) values at these lags (K,), by one transform; there is
    nothing before the first values and after the last ones."""
    size = fft.next_fast_len(a.size + b.size - 1, real=True)
    return np.asarray(fft.irfft(fft.rfft(a, size) * fft.rfft(b, size).conj(), size)[lags % size])
