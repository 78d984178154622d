"""Filters of signals: low-pass, thinning out, medians and maxima of neighbours.

``scipy.signal`` is imported where it is needed: that takes a good part of the time of a fit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy import sparse

from fmu_didim.base.errors import InputError
from fmu_didim.data.signals import Array

ROLL_OFF = 0.5
"""[1] Of the root raised cosine: from half of the middle of its edge to one and a half of it."""
REACH = 4
"""[samples] Of the fewer ones, to both sides, where its kernel ends: there it is below a hundredth of its middle."""
POLE = 1e-9
"""[1] From the places where the formula of the kernel is 0/0."""
FREQUENCIES = 8192
"""[1] Up to half of the rate, over which the noise that a filter leaves is summed."""
AT_ONCE = 100_000
"""[values] Whose neighbours are copied and sorted together: some ten megabytes, however long a log is."""


@dataclass(frozen=True)
class LowPass:
    """Zero-phase Butterworth filter, applied alike to the torque and to the columns of the regressor."""

    cutoff_hz: float
    order: int = 4

    def apply(self, values: Array, rate_hz: float) -> Array:
        """Filter (N, ...) samples along time; raises InputError if the cut-off is not below half the rate."""
        from scipy import signal

        if not 0 < self.cutoff_hz < rate_hz / 2:
            raise InputError(
                "The cut-off frequency of the filter must lie below half the torque rate.",
                got=f"{self.cutoff_hz:g} Hz at {rate_hz:g} Hz",
                next_step="Lower the cut-off frequency, or log at a higher rate.",
            )  # fmt: skip
        sections = signal.butter(self.order, self.cutoff_hz, fs=rate_hz, output="sos")
        return np.asarray(signal.sosfiltfilt(sections, values, axis=0))

    def noise_share(self, rate_hz: float) -> float:
        """Part of the variance of white noise, sampled at a rate, that it leaves: the mean of |H|^4 up to half of that
        rate, forward and backward."""
        from scipy import signal

        sections = signal.butter(self.order, self.cutoff_hz, fs=rate_hz, output="sos")
        return float(np.mean(np.abs(signal.sosfreqz(sections, worN=FREQUENCIES)[1]) ** 4))


def band_limited(rate_hz: float, count: int, cutoff_hz: float) -> tuple[sparse.csr_array, NDArray[np.int64]]:
    """Weights (N', N) that bring N samples at a rate to fewer, with nothing of what is above a cut-off, and the samples
    (N',) in the middle of them. White noise stays white.

    The kernel is a root raised cosine of the roll-off 1/2 at the rate of the fewer samples, two thirds of twice the
    cut-off: the squares of its shifted spectra add up to one. Those whose kernel reaches beyond the ends are left out.

    Source: J. G. Proakis, Digital Communications, chapter 9.
    """
    stride = max(int(np.ceil(rate_hz * (1 + ROLL_OFF) / (2 * cutoff_hz))), 1)
    reach = REACH * stride
    x = np.arange(-reach, reach + 1) / stride
    with np.errstate(divide="ignore", invalid="ignore"):
        kernel = np.sin(np.pi * x * (1 - ROLL_OFF)) + 4 * ROLL_OFF * x * np.cos(np.pi * x * (1 + ROLL_OFF))
        kernel = kernel / (np.pi * x * (1 - (4 * ROLL_OFF * x) ** 2))
    kernel[x == 0] = 1 - ROLL_OFF + 4 * ROLL_OFF / np.pi
    pole = np.abs(np.abs(4 * ROLL_OFF * x) - 1) < POLE
    angle = np.pi / (4 * ROLL_OFF)
    kernel[pole] = ROLL_OFF / np.sqrt(2) * ((1 + 2 / np.pi) * np.sin(angle) + (1 - 2 / np.pi) * np.cos(angle))
    middle = np.arange(reach, count - reach, stride, dtype=np.int64)
    rows, columns = np.repeat(np.arange(middle.size), x.size), (middle[:, None] + np.arange(-reach, reach + 1)).ravel()
    weights = np.tile(kernel / kernel.sum(), middle.size)
    return sparse.csr_array((weights, (rows, columns)), shape=(middle.size, count)), middle


def thinned(values: Array, factor: int) -> Array:
    """One sample of ``factor`` of (N, ...) samples, after a low-pass without phase: Chebyshev, order 8."""
    from scipy import signal

    return np.asarray(signal.decimate(values, factor, n=8, ftype="iir", axis=0, zero_phase=True))


def running_median(values: Array, width: int, *, outside: float | None = None) -> Array:
    """(N,) median of each value (N,) and its neighbours.

    Args:
        width: values in a median, odd.
        outside: value before the first and after the last one; None: the first and the last are repeated.
    """
    windows = _windows(values, width, outside)
    return np.concatenate([np.median(part, axis=-1) for part in np.array_split(windows, values.size // AT_ONCE + 1)])


def running_maximum(values: Array, width: int) -> Array:
    """(N,) largest of each value (N,) and its neighbours, ``width`` in all, an odd number."""
    return np.asarray(_windows(values, width, None).max(axis=-1))


def _windows(values: Array, width: int, outside: float | None) -> Array:
    """(N, width) each value and its neighbours."""
    before, after = (values[0], values[-1]) if outside is None else (outside, outside)
    beside = np.ones(width // 2)
    return sliding_window_view(np.concatenate([before * beside, values, after * beside]), width)
