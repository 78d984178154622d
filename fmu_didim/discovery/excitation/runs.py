"""What the logs of one motion tell in several runs, such as one without a load and one with it.

The log of a run is its torque over the gains of the drives,

    u_j = (W(q, dq, ddq) (theta + D lambda))_j / g_j

with the parameters lambda of the load that it carries. By all that is free, v = (theta, lambda, g), it changes with

    du_j / d(theta, lambda) = W_j M / g_j,     du_j / dg_j = -tau_j / g_j^2,

M (b, p) the map from v to the base parameters that act in the run. The information of several runs is the sum of
theirs, and of what is known beforehand, such as the mass of the load. Source: Gautier, Briot, "Global identification of
joint drive gains and dynamic parameters of robots", Journal of Dynamic Systems, Measurement, and Control 136(5), 2014.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from fmu_didim.data.signals import Array
from fmu_didim.model.loop_model import LoopModel


@dataclass(frozen=True)
class Runs:
    """The runs of a motion that is designed.

    Attributes:
        values: (p,) of what is free; maps: (b, p) of each run, from them to its base parameters; thetas: (b,) of each
            run, with what it carries.
        gains: joint, from 0 -> place among the values of the gain of its drive; prior: (r, p) whitened rows of what is
            known beforehand.
    """

    values: Array
    maps: tuple[Array, ...]
    thetas: tuple[Array, ...]
    gains: Mapping[int, int] = field(default_factory=dict)
    prior: Array | None = None

    @classmethod
    def alone(cls, theta: Array) -> Runs:
        """One run of a robot with base parameters (b,), of which nothing else is free."""
        return cls(theta, (np.eye(theta.size),), (theta,))

    @classmethod
    def of(cls, model: LoopModel, values: Array, labels: Sequence[str]) -> Runs:
        """Some experiments of a model with values (p,)."""
        free = model.free_parameters
        return cls(
            values,
            tuple(free.map_to_base(label) for label in labels),
            tuple(model.theta(values, label) for label in labels),
            free.gains_of_drives(model.joint_count),
            None if model.prior is None else model.prior.padded(values.size),
        )

    @property
    def count(self) -> int:
        """p."""
        return self.values.size

    def gain(self, joint: int) -> float:
        """Of the drive of a joint, from 0."""
        return float(self.values[self.gains[joint]]) if joint in self.gains else 1.0

    @property
    def known(self) -> Array:
        """(p, p) information that there is beforehand."""
        return np.zeros((self.count, self.count)) if self.prior is None else self.prior.T @ self.prior
