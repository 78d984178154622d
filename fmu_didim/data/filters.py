"""Filters of signals: low-pass, thinning out, medians and maxima of neighbours.

``scipy.signal`` is imported where it is needed: that takes a good part of the time of a fit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from fmu_didim.base.errors import InputError
from fmu_didim.data.signals import Array

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
