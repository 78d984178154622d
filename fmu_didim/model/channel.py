"""What was measured beside the torque: signals of the loop, each at instants of its own."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fmu_didim.cosim import SampleOperator
from fmu_didim.data.signals import Array


@dataclass(frozen=True, eq=False)
class Channel:
    """A measured signal of the loop, such as the position of a joint.

    Attributes:
        name: shown to the user, ``q1``; signal: ``component.output`` of the loop that it shows; unit: SI.
        time: (N,) its instants, s; values: (N,) in SI units.
        operator: how its samples follow from the signal at the ticks.
        deviation: known standard deviation of its noise; None: estimated from the residual.
    """

    name: str
    signal: str
    unit: str
    time: Array
    values: Array
    operator: SampleOperator
    deviation: float | None = None

    def after(self, instant: float) -> Channel:
        """The same without the samples before an instant."""
        first = int(np.searchsorted(self.time, instant))
        return replace(
            self, time=self.time[first:], values=self.values[first:], operator=self.operator.after(first)
        )  # fmt: skip
