"""The closed loop: plant, controller, drives and wiring, and how finely the plant is integrated."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

from fmu_didim.base.errors import UnknownNameError
from fmu_didim.components import Component
from fmu_didim.components.fmu.component import own_step
from fmu_didim.cosim import Connection, System, logged_torque, measured_output
from fmu_didim.cosim.system import REFERENCE
from fmu_didim.data.signals import Array, Trajectory
from fmu_didim.model.experiment import Experiment
from fmu_didim.model.external_torque import EXTERNAL_TORQUE
from fmu_didim.model.free_parameter import DELAY, LOG, PLANT, joint_parameter
from fmu_didim.model.integration import refined, searched
from fmu_didim.model.parameters import Parameters
from fmu_didim.model.signals.path import INPUT, OUTPUT

NO_COMPONENTS = (PLANT, DELAY, LOG, EXTERNAL_TORQUE, INPUT, OUTPUT)
"""Owners of free parameters that are no component beside the plant."""


SAME_STEP = 1e-6
"""[1] Of a step, by which a whole multiple of an FMU's own may differ from it: decimals of a file."""
STANDS_STILL = 0.1
"""[rad or m] Range of a joint whose reference stands still: gravity and friction may hold it that far off."""
MOST_SUBDIVISIONS = 64
"""[1] Of a step over which linear inputs are held: the error falls with its square, and what 64 do not reach is a file
of inputs with far too few rows."""


@dataclass(frozen=True)
class StartValue:
    """A state of the loop whose start can be set.

    Attributes:
        name: ``q1``, ``dq1`` of the plant, ``integral1`` of a controller; with its component, ``axis2.integral1``,
            where another one has the same name.
        owner: ``plant``, or the component; key: its parameter there, ``q_start1``; unit: of that.
        value: without an initial state; NaN where the reference says it.
    """

    name: str
    owner: str
    key: str
    unit: str = ""
    value: float = math.nan

    @property
    def label(self) -> str:
        """Its parameter, with the component where its name has it: ``q_start1``, ``axis2.integral_start1``."""
        return f"{self.owner}.{self.key}" if self.name.startswith(f"{self.owner}.") else self.key


