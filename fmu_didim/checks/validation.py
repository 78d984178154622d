"""Direct and cross validation: simulated against measured torque, relative error per joint."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from fmu_didim.base.errors import SimulationError
from fmu_didim.data.signals import Array, Trajectory
from fmu_didim.fit.statistics import relative_error_percent
from fmu_didim.model.experiment import Role
from fmu_didim.model.loop_model import LoopModel, Simulation
from fmu_didim.model.simulated_table import motion_at_samples, simulated_table


@dataclass(frozen=True)
class ChannelValidation:
    """What was measured beside the torque in one experiment, and what the model gives there.

    Attributes:
        unit: SI; time, measured, simulated: (N,), at the instants of the signal.
        deviation: standard deviation of its noise that the case states; None: not stated.
    """

    unit: str
    time: Array
    measured: Array
    simulated: Array
    deviation: float | None = None

    @property
    def residual(self) -> Array:
        """(N,) measured minus simulated."""
        return self.measured - self.simulated

    @property
    def rms(self) -> float:
        """Root mean square of the residual."""
        return float(np.sqrt(np.mean(self.residual**2)))

    @property
    def relative_error_percent(self) -> float:
        """100 |y - y_s| / |y - mean(y)|: of what the signal moves, wherever its zero is; NaN where it does not
        move."""
        zero = self.measured.mean()
        if not np.ptp(self.measured):
            return float("nan")
        return relative_error_percent((self.measured - zero)[:, None], (self.simulated - zero)[:, None])[0]


@dataclass(frozen=True)
class Validation:
    """Measured and simulated torque of one experiment.

    Attributes:
        label: of the experiment; role: whether the parameters were fitted to it.
        time: (N,) s; measured, simulated: (N, n) N.m or N.
        total_percent, per_joint_percent: 100 |y - y_s| / |y|, (n,) for the joints.
        failure: why the simulation failed, or empty; the values are then NaN.
        every: simulated torque ``tau<j>`` at every control period; None where the simulation failed.
        motion: ``q<j>``, ``dq<j>`` -> (N,) simulated motion at the samples, as far as the plant gives it.
        channels: name of each signal that was measured beside the torque -> that; empty where the simulation failed.
    """

    label: str
    role: Role
    time: Array
    measured: Array
    simulated: Array
    total_percent: float
    per_joint_percent: Array
    failure: str = ""
    every: Trajectory | None = None
    motion: Mapping[str, Array] = field(default_factory=dict)
    channels: Mapping[str, ChannelValidation] = field(default_factory=dict)


def validate(model: LoopModel, values: Array, label: str) -> Validation:
    """Simulate an experiment with values (p,) and compare the torques, and what else was measured."""
    run, measured = model.simulation(values, label), model.experiments.measured_in(label)
    every, motion, channels = None, dict[str, Array](), dict[str, ChannelValidation]()
    try:
        simulated, failure = run.torque(), ""
        table = simulated_table(run)
        every, motion = table.first(model.joint_count), motion_at_samples(run, table)
        channels = validated_channels(run)
    except SimulationError as error:
        simulated, failure = np.full_like(measured, np.nan), str(error)
    total, per_joint = relative_error_percent(measured, simulated)
    return Validation(
        label, run.experiment.role, run.experiment.time, measured, simulated, total, per_joint, failure, every, motion,
        channels,
    )  # fmt: skip


def validated_channels(run: Simulation) -> dict[str, ChannelValidation]:
    """What was measured beside the torque in an experiment, and as simulated; raises SimulationError."""
    experiment = run.experiment
    if not experiment.channels:
        return {}
    simulated = run.channels()
    return {
        c.name: ChannelValidation(c.unit, c.time, c.values, simulated[c.name], c.deviation) for c in experiment.channels
    }
