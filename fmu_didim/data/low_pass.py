"""The filter of torque and regressor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import signal

from fmu_didim.base.errors import InputError
from fmu_didim.data.signals import Array


@dataclass(frozen=True)
class LowPass:
    """Zero-phase Butterworth filter, applied alike to the torque and to the columns of the regressor."""

    cutoff_hz: float
    order: int = 4

    def apply(self, values: Array, rate_hz: float) -> Array:
        """Filter (N, ...) samples along time; raises InputError if the cut-off is not below half the rate."""
        if not 0 < self.cutoff_hz < rate_hz / 2:
            raise InputError(
                "The cut-off frequency of the filter must lie below half the torque rate.",
                got=f"{self.cutoff_hz:g} Hz at {rate_hz:g} Hz",
            )
        sections = signal.butter(self.order, self.cutoff_hz, fs=rate_hz, output="sos")
        return np.asarray(signal.sosfiltfilt(sections, values, axis=0))