@dataclass(frozen=True)
class Loop:
    """A closed loop that waits for values of its free parameters.

    Attributes:
        systems: label -> the loop along that experiment, with all that is inserted into its wiring.
        parameters: the base parameters, with their regressor where there is one.
        plant: the plant with the effects of its torque balance; plant_name: its name in the loop.
        output_signals: (n,) ``component.output`` that the log shows where it is no torque; empty where it is.
        added_components: name of each component that added effects put into the wiring -> its joint, from 1.
        factors: owner of free factors -> name of each -> component and parameter whose value in an experiment it
            multiplies.
        substep_factor: multiplies the number of integration substeps of the plant.
        substeps: of the plant in a tick at least, where the case states none; None: by the rule for its fastest rate.
        subdivision: ticks in a control period, for components that need shorter steps; inputs are held as without.
        finest: most of these, where shorter steps would be within those of an FMU's own solver.
        follows_hz: of a virtual controller, up to which frequency it follows measured positions; None where the
            controller is that of the machine.
    """

    systems: Mapping[str, System]
    parameters: Parameters
    plant: Component
    plant_name: str = "plant"
    output_signals: tuple[str, ...] = ()
    added_components: Mapping[str, int] = field(default_factory=dict)
    factors: Mapping[str, Mapping[str, tuple[str, str]]] = field(default_factory=dict)
    substep_factor: int = 1
    substeps: int | None = None
    subdivision: int = 1
    finest: int = MOST_SUBDIVISIONS
    follows_hz: float | None = None

    @property
    def is_virtual(self) -> bool:
        """Whether the controller is none of the machine, but a virtual one that follows measured positions."""
        return self.follows_hz is not None

    @property
    def joint_count(self) -> int:
        """Number n of what the log shows together: joints, or outputs of a model."""
        return self.parameters.joint_count

    @property
    def shows_torque(self) -> bool:
        """Whether the log is that of the torque of joints; else of outputs of any model."""
        return not self.output_signals

    @cached_property
    def ramps(self) -> frozenset[str]:
        """Inputs that are linear between their rows, of a plant whose steps can be divided."""
        plant = self.plant
        is_divisible = plant.sample_time is None and plant.takes_any_step
        return frozenset().union(*(system.ramps for system in self.systems.values())) if is_divisible else frozenset()

    @cached_property
    def holds_ramps(self) -> bool:
        """Whether the plant holds inputs that are linear between their rows, so that the length of its steps counts."""
        return bool(self.ramps) and not self.plant.follows_ramps

    @cached_property
    def own_subdivision(self) -> int:
        """Steps that an FMU states for its own solver in one of the loop; 1 where it states none that fits."""
        stated, step = own_step(self.plant), min(system.step_size for system in self.systems.values())
        count = 1 if stated is None else max(round(step / stated), 1)
        return count if stated is None or abs(count * stated - step) <= SAME_STEP * step else 1

    @cached_property
    def subdivisions(self) -> tuple[int, ...]:
        """Numbers of steps into which one may be divided that holds linear inputs, rising: whole multiples of the step
        that an FMU states for its own solver, then halves of the last one."""
        own = self.own_subdivision
        found = [count for count in range(1, min(own, self.finest) + 1) if own % count == 0]
        while 2 * found[-1] <= self.finest:
            found.append(2 * found[-1])
        return tuple(found)

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """(n,) what the columns of the log are called: ``joint 1``, or the output."""
        if self.shows_torque:
            return tuple(f"joint {j}" for j in range(1, self.joint_count + 1))
        return tuple(name.partition(".")[2] for name in self.output_signals)

    @property
    def quantity(self) -> str:
        """What is compared, in a word: the torque of joints, or outputs of any model."""
        return "torque" if self.shows_torque else "output"

    @property
    def output_names(self) -> tuple[str, ...]:
        """(n,) names of the outputs that the log shows; none where it shows the torque of joints."""
        return () if self.shows_torque else self.labels

    @property
    def whole(self) -> str:
        """What carries the identified parameters, in a word."""
        return "plant" if self.shows_torque else "model"

    def system(
        self, label: str, experiment: Experiment, theta: Array, others: Mapping[str, Mapping[str, float]]
    ) -> System:
        """The loop along an experiment with values of the free parameters; all else stays untouched.

        Args:
            theta: (b,) base parameters; others: owner -> name there -> value of every other free parameter.
        """
        system, start = self.systems[label], self.start_values(experiment)
        for samples in others.get(DELAY, {}).values():
            system = system.with_delay(self.plant_name, max(samples, 0.0))
        wanted = {**self.parameters.values(theta), **start, **others.get(PLANT, {})}
        plant = self.plant.with_parameters({name: value for name, value in wanted.items() if name in self.offered})
        plant = self._integrated(plant, theta, start, system.step_size)
        system = system.replace(self.plant_name, plant)
        for of in (self._given_starts(experiment), self._of_components(others, plant, system)):
            for owner, own_values in of.items():
                system = system.replace(owner, system.components[owner].with_parameters(own_values))
        joints = sorted({external.joint for external in experiment.external_torques})
        from_outside = tuple(
            Connection(f"{REFERENCE}.{EXTERNAL_TORQUE}{j}", f"{self.plant_name}.tau{j}") for j in joints
        )
        return replace(system, connections=(*system.connections, *from_outside)) if from_outside else system

    @cached_property
    def _outputs(self) -> frozenset[str]:
        """Names of the outputs of the plant."""
        return frozenset(v.name for v in self.plant.outputs)

    @cached_property
    def offered(self) -> frozenset[str]:
        """Names of the parameters that the plant has."""
        return frozenset(v.name for v in self.plant.parameters)

    def _integrated(self, plant: Component, theta: Array, start: Mapping[str, float], step_size: float) -> Component:
        """The plant with the substeps that the loop asks for."""
        step, factor = step_size / self.subdivision, self.substep_factor
        if self.substeps is not None:
            return searched(plant, self.substeps, factor, step, self.joint_count)
        refines = self.plant.stated_substeps is not None or factor != 1
        return refined(plant, self.parameters.substeps(theta, start, step_size) if refines else None, factor, step)

    def _of_components(
        self, others: Mapping[str, Mapping[str, float]], plant: Component, system: System
    ) -> dict[str, dict[str, float]]:
        """Values of the components beside the plant. Effects of a joint share shapes, such as the smoothing of
        friction, wherever they act."""
        found = {owner: dict(own) for owner, own in others.items() if owner not in NO_COMPONENTS}
        for factor_owner in self.factors.keys() & found.keys():
            for name, value in found.pop(factor_owner).items():
                owner, key = self.factors[factor_owner][name]
                found.setdefault(owner, {})[key] = value * system.components[owner].parameter_values()[key]
        present = {v.name: v.start for v in plant.parameters} if self.added_components else {}
        for owner, joint in self.added_components.items():
            for v in system.components[owner].parameters:
                shared = joint_parameter(v.name, joint, is_shape=True)
                if shared in present:
                    found.setdefault(owner, {}).setdefault(v.name, present[shared])
        return found

    def start_values(self, experiment: Experiment) -> dict[str, float]:
        """Where the plant starts: the first row of the reference, or what is known instead."""
        return experiment.plant_start(self.joint_count if self.shows_torque else 0)

    @cached_property
    def starts(self) -> tuple[StartValue, ...]:
        """The states whose start can be set: positions and velocities of the plant, and those of controllers that offer
        it by parameters ``<state>_start<j>``."""
        if not self.shows_torque:
            return ()
        offered = {v.name: v.unit for v in self.plant.parameters}
        keys = [f"{stem}_start{j}" for stem in ("q", "dq") for j in range(1, self.joint_count + 1)]
        found = [StartValue(state_name(key), PLANT, key, offered[key]) for key in keys if key in offered]
        for owner, component in self.beside_the_plant.items():
            values = {v.name: v for v in component.parameters}
            for key in component.start_parameters:
                name = state_name(key)
                unique = f"{owner}.{name}" if any(name == k.name for k in found) else name
                found.append(StartValue(unique, owner, key, values[key].unit, float(values[key].start or 0.0)))
        return tuple(found)

    @property
    def beside_the_plant(self) -> dict[str, Component]:
        """The components of the loop, without the plant and what effects have added."""
        components = next(iter(self.systems.values())).components
        return {k: v for k, v in components.items() if k != self.plant_name and k not in self.added_components}

    def multiplied(self, label: str, owner: str, name: str) -> tuple[str, str, float]:
        """Component, parameter and change of that parameter by one unit of a free one of this owner and name: of a
        factor the value that it multiplies in an experiment."""
        if owner not in self.factors:
            return owner, name, 1.0
        component, key = self.factors[owner][name]
        return component, key, self.systems[label].components[component].parameter_values()[key]

    @property
    def with_unknown_states(self) -> tuple[str, ...]:
        """Names of the components beside the plant whose states are not known, being FMUs of other tools."""
        beside = self.beside_the_plant.items()
        return tuple(name for name, c in beside if len(c.start_candidates) > len(c.start_parameters))

    def start_named(self, name: str, *, where: str = "") -> StartValue:
        """The state of this name; of an FMU of another tool, whose states are not known, ``component.parameter``.

        Raises:
            UnknownNameError: there is none.
        """
        known = {start.name: start for start in self.starts}
        if name not in known:
            for owner, component in self.beside_the_plant.items():
                keys = {key: state_name(key) for key in component.start_parameters}
                keys |= {key: key for key in component.start_candidates if key not in keys}
                known |= {f"{owner}.{state}": StartValue(f"{owner}.{state}", owner, key) for key, state in keys.items()}
        if name not in known:
            raise UnknownNameError("initial state", name, known, where=where)
        return known[name]

    def _given_starts(self, experiment: Experiment) -> dict[str, dict[str, float]]:
        """Component -> parameter -> value of the given starts beside the plant's."""
        found = dict[str, dict[str, float]]()
        for name, value in experiment.initial_state.values.items():
            start = self.start_named(name)
            if start.owner != PLANT:
                found.setdefault(start.owner, {})[start.key] = value
        return found

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
        drive has a lag or the like; or ``component.output`` that the log shows."""
        if not self.shows_torque:
            return tuple(measured_output(next(iter(self.systems.values())), name) for name in self.output_signals)
        system, joints = next(iter(self.systems.values())), range(1, self.joint_count + 1)
        return tuple(logged_torque(system, j, plant=self.plant_name) for j in joints)

    @cached_property
    def torque_is_given(self) -> bool:
        """Whether the loop is open: the reference holds the torque itself, and of the motion no more than where it
        begins."""
        if not self.shows_torque:
            return False
        wires = next(iter(self.systems.values())).connections
        sources = [[c.source for c in wires if c.target == name] for name in self.logged]
        return all(own and all(source.startswith(f"{REFERENCE}.") for source in own) for own in sources)

    def position_bounds(self, reference: Trajectory, start: Mapping[str, float]) -> dict[str, tuple[float, float]]:
        """Range of positions outside which a simulation counts as diverged: ten times that of the reference and of
        where the joint starts; none in an open loop, which does not follow a reference.

        Args:
            start: ``q<j>`` -> value in rad or m, where the joint starts off the reference.
        """
        result: dict[str, tuple[float, float]] = {}
        if self.torque_is_given or not self.shows_torque:
            return result
        lowest, highest = reference.extremes
        for name in (f"q{j}" for j in range(1, self.joint_count + 1)):
            if name not in self._outputs or name not in reference.names:
                continue
            place = reference.names.index(name)
            extremes = [float(lowest[place]), float(highest[place]), *(start[n] for n in (name,) if n in start)]
            low, high = min(extremes), max(extremes)
            room = 10 * max(high - low, STANDS_STILL)
            result[f"{self.plant_name}.{name}"] = (low - room, high + room)
        return result


def state_name(key: str) -> str:
    """``q1`` of ``q_start1``, the parameter in which it starts."""
    return key.replace("_start", "")
