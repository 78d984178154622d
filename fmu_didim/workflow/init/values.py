"""Whether positions whose names do not say it were measured, by their values: noise, or the grid of an encoder.

Fourth differences of noise change their sign from one row to the next, those of a motion do not: with a correlation of
-0.8 in four of five rows, arccos(-0.8) / pi. They do so everywhere, as corners of a planned motion do not, which has no
noise but the rounding of its file and of the numbers that made it.
"""

from __future__ import annotations

from decimal import Decimal

import numpy as np

from fmu_didim.base.distributions import DEVIATION_OF_MEDIAN
from fmu_didim.checks.data.log import stairs
from fmu_didim.data.signals import Array

NOISY = 0.7
"""[1] Part of the rows with a change of sign, from which fourth differences are those of noise: 0.8 but for the scatter
of a hundred rows; a motion that is sampled slowly has half at most."""
ROUNDING = 3.0
"""[1] Deviation of noise over that of the rounding of the file, from which it is none of it."""
OF_NUMBERS = 5e-7
"""[1] Of the range, the noise of numbers in single precision: less is none of a measurement."""
FEWEST = 60
"""[rows] Of which that can be told."""
GAIN = 70.0
"""[1] Variance of fourth differences of white noise over its own: 1 + 16 + 36 + 16 + 1."""
MOST_DIGITS = 17
"""[digits] Of a number in double precision."""


def measured_by_values(column: Array) -> str:
    """Why the values (N,) of a position are measured ones, in words; empty where they do not say so."""
    values = column[np.isfinite(column)]
    reach = float(np.ptp(values)) if values.size >= FEWEST else 0.0
    if reach == 0.0 or any(stairs(values[:, None], order) > 1 for order in (1, 2)):
        return ""
    fourth = np.diff(values / reach, 4)  # so that squares of any numbers are numbers
    noise = float(reach * DEVIATION_OF_MEDIAN * np.median(np.abs(fourth)) / np.sqrt(GAIN))
    if float(np.mean(fourth[1:] * fourth[:-1] < 0)) < NOISY:
        return ""
    rounding = _digit(values) / np.sqrt(12)
    if noise <= max(ROUNDING * rounding, OF_NUMBERS * reach):
        return ""
    return f"its noise of {noise:.2g} says so"


def _digit(values: Array) -> float:
    """The last decimal place that the numbers of a file have."""
    places = [-int(Decimal(repr(float(value))).as_tuple().exponent) for value in values[: 10 * FEWEST]]
    return float(10.0 ** -min(max(places), MOST_DIGITS))
