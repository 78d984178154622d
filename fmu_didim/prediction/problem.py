"""What is to be identified from which data, and what a set of parameters predicts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fmu_didim.components import Component
from fmu_didim.errors import DivergedError
from fmu_didim.master import (
    Indices,
    InstancePool,
    Observer,
    Recording,
    SampleOperator,
    System,
    grid_places,
    logged_torque,
    simulate,
)
from fmu_didim.prediction.low_pass import LowPass
from fmu_didim.prediction.parameters import Parameters
from fmu_didim.prediction.probing import RegressorProbe
from fmu_didim.prediction.workers import default_workers
from fmu_didim.signals import Array, Trajectory

STABLE = 8
"""Substeps by the rule for the fastest rate, divided by this, are still stable: h rate <= 1.6, where RK4 bears 2.78.
What a case states is raised to that: an unstable simulation would be a minimum of its own, far from the truth."""


@dataclass(frozen=True)
class Experiment:
    """One run of the real system.

    Attributes:
        reference: what the controller was given, one row a control period; columns ``q<j>`` and, where
            known, ``dq<j>``, ``ddq<j>``.
        time: (N,) instants of the torque log, s; torque: (N, n) joint torque, N.m or N.
        operator: how the log follows from the held command.
        positions: measured positions ``q<j>``, for the estimators that need them.
        label: name shown to the user.
    """

    reference: Trajectory
    time: Array
    torque: Array
    operator: SampleOperator
    positions: Trajectory | None = None
    label: str = "estimation"

    @property
    def rate_hz(self) -> float:
        """Mean rate of the torque log, counting the samples that are missing."""
        return float(self.places[-1] / (self.time[-1] - self.time[0]))

    @property
    def places(self) -> Indices:
        """(N,) place of each sample when those count, too, that the logger has dropped."""
        return grid_places(self.time)

    def with_gaps(self, values: Array) -> Array:
        """(M, ...) values (N, ...) of the samples with rows of NaN for those that are missing."""
        places = self.places
        result = np.full((places[-1] + 1, *values.shape[1:]), np.nan)
        result[places] = values
        return result

    def after(self, seconds: float) -> Experiment:
        """The same without the samples of the first ``seconds`` of the reference."""
        first = int(np.searchsorted(self.time, self.reference.time[0] + seconds - 1e-9))
        return replace(self, time=self.time[first:], torque=self.torque[first:], operator=self.operator.after(first))


@dataclass(frozen=True)
class Problem:
    """An identification problem.

    Attributes:
        system: the closed loop; ``plant`` names its component that carries the parameters.
        parameters: what is identified; for a robot it also gives the regressor, DIDIM's Jacobian.
        experiment: the data.
        torque_deviation: (n,) known standard deviation of the torque noise; estimated when None.
        joint_weights: ``estimated`` divides each joint by its noise, ``equal`` treats them alike.
        low_pass: filter of the torque and of the regressor.
        substep_factor: multiplies the number of integration substeps of the plant.
        pool: instances that run again, shared with all problems made from this one.
        workers: simulations side by side where compiled code runs the loop.
    """

    system: System
    parameters: Parameters
    experiment: Experiment
    plant: str = "plant"
    torque_deviation: Array | None = None
    joint_weights: str = "estimated"
    low_pass: LowPass | None = None
    substep_factor: int = 1
    pool: InstancePool = field(default_factory=InstancePool, compare=False, repr=False)
    workers: int = field(default_factory=default_workers, compare=False)

    @property
    def joint_count(self) -> int:
        """Number of joints n."""
        return self.parameters.joint_count

    @property
    def measured(self) -> Array:
        """(N, n) torque that the prediction is compared with: the log, filtered if asked for."""
        return self.filtered(self.experiment.torque)

    def filtered(self, values: Array) -> Array:
        """Values at the samples (N, ...), filtered if asked for."""
        return values if self.low_pass is None else self.low_pass.apply(values, self.experiment.rate_hz)

    def on(self, experiment: Experiment) -> Problem:
        """The same problem with other data."""
        return replace(self, experiment=experiment)

    def with_delay(self, samples: float) -> Problem:
        """The same problem with another delay of the command."""
        return replace(self, system=self.system.with_delay(self.plant, samples))

    @property
    def delay(self) -> float:
        """Delay of the command in samples."""
        return float(self.system.delays.get(self.plant, 0.0))

    def system_with(self, theta: Array) -> System:
        """The loop with other plant parameters; controller, reference and sampling stay untouched."""
        plant = self.system.components[self.plant]
        values = {**self.parameters.values(theta), **self._start_values()}
        offered = {v.name for v in plant.parameters}
        plant = plant.with_parameters({name: value for name, value in values.items() if name in offered})
        return self.system.replace(self.plant, self._refined(plant, theta))

    def _start_values(self) -> dict[str, float]:
        reference = self.experiment.reference
        first = dict(zip(reference.names, reference.values[0], strict=True))
        result = {"t_start": float(reference.time[0])}
        for j in range(1, self.joint_count + 1):
            if f"q{j}" in first:
                result[f"q_start{j}"] = float(first[f"q{j}"])
                result[f"dq_start{j}"] = float(first.get(f"dq{j}", 0.0))
        return result

    def _refined(self, plant: Component, theta: Array) -> Component:
        stated = plant.stated_substeps
        if stated is None and self.substep_factor == 1:
            return plant
        count = self.parameters.substeps(theta, self._start_values(), self.system.step_size)
        if count is None:
            return plant
        if stated is not None:
            count = max(stated, count // STABLE)
        wanted = self.substep_factor * count
        return plant if wanted == stated else plant.with_substeps(wanted) or plant

    @property
    def can_refine(self) -> bool:
        """Whether the substeps of the plant can be chosen, so that halving them can be tried."""
        known = self.parameters.substeps(self.parameters.nominal(), self._start_values(), self.system.step_size)
        return known is not None and self.system.components[self.plant].with_substeps(2) is not None

    @property
    def gives_acceleration(self) -> bool:
        """Whether the plant has outputs for the accelerations; otherwise they are differences of velocity."""
        offered = {v.name for v in self.system.components[self.plant].outputs}
        return all(f"ddq{j}" in offered for j in range(1, self.joint_count + 1))

    def position_bounds(self) -> dict[str, tuple[float, float]]:
        """Range of positions outside which a simulation counts as diverged: ten times the reference's."""
        result = {}
        given = {v.name for v in self.system.components[self.plant].outputs} & set(self.experiment.reference.names)
        for j in range(1, self.joint_count + 1):
            if f"q{j}" not in given:
                continue
            column = self.experiment.reference.select([f"q{j}"])
            low, high = float(column.min()), float(column.max())
            room = 10 * max(high - low, 1e-6)
            result[f"{self.plant}.q{j}"] = (low - room, high + room)
        return result


