"""What was measured beside the torque: signals of the loop, each at instants of its own."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fmu_didim.cosim import SampleOperator
from fmu_didim.data.signals import Array
from fmu_didim.model.signals.error_model import PLAIN, ErrorModel


@dataclass(frozen=True, eq=False)
class Channel:
    """A measured signal of the loop, such as the position of a joint.

    Attributes:
        name: shown to the user, ``q1``; signal: ``component.output`` of the loop that it shows; unit: SI.
        time: (N,) its instants, s; values: (N,) in SI units.
        operator: how its samples follow from the signal at the ticks.
        deviation: known standard deviation of its noise; None: estimated from the residual.
        errors: its error model; scale: (N,) that its samples are divided by in a fit, as the deviation is; None: one.
        recorded: (N,) what was measured, where a fit takes other values for it; None: ``values``.
    """

    name: str
    signal: str
    unit: str
    time: Array
    values: Array
    operator: SampleOperator
    deviation: float | None = None
    errors: ErrorModel = PLAIN
    scale: Array | None = None
    recorded: Array | None = None

    @property
    def measured(self) -> Array:
        """(N,) what was measured, whatever a fit takes for it."""
        return self.values if self.recorded is None else self.recorded

    @property
    def typical_deviation(self) -> float | None:
        """The stated deviation of its noise in its unit, the root mean square where samples differ."""
        if self.deviation is None or self.scale is None:
            return self.deviation
        return self.deviation * float(np.sqrt(np.mean(self.scale**2)))

    def scaled(self, values: Array) -> Array:
        """Values (N, ...) at its samples as a fit compares them."""
        return values if self.scale is None else values / self.scale.reshape(-1, *(1,) * (values.ndim - 1))

    def unscaled(self, values: Array) -> Array:
        """The reverse of :meth:`scaled`."""
        return values if self.scale is None else values * self.scale.reshape(-1, *(1,) * (values.ndim - 1))

    def after(self, instant: float) -> Channel:
        """The same without the samples before an instant."""
        first = int(np.searchsorted(self.time, instant))
        return replace(
            self, time=self.time[first:], values=self.values[first:], operator=self.operator.after(first),
            scale=None if self.scale is None else self.scale[first:],
            recorded=None if self.recorded is None else self.recorded[first:],
        )  # fmt: skip
