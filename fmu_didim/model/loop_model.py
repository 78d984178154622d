"""The closed loop as a function from free parameters to the torque at the samples of every experiment.

    values (p,)  ->  system with these values  ->  closed-loop simulation  ->  torque at the samples (N, n)

A :class:`LoopModel` describes components and wiring, the experiments by label, and what is free anywhere in the loop:
base parameters of the robot first, then parameters of the controller, of drives and sensors, the delay, the clock of
the log, and amplitudes and shapes of effects that discovery has added. Tables that speak of several experiments hold
their samples one below the other, in the order of ``estimation_labels``. A :class:`Simulation` is one experiment of it
with certain values.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fmu_didim.base.errors import DivergedError
from fmu_didim.components import SameObject
from fmu_didim.cosim import Observer, Recording, SampleOperator, System, response_key, simulate
from fmu_didim.data.signals import Array
from fmu_didim.model.experiment import Experiment
from fmu_didim.model.external_torque import EXTERNAL_TORQUE, ExternalTorque, held, with_external_torques
from fmu_didim.model.free_parameter import LOG
from fmu_didim.model.integration import divided
from fmu_didim.model.parametrised_loop import ParametrisedLoop
from fmu_didim.model.workers import may_run_side_by_side


@dataclass(frozen=True)
class LoopModel(ParametrisedLoop):
    """The loop of a description, simulated: torque and residual as functions of the values (p,) of what is free."""

    def simulation(self, values: Array, label: str | None = None) -> Simulation:
        """An experiment, by default the first one, with these values; it runs when something is asked of it."""
        return Simulation(self, values, label or self.first)

    def torque(self, values: Array, label: str | None = None) -> Array:
        """(N, n) simulated torque at the samples of an experiment, by default of all that are fitted; raises
        DivergedError, SimulationError."""
        labels = self.estimation_labels if label is None else (label,)
        return np.concatenate([self.simulation(values, each).torque() for each in labels])

    def residual(self, values: Array, label: str | None = None) -> Array:
        """(N, n) measured minus simulated torque of an experiment, by default of all that are fitted."""
        return (self.measured if label is None else self.measured_in(label)) - self.torque(values, label)

    def allowed_workers(self, values: Array) -> int:
        """How many simulations may run at once: ``workers``, or one where Python runs the loop or an FMU of another
        tool takes part."""
        if self.workers == 1 or not may_run_side_by_side(self.systems[self.first]):
            return 1
        return self.workers if self.simulation(values).record(ticks=np.zeros(1, dtype=np.int64)).compiled else 1


@dataclass(frozen=True, eq=False)
class Simulation:
    """One experiment of a loop with certain values of what is free.

    Attributes:
        model: the loop; values: (p,); label: of the experiment.
    """

    model: LoopModel
    values: Array
    label: str

    def moved(self, i: int, value: float) -> Simulation:
        """The same with another value of a free parameter."""
        values = self.values.copy()
        values[i] = value
        return replace(self, values=values)

    def on(self, experiment: Experiment) -> Simulation:
        """The same with other data."""
        return replace(self, model=self.model.with_experiment(self.label, experiment))

    @property
    def experiment(self) -> Experiment:
        """What was measured, and the reference."""
        return self.model.experiments[self.label]

    @property
    def step_size(self) -> float:
        """Control period, s."""
        return self.model.systems[self.label].step_size

    @property
    def theta(self) -> Array:
        """(b,) base parameters that act here."""
        return self.model.theta(self.values, self.label)

    @cached_property
    def external_torques(self) -> tuple[ExternalTorque, ...]:
        """The torques from outside; their times and sizes may be free parameters."""
        found = list(self.experiment.external_torques)
        for parameter, value in zip(self.model.free_parameters, self.values, strict=True):
            if parameter.owner == EXTERNAL_TORQUE and parameter.experiment == self.label:
                index, _, name = parameter.key.partition(".")
                found[int(index)] = found[int(index)].moved(name, float(value))
        return tuple(found)

    @property
    def log_shift_s(self) -> float:
        """How late the log is stamped, in s, beyond what its operator knows."""
        found = {}
        for parameter, value in zip(self.model.free_parameters, self.values, strict=True):
            if parameter.owner == LOG and parameter.acts_in(self.label):
                found[parameter.key] = float(value)
        return sum(found.values())

    @cached_property
    def operator(self) -> SampleOperator:
        """How the log follows from the command."""
        is_free = any(parameter.owner == LOG for parameter in self.model.free_parameters)
        count, shift = self.experiment.reference.time.size, self.log_shift_s / self.step_size
        return self.experiment.operator.stamped_later(shift, count, between=is_free)

    @cached_property
    def system(self) -> System:
        """The system as it is run, with the ticks that its components need."""
        model, system = self.model, self.model.system(self.values, self.label)
        if model.subdivision == 1:
            return system
        return divided(system, model.plant_name, set(model.added_components), model.subdivision)

    def record(
        self,
        *,
        ticks: NDArray[np.int64] | None = None,
        all_ticks: bool = False,
        system: System | None = None,
        observe: Observer | None = None,
    ) -> Recording:
        """Run it; raises DivergedError, SimulationError.

        Args:
            ticks: to record; by default those that the samples need, with ``all_ticks`` all.
            system: another one like the own; observe: as of :func:`fmu_didim.cosim.simulate`.
        """
        model, reference, external = self.model, self.experiment.reference, self.external_torques
        if ticks is None:
            ticks = np.arange(reference.time.size) if all_ticks else self.operator.ticks
        system = system or self.system
        bounds = model.position_bounds(self.label)
        response, key = response_key(system) if observe is None else None, None
        if response is not None:
            run = (SameObject(reference), external, model.subdivision, ticks.tobytes(), tuple(bounds.items()))
            key = (response, *run)
            if known := model.recordings.find(key):
                return known
        reference = with_external_torques(reference, external)
        if model.subdivision > 1:
            reference, ticks = held(reference, model.subdivision), ticks * model.subdivision
        recording = simulate(system, reference, ticks=ticks, bounds=bounds, observe=observe, pool=model.pool)
        if key is not None:
            model.recordings.keep(key, recording)
        return recording

    def torque(self) -> Array:
        """(N, n) simulated torque at the samples; raises DivergedError, SimulationError."""
        return self.sampled_torque(self.record())

    def sampled_torque(self, recording: Recording) -> Array:
        """(N, n) what the log shows of a recording at its ticks; raises DivergedError."""
        torque = self.operator.apply(self.logged_torque(recording))
        if not np.isfinite(torque).all():
            raise DivergedError("The simulated torque is not finite.", time=float(recording.time[-1]))
        return self.model.filtered(torque, self.label)

    def logged_torque(self, recording: Recording) -> Array:
        """(K, n) what a log would show at the recorded ticks: the inputs without the torques from outside."""
        model, logged, reference = self.model, self.model.logged, self.experiment.reference.time
        torque = np.column_stack([recording.inputs[name] for name in logged])
        for external in self.external_torques:
            reaches_log = logged[external.joint - 1] == f"{model.plant_name}.tau{external.joint}"
            if reaches_log != external.is_logged:
                sign = -1.0 if reaches_log else 1.0
                torque[:, external.joint - 1] += sign * np.interp(recording.time, reference, external.along(reference))
        return torque

    def sampled(self, table: Array) -> Array:
        """(N, ...) samples of values (K, ...) at the ticks of the log, filtered as it is."""
        return self.model.filtered(self.operator.apply(table), self.label)
