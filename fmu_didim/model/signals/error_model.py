"""Error models: how the noise of an output is distributed, as a scale of each of its samples.

    y_i = y_s,i + s_i e_i,     s_i = 1,  |y_s,i|  or  sqrt(a^2 + (r y_s,i)^2);     or  log y_i = log y_s,i + e_i

with e of one deviation, normal or of Student's t. A fit divides an output by its scales, so that all that is computed
of residuals holds for e. The scales follow from what is simulated, with which they are taken anew
(:mod:`fmu_didim.fit.noise.error_models`); before the first fit they follow from what was measured.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmu_didim.data.signals import Array

SMALLEST_SCALE = 1e-3
"""[1] Of the median size of an output below which a scale that is relative to it does not fall: weights stay finite."""


@dataclass(frozen=True)
class ErrorModel:
    """The error model of an output.

    Attributes:
        deviation: stated standard deviation a, in the unit of the output or, of logarithms, of these; None: estimated.
        relative: r, the stated part of the value that a deviation is; None: none is relative.
        is_logarithmic: whether the noise is normal in logarithms.
        is_robust: whether it is of Student's t, whose scale the stated deviation is; freedom: its degrees of freedom;
            None: estimated.
    """

    deviation: float | None = None
    relative: float | None = None
    is_logarithmic: bool = False
    is_robust: bool = False
    freedom: float | None = None

    @property
    def is_plain(self) -> bool:
        """Whether all samples are alike and normal, so that they need no scale."""
        return self.relative is None and not self.is_logarithmic and not self.is_robust

    @property
    def follows_simulation(self) -> bool:
        """Whether scales, or what a fit takes for the samples, change with what is simulated."""
        return bool(self.relative) or self.is_logarithmic or self.is_robust

    @property
    def stated(self) -> float | None:
        """The stated deviation of a sample that is divided by its scale; None where it is estimated."""
        if self.relative is None:
            return self.deviation
        return self.relative if self.deviation is None else 1.0

    def scale(self, values: Array) -> Array:
        """(N,) scales where an output has these values (N,)."""
        if self.is_logarithmic or (self.relative is not None and self.deviation is None):
            size = np.abs(values)
            return np.asarray(np.maximum(size, SMALLEST_SCALE * max(float(np.median(size)), np.finfo(float).tiny)))
        if self.relative is not None and self.deviation is not None:
            return np.asarray(np.hypot(self.deviation, self.relative * values))
        return np.ones(values.size)

    def errors(self, measured: Array, simulated: Array) -> Array:
        """(N,) e: of measured values beside simulated ones, divided by the scale."""
        scale = self.scale(simulated)
        if self.is_logarithmic:
            return np.asarray(np.log(measured / scale))
        return np.asarray((measured - simulated) / scale)


PLAIN = ErrorModel()
