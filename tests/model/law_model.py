"""A loop model whose torque is a formula: the solver and the sensitivities see nothing else of a loop."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from fmu_didim.data.signals import Array
from fmu_didim.model.free_parameter import PLANT, FreeParameter
from fmu_didim.model.loop_description import EffectAtJoint
from fmu_didim.model.loop_model import Simulation

Law = Callable[[Mapping[str, float], str], Array]
"""Values by name, label of an experiment -> torque (N, n)."""


def free(name: str, value: float, low: float = -np.inf, high: float = np.inf, **more: Any) -> FreeParameter:
    """A free parameter, of the plant by default."""
    return FreeParameter(
        name, "1", more.pop("owner", PLANT), name, value, more.pop("scale", 1.0), lowest=low, highest=high, **more
    )


@dataclass(frozen=True)
class LawModel:
    """A closed loop of which only the torque is known.

    Attributes:
        law: the torque; data: label -> measured (N, n), those that are fitted; held_out: labels of the others.
        refuse: why values cannot be simulated, or nothing.
        calls: of the law, values and label.
    """

    law: Law
    data: Mapping[str, Array]
    free_parameters: tuple[FreeParameter, ...]
    held_out: tuple[str, ...] = ()
    refuse: Callable[[Mapping[str, float]], str] = lambda values: ""
    added_effects: tuple[EffectAtJoint, ...] = ()
    workers: int = 1
    substeps: int | None = None
    can_refine: bool = True
    own_states: int = 0
    low_pass: Any = "filtered"
    experiments: Mapping[str, Any] = field(default_factory=dict)
    calls: list[tuple[tuple[float, ...], str]] = field(default_factory=list, compare=False)
    plant_name: str = "plant"

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(parameter.name for parameter in self.free_parameters)

    @property
    def start(self) -> Array:
        return np.array([parameter.value for parameter in self.free_parameters], dtype=float)

    @property
    def limits(self) -> tuple[Array, Array]:
        return (
            np.array([parameter.lowest for parameter in self.free_parameters]),
            np.array([parameter.highest for parameter in self.free_parameters]),
        )

    @property
    def measured(self) -> Array:
        return np.concatenate(list(self.data.values()))

    @property
    def estimation_labels(self) -> tuple[str, ...]:
        return tuple(self.data)

    @property
    def validation_labels(self) -> tuple[str, ...]:
        return self.held_out

    @property
    def rows(self) -> dict[str, slice]:
        found, first = {}, 0
        for label, table in self.data.items():
            found[label] = slice(first, first + table.shape[0])
            first += table.shape[0]
        return found

    @property
    def joint_count(self) -> int:
        return int(self.measured.shape[1])

    @property
    def linear_count(self) -> int:
        return len(self.free_parameters)

    @property
    def plant(self) -> Any:
        return SimpleNamespace(parameters=(), equations=lambda: None)

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
        own = tuple(replace(p, value=float(v)) for p, v in zip(self.free_parameters, values, strict=True))
        return replace(self, free_parameters=own)

    def integrated_as(self, values: Array) -> LawModel:
        return self

    def acts(self, i: int, label: str) -> bool:
        return self.free_parameters[i].experiment in (None, label)

    def allowed_workers(self, values: Array) -> int:
        return self.workers

    def torque(self, values: Array, label: str | None = None) -> Array:
        labels = self.estimation_labels if label is None else (label,)
        named = dict(zip(self.names, (float(v) for v in values), strict=True))
        for one in labels:
            self.calls.append((tuple(named.values()), one))
        return np.concatenate([self.law(named, one) for one in labels])

    def simulation(self, values: Array, label: str) -> LawSimulation:
        return LawSimulation(self, values, label)  # type: ignore[arg-type]

    def residual(self, values: Array, label: str | None = None) -> Array:
        measured = self.measured if label is None else self.data[label]
        return measured - self.torque(values, label)


class LawSimulation(Simulation):
    """An experiment of a law model."""

    @property
    def system(self) -> Any:
        """A loop with a component whose equations are not known."""
        name, plant = self.model.plant_name, self.model.plant
        return SimpleNamespace(connections=(), order=(name,), components={name: plant})

    def torque(self) -> Array:
        return self.model.torque(self.values, self.label)


GUARDED = {"any": SimpleNamespace(reference=SimpleNamespace(names=(), time=np.arange(3.0)))}
"""Experiments of a model whose values the guard looks at."""
