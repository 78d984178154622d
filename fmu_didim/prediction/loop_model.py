"""The closed loop as a function from free parameters to the torque at the samples of every experiment.

    values (p,)  ->  system with these values  ->  closed-loop simulation  ->  torque at the samples (N, n)

A :class:`LoopModel` describes components and wiring, the experiments by label, and what is free anywhere in the loop:
base parameters of the robot first, then parameters of the controller, of drives and sensors, the delay, the clock of
the log, and amplitudes and shapes of effects that discovery has added. Tables that speak of several experiments hold
their samples one below the other, in the order of ``estimation_labels``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fmu_didim.components import Component, SameObject
from fmu_didim.errors import DivergedError
from fmu_didim.master import (
    Connection,
    Observer,
    Recording,
    SampleOperator,
    System,
    logged_torque,
    response_key,
    simulate,
)
from fmu_didim.master.system import REFERENCE
from fmu_didim.prediction.external_torque import EXTERNAL_TORQUE, ExternalTorque, held, with_external_torques
from fmu_didim.prediction.free_parameter import DELAY, LOG, PLANT, joint_parameter
from fmu_didim.prediction.integration import Integration, divided, integration, refined, searched
from fmu_didim.prediction.loop_description import LoopDescription
from fmu_didim.prediction.workers import may_run_side_by_side
from fmu_didim.signals import Array


@dataclass(frozen=True)
class LoopModel(LoopDescription):
    """The loop of a description, simulated: torque and residual as functions of the values (p,) of what is free."""

    def system(self, values: Array, label: str | None = None) -> System:
        """The loop of an experiment with these values of the free parameters; all else stays untouched."""
        label = label or self.first
        system, by_owner = self.systems[label], self._by_owner(values, label)
        for samples in by_owner.pop(DELAY, {}).values():
            system = system.with_delay(self.plant_name, max(samples, 0.0))
        theta = self.theta(values, label)
        wanted = {**self.parameters.values(theta), **self.start_values(label), **by_owner.pop(PLANT, {})}
        offered = {v.name for v in self.plant.parameters}
        plant = self.plant.with_parameters({name: value for name, value in wanted.items() if name in offered})
        step, factor = system.step_size / self.subdivision, self.substep_factor
        if self.substeps is not None:
            plant = searched(plant, self.substeps, factor, step, self.joint_count)
        else:
            refines = self.plant.stated_substeps is not None or self.substep_factor != 1
            own = self.parameters.substeps(theta, self.start_values(label), system.step_size) if refines else None
            plant = refined(plant, own, factor, step)
        system = system.replace(self.plant_name, plant)
        self._share_shapes(by_owner, plant, label)
        for owner, own_values in by_owner.items():
            system = system.replace(owner, system.components[owner].with_parameters(own_values))
        joints = sorted({external.joint for external in self.experiments[label].external_torques})
        from_outside = tuple(
            Connection(f"{REFERENCE}.{EXTERNAL_TORQUE}{j}", f"{self.plant_name}.tau{j}") for j in joints
        )
        return replace(system, connections=(*system.connections, *from_outside)) if from_outside else system

    def _by_owner(self, values: Array, label: str) -> dict[str, dict[str, float]]:
        """Values of all but the base parameters: owner -> name there -> value."""
        found: dict[str, dict[str, float]] = {}
        count = self.linear_count
        for parameter, value in zip(self.free_parameters[count:], values[count:], strict=True):
            if parameter.owner not in (EXTERNAL_TORQUE, LOG) and parameter.acts_in(label):
                found.setdefault(parameter.owner, {})[parameter.key] = float(value)
        return found

    def _share_shapes(self, by_owner: dict[str, dict[str, float]], plant: Component, label: str) -> None:
        """Effects of a joint share shapes, such as the smoothing of friction, wherever they stand."""
        present = {v.name: v.start for v in plant.parameters}
        components = self.systems[label].components
        for owner, joint in self.added_components.items():
            for v in components[owner].parameters:
                shared = joint_parameter(v.name, joint, is_shape=True)
                if shared in present:
                    by_owner.setdefault(owner, {}).setdefault(v.name, present[shared])

    def start_values(self, label: str) -> dict[str, float]:
        """Where the plant starts: the first row of the reference."""
        reference = self.experiments[label].reference
        first = dict(zip(reference.names, reference.values[0], strict=True))
        result = {"t_start": float(reference.time[0])}
        for j in range(1, self.joint_count + 1):
            if f"q{j}" in first:
                result[f"q_start{j}"] = float(first[f"q{j}"])
                result[f"dq_start{j}"] = float(first.get(f"dq{j}", 0.0))
        return result

    @property
    def can_refine(self) -> bool:
        """Whether the substeps of the plant can be chosen, so that halving them can be tried."""
        theta, label = self.parameters.nominal(), self.first
        known = self.parameters.substeps(theta, self.start_values(label), self.systems[label].step_size)
        return known is not None and self.plant.with_substeps(2) is not None

    @property
    def chooses_substeps(self) -> bool:
        """Whether the number of substeps is free: the case states none, and the equations of the plant are known."""
        known = self.plant.equations()
        is_continuous = known is not None and known[0].rate_bound is not None
        return is_continuous and self.plant.stated_substeps is None and self.plant.with_substeps(2) is not None

    @property
    def own_states(self) -> int:
        """States of the plant beyond the motion of its joints: bristles, gears, time; 0 where they are not known."""
        known = self.plant.equations()
        return 0 if known is None else len(known[0].states) - 2 * self.joint_count

    def fewest_substeps(self, values: Array) -> int:
        """The fewest substeps of the plant that are stable in all fitted experiments."""
        fewest = replace(self, substeps=1, substep_factor=1)
        systems = (fewest.system(values, label) for label in self.estimation_labels)
        return max(system.components[self.plant_name].stated_substeps or 1 for system in systems)

    def automatic_substeps(self, values: Array) -> int:
        """The substeps of the plant by the rule for its fastest rate."""
        counts = []
        for label in self.estimation_labels:
            system = replace(self, substeps=1, substep_factor=1).system(values, label)
            known = system.components[self.plant_name].equations()
            assert known is not None
            counts.append(known[0].automatic_substeps(system.step_size / self.subdivision))
        return max(counts)

    def integration(self, values: Array) -> Integration | None:
        """How the plant is integrated; None where its equations are not known."""
        system = self.system(values)
        return integration(system.components[self.plant_name], system.step_size / self.subdivision)

    @property
    def gives_acceleration(self) -> bool:
        """Whether the plant has outputs for the accelerations; otherwise they are differences of velocity."""
        offered = {v.name for v in self.plant.outputs}
        return all(f"ddq{j}" in offered for j in range(1, self.joint_count + 1))

    def joint_signals(self, name: str) -> list[str]:
        """``plant.q1``, ``plant.q2``, ... for ``q``."""
        return [f"{self.plant_name}.{name}{j}" for j in range(1, self.joint_count + 1)]

    @cached_property
    def logged(self) -> tuple[str, ...]:
        """(n,) ``component.input`` whose recorded values are the logged torque: of the plant, or before it where a
        drive has a lag or the like."""
        system, joints = self.systems[self.first], range(1, self.joint_count + 1)
        return tuple(logged_torque(system, j, plant=self.plant_name) for j in joints)

    def position_bounds(self, label: str) -> dict[str, tuple[float, float]]:
        """Range of positions outside which a simulation counts as diverged: ten times the reference's."""
        result, reference = {}, self.experiments[label].reference
        given = {v.name for v in self.plant.outputs} & set(reference.names)
        for j in (j for j in range(1, self.joint_count + 1) if f"q{j}" in given):
            column = reference.select([f"q{j}"])
            low, high = float(column.min()), float(column.max())
            room = 10 * max(high - low, 1e-6)
            result[f"{self.plant_name}.q{j}"] = (low - room, high + room)
        return result

    def integrated_as(self, values: Array) -> LoopModel:
        """The same model with the integration steps that it has at these values, wherever its parameters move."""
        if self.substeps is None:
            return self
        stated = self.system(values).components[self.plant_name].stated_substeps
        plant = self.plant.with_substeps(stated) if stated is not None else None
        return self if plant is None else replace(self, plant=plant)

    def external_torques(self, values: Array, label: str | None = None) -> tuple[ExternalTorque, ...]:
        """The torques from outside in an experiment; their times and sizes may be free parameters."""
        label = label or self.first
        found = list(self.experiments[label].external_torques)
        for parameter, value in zip(self.free_parameters, values, strict=True):
            if parameter.owner == EXTERNAL_TORQUE and parameter.experiment == label:
                index, _, name = parameter.key.partition(".")
                found[int(index)] = found[int(index)].moved(name, float(value))
        return tuple(found)

    def log_shift_s(self, values: Array, label: str | None = None) -> float:
        """How late the log is stamped, in s, beyond what its operator knows."""
        label = label or self.first
        found = {}
        for parameter, value in zip(self.free_parameters, values, strict=True):
            if parameter.owner == LOG and parameter.acts_in(label):
                found[parameter.key] = float(value)
        return sum(found.values())

    def operator(self, values: Array, label: str | None = None) -> SampleOperator:
        """How the log of an experiment follows from the command."""
        label = label or self.first
        experiment, step = self.experiments[label], self.systems[label].step_size
        shift = self.log_shift_s(values, label) / step
        is_free = any(parameter.owner == LOG for parameter in self.free_parameters)
        return experiment.operator.stamped_later(shift, experiment.reference.time.size, between=is_free)

    def record(
        self,
        values: Array,
        label: str | None = None,
        *,
        ticks: NDArray[np.int64] | None = None,
        all_ticks: bool = False,
        system: System | None = None,
        observe: Observer | None = None,
    ) -> Recording:
        """Simulate an experiment; raises DivergedError, SimulationError.

        Args:
            ticks: to record; by default those that the samples need, with ``all_ticks`` all.
            system: another one like the own; observe: as of :func:`fmu_didim.master.simulate`.
        """
        label = label or self.first
        reference, external = self.experiments[label].reference, self.external_torques(values, label)
        if ticks is None:
            ticks = np.arange(reference.time.size) if all_ticks else self.operator(values, label).ticks
        system = system or self.simulated(values, label)
        bounds = self.position_bounds(label)
        response, key = response_key(system) if observe is None else None, None
        if response is not None:
            run = (SameObject(reference), external, self.subdivision, ticks.tobytes(), tuple(bounds.items()))
            key = (response, *run)
            if known := self.recordings.find(key):
                return known
        reference = with_external_torques(reference, external)
        if self.subdivision > 1:
            reference, ticks = held(reference, self.subdivision), ticks * self.subdivision
        recording = simulate(system, reference, ticks=ticks, bounds=bounds, observe=observe, pool=self.pool)
        if key is not None:
            self.recordings.keep(key, recording)
        return recording

    def simulated(self, values: Array, label: str | None = None) -> System:
        """The system as it is run, with the ticks that its components need."""
        system = self.system(values, label)
        if self.subdivision == 1:
            return system
        return divided(system, self.plant_name, set(self.added_components), self.subdivision)

    def torque(self, values: Array, label: str | None = None) -> Array:
        """(N, n) simulated torque at the samples of an experiment, by default of all that are fitted."""
        if label is None:
            return np.concatenate([self.torque(values, each) for each in self.estimation_labels])
        return self.sampled_torque(self.record(values, label), values, label)

    def sampled_torque(self, recording: Recording, values: Array, label: str) -> Array:
        """(N, n) what the log of an experiment shows of a recording at its ticks; raises DivergedError."""
        torque = self.operator(values, label).apply(self.logged_torque(recording, values, label))
        if not np.isfinite(torque).all():
            raise DivergedError("The simulated torque is not finite.", time=float(recording.time[-1]))
        return self.filtered(torque, label)

    def logged_torque(self, recording: Recording, values: Array, label: str | None = None) -> Array:
        """(K, n) what a log would show at the recorded ticks: the inputs without the torques from outside."""
        label = label or self.first
        torque = np.column_stack([recording.inputs[name] for name in self.logged])
        for external in self.external_torques(values, label):
            reaches_log = self.logged[external.joint - 1] == f"{self.plant_name}.tau{external.joint}"
            if reaches_log != external.is_logged:
                sign = -1.0 if reaches_log else 1.0
                reference = self.experiments[label].reference.time
                torque[:, external.joint - 1] += sign * np.interp(recording.time, reference, external.along(reference))
        return torque

    def residual(self, values: Array, label: str | None = None) -> Array:
        """(N, n) measured minus simulated torque of an experiment, by default of all that are fitted."""
        return (self.measured if label is None else self.measured_in(label)) - self.torque(values, label)

    def allowed_workers(self, values: Array) -> int:
        """How many simulations may run at once: ``workers``, or one where Python runs the loop or an FMU of another
        tool takes part."""
        if self.workers == 1 or not may_run_side_by_side(self.systems[self.first]):
            return 1
        return self.workers if self.record(values, ticks=np.zeros(1, dtype=np.int64)).compiled else 1