@dataclass(frozen=True)
class Prediction:
    """What the closed loop gives for one set of parameters, at the samples of the log.

    Attributes:
        torque: (N, n) simulated torque tau_s; recording: what it comes from.
        columns: gives W_s and known; None for a plant without inverse model.
    """

    torque: Array
    recording: Recording = field(repr=False)
    columns: Callable[[], tuple[Array, Array]] | None = field(repr=False)

    @cached_property
    def _both(self) -> tuple[Array, Array] | tuple[None, None]:
        """Computed when it is asked for: an estimator that only compares torques does without."""
        return (None, None) if self.columns is None else self.columns()

    @property
    def regressor(self) -> Array | None:
        """(N, n, p) W_s, so that tau_s = W_s chi + known to rounding; None for a plant without inverse model."""
        return self._both[0]

    @property
    def known(self) -> Array | None:
        """(N, n) torque of the parameters that are not identified; None as the regressor."""
        return self._both[1]


def joint_signals(problem: Problem, name: str) -> list[str]:
    """``plant.q1``, ``plant.q2``, ... for ``q``."""
    return [f"{problem.plant}.{name}{j}" for j in range(1, problem.joint_count + 1)]


def drive_torque(problem: Problem, recording: Recording) -> Array:
    """(K, n) torque of the drives for the recorded commands: the plant's inputs when those begin to act."""
    names = [f"{problem.plant}.tau{j}" for j in range(1, problem.joint_count + 1)]
    return np.column_stack([recording.inputs[name] for name in names])


def command_torque(problem: Problem, recording: Recording) -> Array:
    """(K, n) torque that the log shows: that of the drives, or before it where a drive has a lag or the like."""
    names = [logged_torque(problem.system, j, plant=problem.plant) for j in range(1, problem.joint_count + 1)]
    return np.column_stack([recording.inputs[name] for name in names])


def _predict_by_probing(problem: Problem, theta: Array) -> Prediction:
    """Torque and regressor where the regressor is measured on the running plant, tick by tick."""
    probe = RegressorProbe(problem.plant, problem.parameters, theta, problem.experiment.operator.ticks.size)
    torque, recording = predict_torque(problem, theta, observe=probe)
    operator = problem.experiment.operator
    known = command_torque(problem, recording) - probe.columns @ theta
    both = problem.filtered(operator.apply(probe.columns)), problem.filtered(operator.apply(known))
    return Prediction(torque, recording, lambda: both)


