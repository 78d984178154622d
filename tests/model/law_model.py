"""A loop model whose torque is a formula: the solver and the sensitivities see nothing else of a loop."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from fmu_didim.data.signals import Array
from fmu_didim.model.free_parameter import PLANT, FreeParameter, FreeParameters
from fmu_didim.model.loop_model import EffectAtJoint, Simulation

Law = Callable[[Mapping[str, float], str], Array]
"""Values by name, label of an experiment -> torque (N, n)."""


def free(name: str, value: float, low: float = -np.inf, high: float = np.inf, **more: Any) -> FreeParameter:
    """A free parameter, of the plant by default."""
    return FreeParameter(
        name, "1", more.pop("owner", PLANT), name, value, more.pop("scale", 1.0), lowest=low, highest=high, **more
    )


UNKNOWN = SimpleNamespace(parameters=(), equations=lambda: None)
"""A plant whose equations are not known."""


@dataclass(frozen=True)
class LawModel:
    """A closed loop of which only the torque is known.

    Attributes:
        law: the torque; data: label -> measured (N, n), those that are fitted; held_out: labels of the others.
        refuse: why values cannot be simulated, or nothing.
        logs: label -> experiment, for what looks at them.
        calls: of the law, values and label.
    """

    law: Law
    data: Mapping[str, Array]
    free_parameters: FreeParameters | tuple[FreeParameter, ...]
    held_out: tuple[str, ...] = ()
    refuse: Callable[[Mapping[str, float]], str] = lambda values: ""
    added_effects: tuple[EffectAtJoint, ...] = ()
    workers: int = 1
    substeps: int | None = None
    can_refine: bool = True
    own_states: int = 0
    low_pass: Any = "filtered"
    logs: Mapping[str, Any] = field(default_factory=dict)
    calls: list[tuple[tuple[float, ...], str]] = field(default_factory=list, compare=False)
    plant_name: str = "plant"
    plant: Any = field(default_factory=lambda: UNKNOWN)
    prior: None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "free_parameters", FreeParameters(self.free_parameters))

    def beside_prior(self, table: Array) -> Array:
        """Nothing is known before."""
        return table

    @property
    def loop(self) -> LawLoop:
        return LawLoop(self)

    @property
    def experiments(self) -> LawExperiments:
        return LawExperiments(self)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(parameter.name for parameter in self.free_parameters)

    @property
    def start(self) -> Array:
        return np.array([parameter.value for parameter in self.free_parameters], dtype=float)

    @property
    def measured(self) -> Array:
        return np.concatenate(list(self.data.values()))

    @property
    def measured_outputs(self) -> Array:
        return self.measured

    @property
    def output_counts(self) -> Array:
        return np.full(self.joint_count, float(self.measured.shape[0]))

    @property
    def stated_deviations(self) -> Array:
        return np.full(self.joint_count, np.nan)

    @property
    def estimation_labels(self) -> tuple[str, ...]:
        return tuple(self.data)

    @property
    def joint_count(self) -> int:
        return int(self.measured.shape[1])

    @property
    def linear_count(self) -> int:
        return len(self.free_parameters)

    @property
    def parameters(self) -> Any:
        """What the guard asks, where theta are the values themselves; the plant's names are those of the model."""
        return SimpleNamespace(
            names=self.names, plant_names=self.names,
            inertia_problem=lambda positions, values: self.refuse(dict(zip(self.names, values, strict=True))),
        )  # fmt: skip

    def theta(self, values: Array, label: str | None = None) -> Array:
        return values

    def with_values(self, values: Array) -> LawModel:
        return replace(self, free_parameters=FreeParameters(self.free_parameters).with_values(values))

    def with_free(self, free_parameters: Iterable[FreeParameter]) -> LawModel:
        return replace(self, free_parameters=FreeParameters(free_parameters))

    def integrated_as(self, values: Array) -> LawModel:
        return self

    @property
    def threads(self) -> int:
        return self.workers

    def allowed_workers(self, values: Array) -> int:
        return self.workers

    @property
    def workers_from_start(self) -> int:
        return self.workers

    def torque(self, values: Array, label: str | None = None) -> Array:
        labels = self.estimation_labels if label is None else (label,)
        named = dict(zip(self.names, (float(v) for v in values), strict=True))
        for one in labels:
            self.calls.append((tuple(named.values()), one))
        return np.concatenate([self.law(named, one) for one in labels])

    def outputs(self, values: Array) -> Array:
        return self.torque(values)

    def torque_of(self, outputs: Array) -> Array:
        return outputs

    def simulation(self, values: Array, label: str) -> LawSimulation:
        return LawSimulation(self, values, label)  # type: ignore[arg-type]

    def output_residual(self, values: Array) -> Array:
        return self.residual(values)

    def residual(self, values: Array, label: str | None = None) -> Array:
        measured = self.measured if label is None else self.data[label]
        return measured - self.torque(values, label)


class LawLoop:
    """The loop of a law model, as far as the solver and the sensitivities look at it."""

    shows_torque, quantity, whole = True, "torque", "plant"

    def __init__(self, model: LawModel) -> None:
        self.plant, self.plant_name = model.plant, model.plant_name
        self.substeps, self.own_states = model.substeps, model.own_states

    @staticmethod
    def multiplied(label: str, owner: str, name: str) -> tuple[str, str, float]:
        """No effect has factors of gains here."""
        return owner, name, 1.0


class LawExperiments(dict[str, Any]):
    """The experiments of a law model, and the places of those that are fitted."""

    def __init__(self, model: LawModel) -> None:
        super().__init__(model.logs)
        self.validation_labels, self.low_pass, self.rows = model.held_out, model.low_pass, {}
        self.output_rows, self.channels, first = self.rows, (), 0
        for label, table in model.data.items():
            self.rows[label] = slice(first, first + table.shape[0])
            first += table.shape[0]
        self.estimation_labels = tuple(self.rows)

    def blocks(self, table: Array) -> list[tuple[slice, Array]]:
        return [(slice(0, table.shape[1]), table)]


class LawSimulation(Simulation):
    """An experiment of a law model."""

    integration_steps = 0

    @property
    def system(self) -> Any:
        """A loop with a component whose equations are not known."""
        name, plant = self.model.loop.plant_name, self.model.loop.plant
        return SimpleNamespace(connections=(), order=(name,), components={name: plant})

    @property
    def experiment(self) -> Any:
        """One without further channels, unless the model has its own."""
        return self.model.logs.get(self.label, SimpleNamespace(channels=(), scale=None))  # type: ignore[attr-defined]

    def torque(self) -> Array:
        return self.model.torque(self.values, self.label)

    def outputs(self) -> Array:
        return self.torque()


GUARDED = {"any": SimpleNamespace(channels=(), reference=SimpleNamespace(names=(), time=np.arange(3.0)))}
"""Experiments of a model whose values the guard looks at."""
