"""The candidates for what a model alone lacks: each kind on each signal, and the parameters that are not identified."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fmu_didim.checks.outputs.suspects import held_parameters
from fmu_didim.components import FmuComponent
from fmu_didim.components.fmu.description import FLOAT_TYPES
from fmu_didim.data.signals import Array
from fmu_didim.discovery.signals.kinds import KINDS, PARAMETER, Kind, Measures, Side, Values
from fmu_didim.model.free_parameter import FreeParameter, of_experiment
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.signals.path import INPUT, OUTPUT, signal_key

MOST_INPUTS = 30
"""[inputs] On which something is looked for; a file of more is one of many rooms."""
LEVELS_KEPT = 400
"""[values] Of a signal, by which its levels are known well enough."""


@dataclass(frozen=True)
class Candidate:
    """Something that may act on a signal, or a parameter of the model with another value.

    Attributes:
        kind, side, signal: what acts where; unit: of the signal; measures: its sizes.
        labels: of the fitted experiments; known: the parameter itself, where it is one of the model.
    """

    kind: Kind
    side: Side
    signal: str
    unit: str
    measures: Measures
    labels: tuple[str, ...] = ()
    known: FreeParameter | None = None

    @property
    def name(self) -> str:
        """Unique, in words: ``gain of T_out``."""
        return f"{self.kind.name} {self.signal}" if self.known is not None else f"{self.kind.name} of {self.signal}"

    @property
    def title(self) -> str:
        """What it is and where, in words."""
        if self.known is not None:
            return f"{self.kind.title} {self.signal}"
        return f"{self.kind.title} of the {self.side} {self.signal}"

    @property
    def equation(self) -> str:
        """What it does, in one line."""
        return self.kind.equations[self.side].format(self.signal)

    @cached_property
    def cost(self) -> int:
        """Number of its parameters."""
        return len(self.free({}, 0))

    @property
    def starts(self) -> list[dict[str, float]]:
        """Values from which it is fitted."""
        return self.kind.starts(self.measures)

    def free(self, values: Values, index: int) -> list[FreeParameter]:
        """Its free parameters as number ``index`` of what was added, from these values on; those of a start once an
        experiment."""
        if self.known is not None:
            return [replace(self.known, effect=index)]
        found = []
        owner = INPUT if self.side == "input" else OUTPUT
        for place, p in enumerate(self.kind.parameters):
            value = float(values.get(p.name, p.neutral or 0.0))
            scale = p.scale(self.measures) or max(abs(v) for v in (*self.measures.levels, 1.0))
            one = FreeParameter(
                p.words.format(self.signal), p.unit(self.unit), owner, signal_key(self.signal, p.name), value, scale,
                p.lowest(self.measures), p.highest(self.measures), effect=index, is_shape=p.neutral is None,
            )  # fmt: skip
            is_own = self.kind.of_start and place == 0 and len(self.labels) > 1
            found += [of_experiment(one, label) for label in self.labels] if is_own else [one]
        return found

    def neutral(self, parameter: FreeParameter) -> float | None:
        """The value of one of its free parameters with which nothing changes; None of a shape."""
        if self.known is not None:
            return self.known.value
        name = parameter.key.rpartition(":")[2]
        return next(p.neutral for p in self.kind.parameters if p.name == name)


def candidates(model: LoopModel, simulated: Mapping[str, Array], forbid: Iterable[str] = ()) -> list[Candidate]:
    """All candidates of a model.

    Args:
        simulated: output -> (N,) its values in the fitted experiments; forbid: names of kinds that are left out.
    """
    forbidden, labels = set(forbid), model.estimation_labels
    references = [model.experiments[label].reference for label in labels]
    length = max(float(np.ptp(r.time)) for r in references)
    units = {v.name: v.unit for v in (*model.loop.plant.inputs, *model.loop.plant.outputs)}
    found: list[Candidate] = []
    for name in [n for n in references[0].names if n in _real_inputs(model)][:MOST_INPUTS]:
        values = np.concatenate([r.column(name) for r in references])
        step = float(np.median(np.concatenate([np.diff(r.time) for r in references])))
        found += _on("input", name, units.get(name, ""), _measured(values, step, length), labels, forbidden)
    for name, values in simulated.items():
        step = float(np.median(np.concatenate([np.diff(t) for t in _instants(model, name)])))
        found += _on("output", name, units.get(name, ""), _measured(values, step, length), labels, forbidden)
    if PARAMETER.name not in forbidden:
        nothing = Measures((), 0.0, 1.0, length)
        found += [
            Candidate(PARAMETER, "parameter", free.key, free.unit, nothing, labels, free)
            for free in held_parameters(model)
        ]
    return found


def _on(
    side: Side, name: str, unit: str, measures: Measures, labels: Sequence[str], forbidden: set[str]
) -> list[Candidate]:
    moves = measures.span > 0
    return [
        Candidate(kind, side, name, unit, measures, tuple(labels))
        for kind in KINDS
        if side in kind.equations and kind.name not in forbidden and (moves or not kind.moving)
    ]


def _measured(values: Array, step: float, length: float) -> Measures:
    levels = np.sort(values)
    kept = levels[np.linspace(0, levels.size - 1, min(levels.size, LEVELS_KEPT)).astype(int)]
    return Measures(tuple(kept.tolist()), float(np.ptp(levels)), step, length)


def _instants(model: LoopModel, name: str) -> list[Array]:
    """The instants at which an output was measured, experiment by experiment."""
    experiments = [model.experiments[label] for label in model.estimation_labels]
    if name in model.loop.output_names:
        return [e.time for e in experiments]
    return [c.time for e in experiments for c in e.channels if c.name == name]


def _real_inputs(model: LoopModel) -> set[str]:
    """The inputs that are real numbers; nothing is between the values of others."""
    plant = model.loop.plant
    if not isinstance(plant, FmuComponent):
        return {v.name for v in plant.inputs}
    return {v.name for v, kind in zip(plant.inputs, plant.input_types, strict=True) if kind in FLOAT_TYPES}
