"""The loop of a description with values in it: a system that runs for each experiment."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

from fmu_didim.components import Component
from fmu_didim.cosim import Connection, System, logged_torque
from fmu_didim.cosim.system import REFERENCE
from fmu_didim.data.signals import Array
from fmu_didim.model.external_torque import EXTERNAL_TORQUE
from fmu_didim.model.free_parameter import DELAY, LOG, PLANT, joint_parameter
from fmu_didim.model.integration import Integration, integration, refined, searched
from fmu_didim.model.loop_description import LoopDescription


@dataclass(frozen=True)
class ParametrisedLoop(LoopDescription):
    """The loop of a description with values (p,) of what is free."""

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

    def integrated_as(self, values: Array) -> Self:
        """The same model with the integration steps that it has at these values, wherever its parameters move."""
        if self.substeps is None:
            return self
        stated = self.system(values).components[self.plant_name].stated_substeps
        plant = self.plant.with_substeps(stated) if stated is not None else None
        return self if plant is None else replace(self, plant=plant)
