"""The signals recorded in a run of the loop."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fmu_didim.base.errors import UnknownNameError
from fmu_didim.data.signals import Array


@dataclass(frozen=True)
class Recording:
    """Signals recorded at some ticks.

    Attributes:
        ticks: (K,) tick numbers; start: instant of tick 0 in s; step_size: of a tick, s.
        applied: name -> (K,) values; those of a component whose inputs are delayed are taken when the
            input computed at the tick acts, so that torque and motion of a row belong together.
        inputs: name -> (K,) values of the inputs of the components, when they begin to act.
        sampled: the same as ``applied`` at the instant of the tick itself, just before anything that is due then acts.
        compiled: whether compiled code ran the loop.
    """

    ticks: NDArray[np.int64]
    start: float
    step_size: float
    applied: Mapping[str, Array]
    inputs: Mapping[str, Array]
    sampled: Mapping[str, Array]
    compiled: bool = False

    @cached_property
    def time(self) -> Array:
        """(K,) instants of the ticks, t0 + k h, s."""
        return np.asarray(self.ticks * self.step_size + self.start, dtype=float)

    def table(self, names: list[str], *, sampled: bool = False) -> Array:
        """(K, len(names)) of the named signals ``component.variable``."""
        source = self.sampled if sampled else self.applied
        for name in names:
            if name not in source:
                raise UnknownNameError("recorded signal", name, source)
        return np.column_stack([source[name] for name in names])
