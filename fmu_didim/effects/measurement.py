"""Effects that change only what is measured, not the loop."""

from __future__ import annotations

from typing import ClassVar

from fmu_didim.effects.base import Place
from fmu_didim.effects.nonlinear import NonlinearEffect


class MeasurementEffect(NonlinearEffect):
    """An effect of the torque log as a whole; the loop runs as without it.

    Its one parameter is the lag of the log in s: the samples at t show the torque at t - lag, of all joints.
    """

    place: ClassVar[Place] = "measurement"
