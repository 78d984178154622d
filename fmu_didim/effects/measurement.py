"""Effects that change only what is measured, not the loop."""

from __future__ import annotations

from typing import ClassVar

from fmu_didim.effects.nonlinear import NonlinearEffect


class MeasurementEffect(NonlinearEffect):
    """One effect of the torque log of a joint; the loop runs as without it.

    Class attributes:
        shift: name of the parameter by which the log lags, s; the samples at t then show the torque at t - shift.
    """

    shift: ClassVar[str]