def _predict_by_differences(problem: Problem, theta: Array) -> Prediction:
    """Prediction for a plant without acceleration outputs.

    While a command is held, ddq is taken for (dq[k+1] - dq[k]) / h, its mean over the control period; at the last
    tick of the reference for the difference before. The regressor then fits the torque to first order in h.
    """
    operator, last = problem.experiment.operator, problem.experiment.reference.time.size - 1
    first = np.minimum(operator.ticks, last - 1)
    ticks = np.unique(np.concatenate([operator.ticks, first, first + 1]))
    recording = _simulate(problem, theta, ticks, None)
    here, low, high = (np.searchsorted(ticks, wanted) for wanted in (operator.ticks, first, first + 1))
    velocity = recording.table(joint_signals(problem, "dq"))
    position = recording.table(joint_signals(problem, "q"))
    acceleration = (velocity[high] - velocity[low]) / problem.system.step_size
    torque = _finite(operator.apply(command_torque(problem, recording)[here]), recording)
    observed = _observed(problem, recording)[here]
    columns, known = sampled_regressor(problem, position[here], velocity[here], acceleration, observed)
    known = known + problem.filtered(operator.apply(_lost(problem, recording)[here]))
    return Prediction(problem.filtered(torque), recording, lambda: (columns, known))


def _simulate(problem: Problem, theta: Array, ticks: NDArray[np.int64], observe: Observer | None) -> Recording:
    return simulate(
        problem.system_with(theta),
        problem.experiment.reference,
        ticks=ticks,
        bounds=problem.position_bounds(),
        observe=observe,
        pool=problem.pool,
    )


def _finite(torque: Array, recording: Recording) -> Array:
    if not np.isfinite(torque).all():
        raise DivergedError("The simulated torque is not finite.", time=float(recording.time[-1]))
    return torque


def predict_torque(problem: Problem, theta: Array, *, observe: Observer | None = None) -> tuple[Array, Recording]:
    """Simulated torque at the samples, (N, n), and the recording; raises DivergedError, SimulationError.

    ``observe`` is handed to :func:`fmu_didim.master.simulate`.
    """
    operator = problem.experiment.operator
    recording = _simulate(problem, theta, operator.ticks, observe)
    torque = _finite(operator.apply(command_torque(problem, recording)), recording)
    return problem.filtered(torque), recording


def predict(problem: Problem, theta: Array) -> Prediction:
    """Simulated torque and regressor at the samples of the log."""
    if problem.parameters.is_probed:
        return _predict_by_probing(problem, theta)
    if problem.parameters.has_regressor and not problem.gives_acceleration:
        return _predict_by_differences(problem, theta)
    torque, recording = predict_torque(problem, theta)
    if not problem.parameters.has_regressor:
        return Prediction(torque, recording, None)
    return Prediction(torque, recording, lambda: _along(problem, recording))


def _along(problem: Problem, recording: Recording) -> tuple[Array, Array]:
    """Regressor and known torque at the samples, from the accelerations that were recorded."""
    q, dq, ddq = (recording.table(joint_signals(problem, name)) for name in ("q", "dq", "ddq"))
    columns, known = sampled_regressor(problem, q, dq, ddq, _observed(problem, recording))
    return columns, known + problem.filtered(problem.experiment.operator.apply(_lost(problem, recording)))


def _lost(problem: Problem, recording: Recording) -> Array:
    """(K, n) torque that the log shows but the plant does not get, because of effects in the drives."""
    return command_torque(problem, recording) - drive_torque(problem, recording)


def _observed(problem: Problem, recording: Recording) -> Array:
    """(K, no) states of effects, time and loads at the recorded ticks, as far as the regressor depends on them."""
    names = [f"{problem.plant}.{name}" for name in problem.parameters.observed]
    return recording.table(names) if names else np.zeros((recording.time.size, 0))


def sampled_regressor(
    problem: Problem, q: Array, dq: Array, ddq: Array, observed: Array | None = None
) -> tuple[Array, Array]:
    """W (N, n, p) and the known torque (N, n) at the samples, from the motion at the operator's ticks (K, n).

    Args:
        observed: (K, no) what the regressor depends on beyond the motion.
    """
    columns, known = problem.parameters.regressor(q, dq, ddq, observed=observed)
    operator = problem.experiment.operator
    return problem.filtered(operator.apply(columns)), problem.filtered(operator.apply(known))
