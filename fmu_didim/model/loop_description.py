"""What a loop model is about: components and wiring, experiments by label, and what is free anywhere in the loop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import numpy as np

from fmu_didim.components import Component
from fmu_didim.cosim import InstancePool, KeptRecordings, System
from fmu_didim.data.low_pass import LowPass
from fmu_didim.data.signals import Array
from fmu_didim.model.experiment import Experiment
from fmu_didim.model.external_torque import ExternalTorque
from fmu_didim.model.free_parameter import BASE, FreeParameter
from fmu_didim.model.parameters import Parameters
from fmu_didim.model.workers import default_workers


@dataclass(frozen=True)
class EffectAtJoint:
    """An effect at a joint: its name in the catalogue, and the number of the joint, counted from 1."""

    effect: str
    joint: int


@dataclass(frozen=True)
class LoopDescription:
    """A closed loop, its experiments and its free parameters.

    Attributes:
        systems: label -> the loop along that experiment, with all that is inserted into its wiring.
        experiments: label -> data, those for the estimation first.
        parameters: the base parameters, with their regressor where there is one.
        plant: the plant with the effects of its torque balance; plant_name: its name in the loop.
        free_parameters: the base parameters first, those that belong to one experiment next, then all others.
        added_effects: in the order in which they were added; added_components: name of each component that they put
            into the wiring -> its joint, counted from 1.
        torque_deviation: (n,) known standard deviation of the torque noise; estimated when None.
        joint_weights: ``estimated`` divides each joint by its noise, ``equal`` treats them alike.
        low_pass: filter of the torque and of the regressor.
        substep_factor: multiplies the number of integration substeps of the plant.
        substeps: of the plant in a tick at least, where the case states none; None: by the rule for its fastest rate.
        subdivision: ticks in a control period, for components that need shorter steps; inputs are held as without.
        pool: instances that run again; recordings: of the last runs, for those who ask for the same again. Both are
            shared with all models made from this one.
        workers: simulations side by side, where compiled code runs the loop.
    """

    systems: Mapping[str, System]
    experiments: Mapping[str, Experiment]
    parameters: Parameters
    plant: Component
    plant_name: str = "plant"
    free_parameters: tuple[FreeParameter, ...] = ()
    added_effects: tuple[EffectAtJoint, ...] = ()
    added_components: Mapping[str, int] = field(default_factory=dict)
    torque_deviation: Array | None = None
    joint_weights: str = "estimated"
    low_pass: LowPass | None = None
    substep_factor: int = 1
    substeps: int | None = None
    subdivision: int = 1
    pool: InstancePool = field(default_factory=InstancePool, compare=False, repr=False)
    recordings: KeptRecordings = field(default_factory=KeptRecordings, compare=False, repr=False)
    workers: int = field(default_factory=default_workers, compare=False)

    # ---- what is free

    @property
    def joint_count(self) -> int:
        """Number of joints n."""
        return self.parameters.joint_count

    @property
    def names(self) -> tuple[str, ...]:
        """(p,) names of the free parameters."""
        return tuple(parameter.name for parameter in self.free_parameters)

    @property
    def units(self) -> tuple[str, ...]:
        """(p,) FMI unit strings."""
        return tuple(parameter.unit for parameter in self.free_parameters)

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
    def linear_count(self) -> int:
        """Number of base parameters b, shared ones and those of one experiment: the first free parameters."""
        return sum(parameter.owner == BASE for parameter in self.free_parameters)

    def index(self, name: str) -> int:
        """Position of a free parameter."""
        return self.names.index(name)

    def with_values(self, values: Array) -> Self:
        """The same model starting from other values."""
        moved = (replace(k, value=float(v)) for k, v in zip(self.free_parameters, values, strict=True))
        return replace(self, free_parameters=tuple(moved))

    def with_free(self, further: Sequence[FreeParameter]) -> Self:
        """The same model with further free parameters."""
        return replace(self, free_parameters=(*self.free_parameters, *further))

    def base_alone(self) -> Self:
        """The same model with the shared base parameters free and all else as it stands."""
        return replace(self, free_parameters=self.free_parameters[: self.parameters.count])

    def limited(self, values: Array) -> Array:
        """Values (p,) moved into their limits."""
        return np.asarray(np.clip(values, *self.limits))

    def theta(self, values: Array, label: str | None = None) -> Array:
        """Base parameters that act in an experiment, in the order of ``parameters``."""
        theta = values[: self.parameters.count].copy()
        for place, parameter in self._own(label or self.first):
            theta[place] = values[parameter]
        return theta

    def has_own_base(self, label: str) -> bool:
        """Whether an experiment has values of its own for some base parameters."""
        return bool(self._own(label))

    def _own(self, label: str) -> list[tuple[int, int]]:
        """Base parameters of one experiment: place among the base parameters, place among the free ones."""
        found = []
        for i in range(self.parameters.count, self.linear_count):
            parameter = self.free_parameters[i]
            if parameter.experiment == label:
                found.append((self.parameters.names.index(parameter.key), i))
        return found

    def acts(self, i: int, label: str) -> bool:
        """Whether a free parameter acts in an experiment, which may have its own instead."""
        parameter = self.free_parameters[i]
        own = parameter.experiment is None and any(
            (other.owner, other.key, other.experiment) == (parameter.owner, parameter.key, label)
            for other in self.free_parameters
        )
        return parameter.acts_in(label) and not own

    # ---- experiments

    @cached_property
    def estimation_labels(self) -> tuple[str, ...]:
        """Labels of the experiments that are fitted."""
        return tuple(label for label, e in self.experiments.items() if e.role == "estimation")

    @cached_property
    def validation_labels(self) -> tuple[str, ...]:
        """Labels of the experiments that are held out."""
        return tuple(label for label, e in self.experiments.items() if e.role == "validation")

    @property
    def first(self) -> str:
        """Label of the first experiment."""
        return next(iter(self.experiments))

    @property
    def rows(self) -> Mapping[str, slice]:
        """Label of each fitted experiment -> its rows in tables over all of them."""
        found, first = {}, 0
        for label in self.estimation_labels:
            count = self.experiments[label].time.size
            found[label] = slice(first, first + count)
            first += count
        return found

    def measured_in(self, label: str) -> Array:
        """(N, n) torque that the prediction of one experiment is compared with: the log, filtered if asked for."""
        return self.filtered(self.experiments[label].torque, label)

    @property
    def measured(self) -> Array:
        """(N, n) the same of all experiments that are fitted."""
        return np.concatenate([self.measured_in(label) for label in self.estimation_labels])

    def filtered(self, values: Array, label: str) -> Array:
        """Values at the samples (N, ...) of an experiment, filtered if asked for."""
        return values if self.low_pass is None else self.low_pass.apply(values, self.experiments[label].rate_hz)

    def on(self, *labels: str) -> Self:
        """The same model with some of its experiments alone, all of them for the estimation."""
        chosen = {label: replace(self.experiments[label], role="estimation") for label in labels}
        return replace(self, experiments=chosen, systems={label: self.systems[label] for label in labels})

    def with_experiment(self, label: str, experiment: Experiment) -> Self:
        """The same model with other data under a label."""
        return replace(self, experiments={**self.experiments, label: experiment})

    def pushed(self, label: str, external_torques: Sequence[ExternalTorque]) -> Self:
        """The same model with these torques from outside in an experiment, instead of those that it has."""
        experiment = replace(self.experiments[label], external_torques=tuple(external_torques))
        return self.with_experiment(label, experiment)
