"""Predictions of a loop model for one set of values: the torque, and the regressor of the simulated motion."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from fmu_didim.cosim import Recording
from fmu_didim.data.signals import Array
from fmu_didim.model.loop_model import LoopModel, Simulation
from fmu_didim.model.numerical_regressor import RegressorProbe

Columns = Callable[[], tuple[Array, Array]]
"""Gives the regressor (N, n, b) and the known torque (N, n) of one experiment when they are asked for."""


@dataclass(frozen=True)
class Prediction:
    """Output of the closed loop for one set of values, at the samples of the fitted logs.

    Attributes:
        torque: (N, n) simulated torque tau_s; recordings: label -> what it comes from.
        columns: give W_s and known, one an experiment; None for a plant without inverse model.
    """

    torque: Array
    recordings: Mapping[str, Recording] = field(repr=False)
    columns: tuple[Columns, ...] | None = field(repr=False)

    @cached_property
    def _both(self) -> tuple[Array, Array] | tuple[None, None]:
        """Computed on first use: an estimator that only compares torques does not need it."""
        if self.columns is None:
            return None, None
        pairs = [columns() for columns in self.columns]
        if len(pairs) == 1:
            return pairs[0]
        return np.concatenate([w for w, _ in pairs]), np.concatenate([known for _, known in pairs])

    @property
    def regressor(self) -> Array | None:
        """(N, n, b) W_s, so that tau_s = W_s chi + known to rounding; None for a plant without inverse model."""
        return self._both[0]

    @property
    def known(self) -> Array | None:
        """(N, n) torque of all that is no free base parameter; None as the regressor."""
        return self._both[1]

    @property
    def compiled(self) -> bool:
        """Whether compiled code ran all loops."""
        return all(recording.compiled for recording in self.recordings.values())


def predict(model: LoopModel, values: Array) -> Prediction:
    """Simulated torque and regressor at the samples of the logs; raises DivergedError, SimulationError."""
    if model.parameters.is_probed:
        one = _by_probing
    elif model.parameters.has_regressor and not model.loop.gives_acceleration:
        one = _by_differences
    else:
        one = _by_accelerations
    found = {label: one(model.simulation(values, label)) for label in model.estimation_labels}
    columns = tuple(c for _, _, c in found.values() if c is not None)
    return Prediction(
        torque=np.concatenate([torque for torque, _, _ in found.values()]),
        recordings={label: recording for label, (_, recording, _) in found.items()},
        columns=columns or None,
    )


_Found = tuple[Array, Recording, Columns | None]


def _by_accelerations(run: Simulation) -> _Found:
    """From the accelerations that the plant gives."""
    recording, model = run.record(), run.model
    torque = run.sampled_torque(recording)
    if not model.parameters.has_regressor:
        return torque, recording, None

    def columns() -> tuple[Array, Array]:
        q, dq, ddq = (recording.table(model.loop.joint_signals(name)) for name in ("q", "dq", "ddq"))
        regressor, known = sampled_regressor(run, (q, dq, ddq), _observed(model, recording))
        return regressor, known + run.sampled(_not_in_plant(run, recording))

    return torque, recording, columns


def _by_probing(run: Simulation) -> _Found:
    """Where the regressor is measured on the running plant, tick by tick."""
    probe = RegressorProbe(run.model.loop.plant_name, run.model.parameters, run.theta, run.operator.ticks.size)
    recording = run.record(observe=probe)
    torque = run.sampled_torque(recording)
    rest = run.logged_torque(recording) - probe.columns @ run.theta
    columns, known = of_all(run.model, run.label, run.sampled(probe.columns), run.sampled(rest))
    return torque, recording, lambda: (columns, known)


def _by_differences(run: Simulation) -> _Found:
    """For a plant without acceleration outputs.

    While a command is held, ddq is taken for (dq[k+1] - dq[k]) / h_k, its mean over the control period; at the last
    tick of the reference for the difference before. The regressor then fits the torque to first order in h.
    """
    model, wanted = run.model, run.operator.ticks
    first = np.minimum(wanted, run.experiment.reference.time.size - 2)
    ticks = np.unique(np.concatenate([wanted, first, first + 1]))
    recording = run.record(ticks=ticks)
    here, low, high = (np.searchsorted(ticks, some) for some in (wanted, first, first + 1))
    position, velocity = (recording.table(model.loop.joint_signals(name)) for name in ("q", "dq"))
    acceleration = (velocity[high] - velocity[low]) / recording.elapsed(low, high)
    torque = run.sampled(run.logged_torque(recording)[here])
    motion = (position[here], velocity[here], acceleration)
    columns, known = sampled_regressor(run, motion, _observed(model, recording)[here])
    known = known + run.sampled(_not_in_plant(run, recording)[here])
    return torque, recording, lambda: (columns, known)


def drive_torque(model: LoopModel, recording: Recording) -> Array:
    """(K, n) torque of the drives for the recorded commands: the plant's inputs when those begin to act."""
    return np.column_stack([recording.inputs[name] for name in model.loop.joint_signals("tau")])


def _not_in_plant(run: Simulation, recording: Recording) -> Array:
    """(K, n) torque that the log shows but the plant does not get, because of effects in the drives."""
    return run.logged_torque(recording) - drive_torque(run.model, recording)


def _observed(model: LoopModel, recording: Recording) -> Array:
    """(K, no) states of effects, time and loads at the recorded ticks, as far as the regressor depends on them."""
    names = [f"{model.loop.plant_name}.{name}" for name in model.parameters.observed]
    return recording.table(names) if names else np.zeros((recording.time.size, 0))


def sampled_regressor(
    run: Simulation, motion: tuple[Array, Array, Array], observed: Array | None = None
) -> tuple[Array, Array]:
    """W (N, n, b) and the known torque (N, n) at the samples of an experiment, on any motion.

    Args:
        motion: q, dq, ddq at the ticks of the operator, (K, n) each.
        observed: (K, no) what the regressor depends on beyond the motion.
    """
    columns, known = run.model.parameters.regressor(*motion, observed=observed)
    return of_all(run.model, run.label, run.sampled(columns), run.sampled(known))


def of_all(model: LoopModel, label: str, columns: Array, known: Array) -> tuple[Array, Array]:
    """Columns (N, n, b) of the base parameters that act in an experiment over all that are free, (N, n, linear_count),
    and the torque (N, n) of what is known, with that of its load."""
    if label in model.loads:
        known = known + columns @ model.loads[label].shift
    return model.free_parameters.spread(columns, label), known
