"""The residual of an experiment, as charts of it need it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from fmu_didim.data.signals import Array, Trajectory

Residuals = Mapping[str, tuple[str, Array]]
"""Name of each model -> style of its series, and measured - simulated torque (N,) of one joint."""


@dataclass(frozen=True)
class Residual:
    """What the models leave of the torque of an experiment.

    Attributes:
        key: of the experiment in names of charts; title: of the experiment.
        signals: at the samples of the log: simulated positions ``q<j>`` and velocities ``dq<j>`` where they were saved.
        units: of the torque of each joint; of_joints: for each joint, of one or two models.
        quantities: for each joint, over which it is drawn: keys of ``QUANTITIES``, or of ``further``.
        names: of the outputs of a model, where those stand in the place of joints; further: name of an input or an
            output over which their residuals are drawn -> its unit; it has a column of that name.
    """

    key: str
    title: str
    signals: Trajectory
    units: Sequence[str]
    of_joints: Sequence[Residuals]
    quantities: Sequence[Sequence[str]]
    names: Sequence[str] = ()
    further: Mapping[str, str] = field(default_factory=dict)

    def head(self, j: int) -> str:
        """What column ``j``, from 0, is called in a heading."""
        return self.names[j] if self.names else f"Joint {j + 1}"

    def text(self, j: int) -> str:
        """The same inside a sentence."""
        return self.names[j] if self.names else f"joint {j + 1}"
