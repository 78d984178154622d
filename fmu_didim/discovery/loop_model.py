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
from fmu_didim.errors import DivergedError, InputError, SimulationError
from fmu_didim.identification.problem import Problem
from fmu_didim.master import Recording, SampleOperator, System, simulate
from fmu_didim.signals import Array

BASE, PLANT = "base", "plant"
STEP = 1e-4
"""Step of the forward differences, in units of a knob's scale: our loops are smooth to 1e-10, truncation rules."""


@dataclass(frozen=True)
class Knob:
    """One free parameter.

    Attributes:
        name: unique, shown to the user; unit.
        owner: ``base`` (a base parameter), ``plant``, or the name of a spliced component; key: its name there.
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
        operator: how the log follows from the command.
    """

    problem: Problem
    system: System
    operator: SampleOperator

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
    """

    runs: Mapping[str, Run]
    plant: Component
    logged: tuple[str, ...]
    knobs: tuple[Knob, ...]
    additions: tuple[Addition, ...] = ()
    workers: int = 2
    joint_count: int = field(default=0)

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

    def index(self, name: str) -> int:
        """Position of a knob."""
        return [knob.name for knob in self.knobs].index(name)

    def with_values(self, values: Array) -> LoopModel:
        """The same model starting from other values."""
        return replace(self, knobs=tuple(replace(k, value=float(v)) for k, v in zip(self.knobs, values, strict=True)))

    def system(self, values: Array, which: str = "train") -> System:
        """The loop with these values of the knobs."""
        run = self.runs[which]
        problem, system = run.problem, run.system
        count = sum(knob.owner == BASE for knob in self.knobs)
        by_owner: dict[str, dict[str, float]] = {}
        for knob, value in zip(self.knobs[count:], values[count:], strict=True):
            by_owner.setdefault(knob.owner, {})[knob.key] = float(value)
        wanted = {**problem.parameters.values(values[:count]), **problem._start_values(), **by_owner.pop(PLANT, {})}
        offered = {v.name for v in self.plant.parameters}
        plant = self.plant.with_parameters({name: value for name, value in wanted.items() if name in offered})
        system = system.replace(problem.plant, plant)
        for owner, own in by_owner.items():
            system = system.replace(owner, system.components[owner].with_parameters(own))
        return system

    def record(self, values: Array, which: str = "train", *, all_ticks: bool = False) -> Recording:
        """Simulate; raises DivergedError, SimulationError."""
        run = self.runs[which]
        return simulate(
            self.system(values, which),
            run.problem.experiment.reference,
            ticks=None if all_ticks else run.operator.ticks,
            bounds=run.problem.position_bounds(),
            pool=run.problem.pool,
        )

    def torque(self, values: Array, which: str = "train") -> Array:
        """(N, n) simulated torque at the samples."""
        recording = self.record(values, which)
        run = self.runs[which]
        torque = run.operator.apply(np.column_stack([recording.inputs[name] for name in self.logged]))
        if not np.isfinite(torque).all():
            raise DivergedError("The simulated torque is not finite.", time=float(recording.time[-1]))
        return run.problem.filtered(torque)

    def residual(self, values: Array, which: str = "train") -> Array:
        """(N, n) measured minus simulated torque."""
        return self.runs[which].measured - self.torque(values, which)

    def sensitivity(self, values: Array, torque: Array, which: str = "train", *, only: Sequence[int] = ()) -> Array:
        """d torque / d values, (N, n, p) or of ``only`` some knobs, by forward differences."""
        chosen = list(only) if len(only) else list(range(len(self.knobs)))
        return np.stack(self.side_by_side([self._column(i, values, torque, which) for i in chosen]), axis=2)

    def _column(self, i: int, values: Array, torque: Array, which: str) -> Callable[[], Array]:
        def difference() -> Array:
            knob = self.knobs[i]
            for size in (STEP, -STEP, STEP / 30):
                moved = values.copy()
                moved[i] = values[i] + size * knob.scale
                if not knob.lowest <= moved[i] <= knob.highest:
                    continue
                try:
                    return np.asarray((self.torque(moved, which) - torque) / (moved[i] - values[i]))
                except SimulationError:
                    continue
            return np.zeros_like(torque)  # a knob that cannot be moved explains nothing

        return difference

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
        Knob(
            name,
            unit,
            BASE,
            name,
            float(value),
            float(abs(value)) or 1.0,
            lowest=float(low),
            highest=float(high),
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
        knobs=knobs,
        workers=workers,
        joint_count=problem.joint_count,
    )
