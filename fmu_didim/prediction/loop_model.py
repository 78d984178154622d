"""The closed loop with effects added, as a function from free parameters to the torque at the samples.

    values (p,)  ->  system with these values  ->  closed-loop simulation  ->  torque at the samples (N, n)

The free parameters ("free parameters") are the base parameters, nuisances such as the smoothing of Coulomb friction,
and the amplitudes and shapes of the effects added so far.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np

from fmu_didim.components import Component
from fmu_didim.errors import DivergedError, InputError
from fmu_didim.master import Connection, Recording, SampleOperator, System, simulate
from fmu_didim.master.system import REFERENCE
from fmu_didim.prediction.external_torque import EXTERNAL_TORQUE, ExternalTorque, held, with_external_torques
from fmu_didim.prediction.integration import coarsely, divided
from fmu_didim.prediction.problem import Problem
from fmu_didim.signals import Array

BASE, PLANT, DELAY, LOG = "base", "plant", "delay", "log"


@dataclass(frozen=True)
class FreeParameter:
    """One free parameter.

    Attributes:
        name: unique, shown to the user; unit.
        owner: ``base`` (a base parameter), ``plant``, ``external torque`` (a torque from outside), ``delay`` (of the
        command, in
            samples, beyond that of the problem), ``log`` (how late it is stamped, in s), or the name of a spliced
            component; key: its name there.
        value: where it starts; scale: size of a noticeable change.
        lowest, highest: limits.
        effect: index of the addition it belongs to, None for base parameters and nuisances.
        is_shape: whether it enters nonlinearly.
    """

    name: str
    unit: str
    owner: str
    key: str
    value: float
    scale: float
    lowest: float = -np.inf
    highest: float = np.inf
    effect: int | None = None
    is_shape: bool = False


@dataclass(frozen=True)
class EffectAtJoint:
    """An effect added to the loop: its name in the catalogue and its joint, counted from 1."""

    effect: str
    joint: int


@dataclass(frozen=True)
class Run:
    """One experiment as the loop model sees it.

    Attributes:
        problem: base system, data and instances kept for re-runs.
        system: with all splices.
        operator: how the log follows from the command, by the stamps that it has.
        external torques: torques from outside that acted in this experiment.
        finer: ticks in a control period, for components that need shorter steps; inputs are held as without.
    """

    problem: Problem
    system: System
    operator: SampleOperator
    external_torques: tuple[ExternalTorque, ...] = ()
    subdivision: int = 1

    @property
    def measured(self) -> Array:
        """(N, n) measured torque."""
        return self.problem.measured


@dataclass(frozen=True)
class LoopModel:
    """A closed loop with effects.

    Attributes:
        runs: by label, ``train`` first; plant: the plant with the effects of its torque balance.
        logged: (n,) ``component.input`` whose recorded values are the logged torque.
        free parameters: free parameters, the base parameters first.
        additions: the effects, in the order in which they were added.
        workers: simulations side by side.
        coarse: whether the plant is integrated with as few steps as keep it stable.
    """

    runs: Mapping[str, Run]
    plant: Component
    logged: tuple[str, ...]
    free_parameters: tuple[FreeParameter, ...]
    added_effects: tuple[EffectAtJoint, ...] = ()
    workers: int = 2
    joint_count: int = field(default=0)
    coarse: bool = False

    @property
    def start(self) -> Array:
        """(p,) start values of the free parameters."""
        return np.array([parameter.value for parameter in self.free_parameters])

    @property
    def scales(self) -> Array:
        """(p,) scales of the free parameters."""
        return np.array([parameter.scale for parameter in self.free_parameters])

    @property
    def limits(self) -> tuple[Array, Array]:
        """(p,) lowest and (p,) highest values."""
        return np.array([k.lowest for k in self.free_parameters]), np.array([k.highest for k in self.free_parameters])

    @property
    def base_count(self) -> int:
        """Number of base parameters, which are the first free parameters."""
        return sum(parameter.owner == BASE for parameter in self.free_parameters)

    def index(self, name: str) -> int:
        """Position of a free parameter."""
        return [parameter.name for parameter in self.free_parameters].index(name)

    def integrated_as(self, values: Array, which: str = "train") -> LoopModel:
        """The same model with the integration steps that it has at these values, wherever its free parameters move."""
        if not self.coarse:
            return self
        stated = self.system(values, which).components[self.runs[which].problem.plant].stated_substeps
        plant = self.plant.with_substeps(stated) if stated is not None else None
        return self if plant is None else replace(self, plant=plant)

    def with_values(self, values: Array) -> LoopModel:
        """The same model starting from other values."""
        return replace(
            self,
            free_parameters=tuple(
                replace(k, value=float(v)) for k, v in zip(self.free_parameters, values, strict=True)
            ),
        )

    def system(self, values: Array, which: str = "train") -> System:
        """The loop with these values of the free parameters."""
        run = self.runs[which]
        problem, system = run.problem, run.system
        count = self.base_count
        by_owner: dict[str, dict[str, float]] = {}
        for parameter, value in zip(self.free_parameters[count:], values[count:], strict=True):
            by_owner.setdefault(parameter.owner, {})[parameter.key] = float(value)
        for outside in (EXTERNAL_TORQUE, LOG):
            by_owner.pop(outside, None)
        for samples in by_owner.pop(DELAY, {}).values():
            system = system.with_delay(problem.plant, max(problem.delay + samples, 0.0))
        wanted = {**problem.parameters.values(values[:count]), **problem._start_values(), **by_owner.pop(PLANT, {})}
        offered = {v.name for v in self.plant.parameters}
        plant = self.plant.with_parameters({name: value for name, value in wanted.items() if name in offered})
        if self.coarse:
            plant = coarsely(plant, system.step_size / run.subdivision, self.joint_count)
        system = system.replace(problem.plant, plant)
        present = {v.name: v.start for v in plant.parameters}
        for effect_at in self.added_effects:
            # Effects of a joint share shapes, such as the smoothing of friction, wherever they stand.
            owner, names = f"{effect_at.effect}{effect_at.joint}", run.system.components
            for v in names[owner].parameters if owner in names else ():
                if f"{v.name}_{effect_at.joint}" in present:
                    by_owner.setdefault(owner, {}).setdefault(v.name, present[f"{v.name}_{effect_at.joint}"])
        for owner, own in by_owner.items():
            system = system.replace(owner, system.components[owner].with_parameters(own))
        joints = sorted({external.joint for external in run.external_torques})
        from_outside = tuple(Connection(f"{REFERENCE}.{EXTERNAL_TORQUE}{j}", f"{problem.plant}.tau{j}") for j in joints)
        return replace(system, connections=(*system.connections, *from_outside)) if from_outside else system

    def external_torques(self, values: Array, which: str = "train") -> tuple[ExternalTorque, ...]:
        """The torques from outside in an experiment; those of the training data may be free parameters."""
        found = list(self.runs[which].external_torques)
        if which == "train":
            for parameter, value in zip(self.free_parameters, values, strict=True):
                if parameter.owner == EXTERNAL_TORQUE:
                    index, _, name = parameter.key.partition(".")
                    found[int(index)] = found[int(index)].moved(name, float(value))
        return tuple(found)

    def log_shift_s(self, values: Array) -> float:
        """How late the log is stamped, in s, beyond what its operator knows."""
        return sum(
            float(value)
            for parameter, value in zip(self.free_parameters, values, strict=True)
            if parameter.owner == LOG
        )

    def operator(self, values: Array, which: str = "train") -> SampleOperator:
        """How the log of an experiment follows from the command."""
        run = self.runs[which]
        experiment, step = run.problem.experiment, run.problem.system.step_size
        return run.operator.stamped_later(self.log_shift_s(values) / step, experiment.reference.time.size)

    def record(
        self, values: Array, which: str = "train", *, all_ticks: bool = False, system: System | None = None
    ) -> Recording:
        """Simulate, another system like the own one if given; raises DivergedError, SimulationError."""
        run = self.runs[which]
        reference = with_external_torques(run.problem.experiment.reference, self.external_torques(values, which))
        ticks = np.arange(reference.time.size) if all_ticks else self.operator(values, which).ticks
        system = system or self.simulated(values, which)
        if run.subdivision > 1:
            reference, ticks = held(reference, run.subdivision), ticks * run.subdivision
        return simulate(
            system, reference, ticks=ticks, bounds=run.problem.position_bounds(), pool=run.problem.pool
        )  # fmt: skip

    def simulated(self, values: Array, which: str = "train") -> System:
        """The system as it is run, with the ticks that its components need."""
        run, system = self.runs[which], self.system(values, which)
        return divided(system, run.problem, run.subdivision) if run.subdivision > 1 else system

    def refined(self, count: int) -> LoopModel:
        """The same loop with other ticks in a control period."""
        return replace(self, runs={label: replace(run, subdivision=count) for label, run in self.runs.items()})

    def torque(self, values: Array, which: str = "train") -> Array:
        """(N, n) simulated torque at the samples."""
        recording = self.record(values, which)
        run = self.runs[which]
        torque = self.operator(values, which).apply(self.logged_torque(recording, values, which))
        if not np.isfinite(torque).all():
            raise DivergedError("The simulated torque is not finite.", time=float(recording.time[-1]))
        return run.problem.filtered(torque)

    def logged_torque(self, recording: Recording, values: Array, which: str = "train") -> Array:
        """(K, n) what a log would show at the recorded ticks: the inputs without the torques from outside."""
        run = self.runs[which]
        torque = np.column_stack([recording.inputs[name] for name in self.logged])
        for external in self.external_torques(values, which):
            reaches_log = self.logged[external.joint - 1] == f"{run.problem.plant}.tau{external.joint}"
            if reaches_log != external.is_logged:
                sign = -1.0 if reaches_log else 1.0
                reference = run.problem.experiment.reference.time
                torque[:, external.joint - 1] += sign * np.interp(recording.time, reference, external.along(reference))
        return torque

    def residual(self, values: Array, which: str = "train") -> Array:
        """(N, n) measured minus simulated torque."""
        return self.runs[which].measured - self.torque(values, which)

    def side_by_side(self, tasks: Sequence[Callable[[], Array]]) -> list[Array]:
        """Results of tasks that simulate: compiled loops release Python's lock."""
        if self.workers < 2 or len(tasks) < 2:
            return [task() for task in tasks]
        with ThreadPoolExecutor(self.workers) as threads:
            return list(threads.map(lambda task: task(), tasks))


def loop_model(problem: Problem, others: Mapping[str, Problem], *, workers: int = 2) -> LoopModel:
    """The base model of a problem, with further experiments under their labels.

    Raises:
        InputError: the problem has no torque inputs to compare.
    """
    if problem.joint_count < 1:
        raise InputError("There is no joint to look at.", where="discover")
    parameters = problem.parameters
    nominal = parameters.nominal()
    free_parameters = tuple(
        FreeParameter(
            name, unit, BASE, name, float(value), float(abs(value)) or 1.0, lowest=float(low), highest=float(high)
        )
        for name, unit, value, low, high in zip(
            parameters.names,
            parameters.units,
            nominal,
            parameters.limited(np.full(nominal.size, -np.inf)),
            parameters.limited(np.full(nominal.size, np.inf)),
            strict=True,
        )
    )
    runs = {
        label: Run(each, each.system, each.experiment.operator) for label, each in {"train": problem, **others}.items()
    }
    return LoopModel(
        runs=runs,
        plant=problem.system.components[problem.plant],
        logged=tuple(f"{problem.plant}.tau{j}" for j in range(1, problem.joint_count + 1)),
        free_parameters=free_parameters,
        workers=workers,
        joint_count=problem.joint_count,
    )
