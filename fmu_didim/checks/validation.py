"""Direct and cross validation: simulated against measured torque, relative error per joint, and of what a large one is
made.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, REMARK, Diagnostic
from fmu_didim.base.errors import SimulationError
from fmu_didim.data.signals import Array, Trajectory
from fmu_didim.fit.estimate import Estimate
from fmu_didim.fit.noise.noise import TINY
from fmu_didim.fit.statistics import error_percent, relative_error_percent
from fmu_didim.model.experiment import Role
from fmu_didim.model.loop_model import LoopModel, Simulation
from fmu_didim.model.simulated_table import motion_at_samples, simulated_table
from fmu_didim.model.workers import side_by_side

LARGE_PERCENT = 15.0
"""[%] Torque error of a joint from which it is said of what it is made: noise of usual sensors is a third of it."""
SLOWLY = 0.05
"""[1] Of the largest speed of a joint, below which it stands still or turns round."""
QUARTER = (25.0, 75.0)
"""[%] Of the sizes of the torque, below and above which errors are compared."""
ABOVE_BAND = 2.0
"""[1] Times the highest frequency of the motion, from which a residual is fast."""
FEWEST = 20
"""[samples] In each part that is compared."""

TORQUE_ERROR_LARGE = CATALOGUE(
    "torque-error-large", REMARK, rank=63,
    meaning="The torque error of a fitted joint is large. What it is made of tells where it may come from: near "
    "standstill and reversals: backlash, friction that sticks; fast: noise of the encoder, a rattle in the loop, "
    "resolution; growing with the torque: noise of the drive, its gain. White noise is spread evenly. The intervals "
    "treat it all as noise.",
    next_step="Look at the residual in the report; if it should be smaller: fmu-didim discover CASE.yaml.",
)  # fmt: skip


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
        total_percent, per_joint_percent: 100 |y - y_s| / |y|, (n,) for the joints; of the outputs of a model in per
            cent of what they move.
        failure: why the simulation failed, or empty; the values are then NaN.
        every: simulated torque ``tau<j>`` at every control period, or outputs of a model and behind them its inputs;
            None where the simulation failed.
        motion: ``q<j>``, ``dq<j>`` -> (N,) simulated motion at the samples, as far as the plant gives it; or the inputs
            of a model.
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


def validated(estimate: Estimate) -> list[Validation]:
    """Each experiment of the estimate, simulated with its values."""
    model = estimate.validated_model.with_values(estimate.value)
    return side_by_side(
        [partial(validate_on, model, estimate.value, label) for label in model.experiments], model.workers_from_start
    )


def validate_on(model: LoopModel, values: Array, label: str) -> Validation:
    """Simulate an experiment with values (p,) and compare the torques, and what else was measured."""
    run, measured = model.simulation(values, label), model.experiments.recorded_in(label)
    every, motion, channels = None, dict[str, Array](), dict[str, ChannelValidation]()
    try:
        is_seen_again = run.experiment.role == "estimation" or bool(run.experiment.channels)
        table = simulated_table(run, alone=not is_seen_again)
        torque = run.torque_at(table.values[:, : model.joint_count]) if model.loop.shows_torque else run.torque()
        simulated, failure = run.experiment.unscaled(torque), ""
        every = table.first(model.joint_count) if model.loop.shows_torque else table
        motion = motion_at_samples(run, table)
        channels = validated_channels(run)
    except SimulationError as error:
        simulated, failure = np.full_like(measured, np.nan), str(error)
    total, per_joint = error_percent(model.loop, measured, simulated)
    return Validation(
        label, run.experiment.role, run.experiment.time, measured, simulated, total, per_joint, failure, every, motion,
        channels,
    )  # fmt: skip


def error_diagnostics(validations: Iterable[Validation], motion_hz: float) -> list[Diagnostic]:
    """Of what the torque error of each fitted joint is made where it is large.

    Args:
        motion_hz: highest frequency of the motion.
    """
    return [
        Diagnostic(
            TORQUE_ERROR_LARGE,
            f"The torque error is {v.per_joint_percent[j]:.0f} %: {'; '.join(parts_of_error(v, j, motion_hz))}.",
            f"{v.label}: joint {j + 1}", float(v.per_joint_percent[j]), LARGE_PERCENT, "%",
        )
        for v in validations if v.role == "estimation" and not v.failure
        for j in range(v.measured.shape[1]) if v.per_joint_percent[j] > LARGE_PERCENT
    ]  # fmt: skip


def parts_of_error(found: Validation, j: int, motion_hz: float) -> list[str]:
    """What share of the squared residual of joint ``j`` (from 0) lies where: by the speed of the joint, the size of the
    torque and the frequency, as far as the samples tell."""
    residual = found.measured[:, j] - found.simulated[:, j]
    squares, told = residual**2 / max(float(residual @ residual), TINY), []
    speed = np.abs(found.motion.get(f"dq{j + 1}", np.zeros(0)))
    slow = speed < SLOWLY * speed.max(initial=0.0)
    if FEWEST <= slow.sum() <= residual.size - FEWEST:
        told.append(
            f"{100 * squares[slow].sum():.0f} % of its square at the {100 * slow.mean():.0f} % of the samples near "
            "standstill and reversals"
        )
    size = np.abs(found.simulated[:, j])
    low, high = np.percentile(size, QUARTER)
    if high > low and min((size <= low).sum(), (size >= high).sum()) >= FEWEST:
        ratio = np.sqrt(squares[size >= high].mean() / max(float(squares[size <= low].mean()), TINY))
        told.append(f"{ratio:.2g} times as large at the largest quarter of the torque as at the smallest")
    steps = np.diff(found.time)
    cut = ABOVE_BAND * motion_hz * float(np.median(steps))
    if residual.size >= FEWEST and np.isfinite(cut) and np.ptp(steps) < SLOWLY * steps.mean():
        frequency, power = np.fft.rfftfreq(residual.size), np.abs(np.fft.rfft(residual)) ** 2
        fast = frequency > cut
        if fast.any() and not fast.all():
            share = 100 * power[fast].sum() / max(float(power.sum()), TINY)
            told.append(
                f"{share:.0f} % of its square above {ABOVE_BAND * motion_hz:.3g} Hz, beyond the motion, where even "
                f"noise has {100 * fast.mean():.0f} %"
            )
    return told or ["too few samples to tell of what it is made"]


def validated_channels(run: Simulation) -> dict[str, ChannelValidation]:
    """What was measured beside the torque in an experiment, and as simulated; raises SimulationError."""
    experiment = run.experiment
    if not experiment.channels:
        return {}
    simulated = run.channels()
    return {
        c.name: ChannelValidation(c.unit, c.time, c.measured, simulated[c.name], c.typical_deviation)
        for c in experiment.channels
    }
