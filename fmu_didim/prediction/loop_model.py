"""The closed loop with effects added, as a function from free parameters to the torque at the samples.

    values (p,)  ->  system with these values  ->  closed-loop simulation  ->  torque at the samples (N, n)

The free parameters ("knobs") are the base parameters, nuisances such as the smoothing of Coulomb friction,
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
from fmu_didim.prediction.external_torque import PUSH, Push, held, with_pushes
from fmu_didim.prediction.integration import coarsely, divided
from fmu_didim.prediction.problem import Problem
from fmu_didim.signals import Array

BASE, PLANT, DELAY, LOG = "base", "plant", "delay", "log"


@dataclass(frozen=True)
class Knob:
    """One free parameter.

    Attributes:
        name: unique, shown to the user; unit.
        owner: ``base`` (a base parameter), ``plant``, ``push`` (a torque from outside), ``delay`` (of the command, in
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
class Addition:
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
        pushes: torques from outside that acted in this experiment.
        finer: ticks in a control period, for components that need shorter steps; inputs are held as without.
    """

    problem: Problem
    system: System
    operator: SampleOperator
    pushes: tuple[Push, ...] = ()
    finer: int = 1

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
        knobs: free parameters, the base parameters first.
        additions: the effects, in the order in which they were added.
        workers: simulations side by side.
        coarse: whether the plant is integrated with as few steps as keep it stable.
    """

    runs: Mapping[str, Run]
    plant: Component
    logged: tuple[str, ...]
    knobs: tuple[Knob, ...]
    additions: tuple[Addition, ...] = ()
    workers: int = 2
    joint_count: int = field(default=0)
    coarse: bool = False

    @property
    def start(self) -> Array:
        """(p,) start values of the knobs."""
        return np.array([knob.value for knob in self.knobs])

    @property
    def scales(self) -> Array:
        """(p,) scales of the knobs."""
        return np.array([knob.scale for knob in self.knobs])

    @property
    def limits(self) -> tuple[Array, Array]:
        """(p,) lowest and (p,) highest values."""
        return np.array([k.lowest for k in self.knobs]), np.array([k.highest for k in self.knobs])

    @property
    def base_count(self) -> int:
        """Number of base parameters, which are the first knobs."""
        return sum(knob.owner == BASE for knob in self.knobs)

    def index(self, name: str) -> int:
        """Position of a knob."""
        return [knob.name for knob in self.knobs].index(name)

    def integrated_as(self, values: Array, which: str = "train") -> LoopModel:
        """The same model with the integration steps that it has at these values, wherever its knobs move."""
        if not self.coarse:
            return self
        stated = self.system(values, which).components[self.runs[which].problem.plant].stated_substeps
        plant = self.plant.with_substeps(stated) if stated is not None else None
        return self if plant is None else replace(self, plant=plant)

    def with_values(self, values: Array) -> LoopModel:
        """The same model starting from other values."""
        return replace(self, knobs=tuple(replace(k, value=float(v)) for k, v in zip(self.knobs, values, strict=True)))

    def system(self, values: Array, which: str = "train") -> System:
        """The loop with these values of the knobs."""
        run = self.runs[which]
        problem, system = run.problem, run.system
        count = self.base_count
        by_owner: dict[str, dict[str, float]] = {}
        for knob, value in zip(self.knobs[count:], values[count:], strict=True):
            by_owner.setdefault(knob.owner, {})[knob.key] = float(value)
        for outside in (PUSH, LOG):
            by_owner.pop(outside, None)
        for samples in by_owner.pop(DELAY, {}).values():
            system = system.with_delay(problem.plant, max(problem.delay + samples, 0.0))
        wanted = {**problem.parameters.values(values[:count]), **problem._start_values(), **by_owner.pop(PLANT, {})}
        offered = {v.name for v in self.plant.parameters}
        plant = self.plant.with_parameters({name: value for name, value in wanted.items() if name in offered})
        if self.coarse:
            plant = coarsely(plant, system.step_size / run.finer, self.joint_count)
        system = system.replace(problem.plant, plant)
        present = {v.name: v.start for v in plant.parameters}
        for addition in self.additions:
            # Effects of a joint share shapes, such as the smoothing of friction, wherever they stand.
            owner, names = f"{addition.effect}{addition.joint}", run.system.components
            for v in names[owner].parameters if owner in names else ():
                if f"{v.name}_{addition.joint}" in present:
                    by_owner.setdefault(owner, {}).setdefault(v.name, present[f"{v.name}_{addition.joint}"])
        for owner, own in by_owner.items():
            system = system.replace(owner, system.components[owner].with_parameters(own))
        joints = sorted({push.joint for push in run.pushes})
        pushing = tuple(Connection(f"{REFERENCE}.{PUSH}{j}", f"{problem.plant}.tau{j}") for j in joints)
        return replace(system, connections=(*system.connections, *pushing)) if pushing else system

    def pushes(self, values: Array, which: str = "train") -> tuple[Push, ...]:
        """The torques from outside in an experiment; those of the training data may be knobs."""
        found = list(self.runs[which].pushes)
        if which == "train":
            for knob, value in zip(self.knobs, values, strict=True):
                if knob.owner == PUSH:
                    index, _, name = knob.key.partition(".")
                    found[int(index)] = found[int(index)].moved(name, float(value))
        return tuple(found)

    def log_shift_s(self, values: Array) -> float:
        """How late the log is stamped, in s, beyond what its operator knows."""
        return sum(float(value) for knob, value in zip(self.knobs, values, strict=True) if knob.owner == LOG)

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
        reference = with_pushes(run.problem.experiment.reference, self.pushes(values, which))
        ticks = np.arange(reference.time.size) if all_ticks else self.operator(values, which).ticks
        system = system or self.simulated(values, which)
        if run.finer > 1:
            reference, ticks = held(reference, run.finer), ticks * run.finer
        return simulate(
            system, reference, ticks=ticks, bounds=run.problem.position_bounds(), pool=run.problem.pool
        )  # fmt: skip

    def simulated(self, values: Array, which: str = "train") -> System:
        """The system as it is run, with the ticks that its components need."""
        run, system = self.runs[which], self.system(values, which)
        return divided(system, run.problem, run.finer) if run.finer > 1 else system

    def refined(self, count: int) -> LoopModel:
        """The same loop with other ticks in a control period."""
        return replace(self, runs={label: replace(run, finer=count) for label, run in self.runs.items()})

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
        for push in self.pushes(values, which):
            reaches_log = self.logged[push.joint - 1] == f"{run.problem.plant}.tau{push.joint}"
            if reaches_log != push.is_logged:
                sign = -1.0 if reaches_log else 1.0
                reference = run.problem.experiment.reference.time
                torque[:, push.joint - 1] += sign * np.interp(recording.time, reference, push.along(reference))
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
    knobs = tuple(
        Knob(name, unit, BASE, name, float(value), float(abs(value)) or 1.0, lowest=float(low), highest=float(high))
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
        knobs=knobs,
        workers=workers,
        joint_count=problem.joint_count,
    )
