"""Fits, candidates and builders by hand: their torques are tables, nothing is simulated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from fmu_didim.base.errors import SimulationError
from fmu_didim.data.signals import Array
from fmu_didim.discovery.selection.candidates import FittedCandidate
from fmu_didim.dynamics.effects import Search
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.noise.noise import Noise
from fmu_didim.model.free_parameter import PLANT, FreeParameter
from fmu_didim.model.loop_model import EffectAtJoint

SAMPLES = 400
SIGNS = np.where(np.arange(SAMPLES) % 2 == 0, 1.0, -1.0)
"""Neighbours that differ in sign: every sample of it counts as independent."""


def noise(deviation: Sequence[float] = (1.0,), *, correlation: float = 0.0, period_s: float | None = None) -> Noise:
    """White noise, or noise of one correlation, on each joint."""
    return Noise(np.array(deviation), np.full(len(deviation), correlation), "periods", period_s)


def residual(*mean_squares: float) -> Array:
    """(SAMPLES, n) of the given mean squares."""
    return np.column_stack([np.sqrt(m) * SIGNS for m in mean_squares])


@dataclass(frozen=True)
class TableModel:
    """A model whose residuals are tables: of the data that are fitted, and of each held-out experiment.

    Attributes:
        held_out: label -> residual; None for a model that cannot be run there.
    """

    own: Array
    held_out: Mapping[str, Array | None] = field(default_factory=dict)
    added_effects: tuple[EffectAtJoint, ...] = ()
    free_parameters: tuple[FreeParameter, ...] = ()
    rate_hz: float = 10.0
    workers: int = 1
    is_virtual: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(p.name for p in self.free_parameters)

    @property
    def loop(self) -> Any:
        return SimpleNamespace(is_virtual=self.is_virtual)

    @property
    def measured(self) -> Array:
        return self.own

    @property
    def measured_outputs(self) -> Array:
        return self.own

    def torque_of(self, outputs: Array) -> Array:
        return outputs

    @property
    def joint_count(self) -> int:
        return int(self.own.shape[1])

    @property
    def experiments(self) -> Any:
        return TableExperiments(self)

    @property
    def start(self) -> Array:
        return np.array([parameter.value for parameter in self.free_parameters])

    def output_residual(self, values: Array) -> Array:
        return self.residual(values)

    def allowed_workers(self, values: Array) -> int:
        return self.workers

    def residual(self, values: Array, label: str | None = None) -> Array:
        table = self.own if label in (None, "fitted") else self.held_out[label]
        if table is None:
            raise SimulationError("It diverges.", next_step="Change it.")
        return table


class TableExperiments(dict[str, Any]):
    """The experiments of a table model: their rate is all that is known of them."""

    def __init__(self, model: TableModel) -> None:
        super().__init__({label: SimpleNamespace(rate_hz=model.rate_hz) for label in ("fitted", *model.held_out)})
        self.validation_labels, self.low_pass = tuple(model.held_out), None
        self.estimation_labels, self.channels = ("fitted",), ()

    def blocks(self, table: Array) -> list[tuple[slice, Array]]:
        return [(slice(0, table.shape[1]), table)]


def fit_of(
    model: TableModel, *, values: Sequence[float] = (), jacobian: Array | None = None, white: Noise | None = None
) -> Fit:
    """A fit that leaves the model's table, with white noise of size one unless another is given."""
    table = model.own
    known = noise(np.ones(table.shape[1])) if white is None else white
    slopes = np.zeros((*table.shape, 0)) if jacobian is None else jacobian
    square = float(np.sum(table**2))
    return Fit(model, np.array(values), np.zeros_like(table), slopes, known, np.ones(table.shape[1]), square)


def table_fit(*mean_squares: float, held_out: Mapping[str, Array | None] | None = None, **more: Any) -> Fit:
    """A fit that leaves these mean squares on the joints."""
    return fit_of(TableModel(residual(*mean_squares), held_out or {}, **more))


def candidate_of(
    effect: str = "coulomb", joint: int = 1, *, bic: float = 100.0, size: float = 3.0, share: float = 0.5,
    change: float = 3.0, cost: float = 1.0, fit: Fit | None = None, implausible: str = "",
    unusual: str = "", is_known: bool = False, bends_gear: bool = False,
) -> FittedCandidate:  # fmt: skip
    """A candidate that is accepted as it stands."""
    at = EffectAtJoint(effect, joint)
    parameter = FreeParameter(f"{effect}{joint}", "N.m", PLANT, f"{effect}{joint}", 2.5, 1.0, effect=0)
    if fit is None:
        fit = fit_of(TableModel(residual(10.0), {}, (at,), (parameter,)), values=[2.5])
    return FittedCandidate(
        at, fit, bic, size, share, change, cost, implausible, unusual, is_known=is_known, bends_gear=bends_gear
    )  # fmt: skip


def effect_of(name: str, *, class_name: str | None = None, place: str = "joint", **more: Any) -> Any:
    """An effect of the catalogue, as far as decisions look at it."""
    known = dict(
        is_linear=True, shows_on_neighbours=False, is_proposed=True, is_base=False, pre_check=None, neutral={},
        elastic=False, needs_elastic=False, is_external=False, is_shared=False, stands_for=(), has_minima=False,
        given_states=frozenset(), is_stated=False, confounded_with=(), bends="", rest="",
        simple_form=(),
    )  # fmt: skip
    known["impossible"] = lambda values, deviations, link: ""
    known["unusual"] = lambda values, deviations: ""
    known["acts"] = lambda shapes: None
    known["acts_between"] = lambda shapes: None
    known["frequency"] = ""
    return SimpleNamespace(**{"name": name, "class_name": class_name or name, "place": place, **known, **more})


class Catalogue:
    """A builder with a catalogue of hand-made effects.

    Args:
        costs: name -> parameters that an effect counts as; one where absent.
    """

    def __init__(self, *effects: Any, costs: Mapping[str, float] | None = None, joints: int = 1) -> None:
        self.effects = {effect.name: effect for effect in effects}
        self.description: Any = None
        self.identified: set[str] = set()
        self.start: Mapping[str, float] = {}
        self.amplitudes: tuple[Any, ...] = ()
        self.shapes: tuple[Any, ...] = ()
        self.search: dict[str, Mapping[str, Search]] = {}
        self._costs, self._joints = dict(costs or {}), joints
        self.expected: list[list[tuple[EffectAtJoint, ...]]] = []
        self.stayed: list[Fit] = []

    def effect(self, effect_at: EffectAtJoint) -> Any:
        return self.effects[effect_at.effect]

    def cost_in(self, fit: Fit, effect_at: EffectAtJoint) -> float:
        return float(self.at(effect_at).cost)

    def at(self, effect_at: EffectAtJoint) -> Any:
        cost = self._costs.get(effect_at.effect, 1.0)
        return SimpleNamespace(
            cost=cost, cost_with=lambda shapes: cost, harmonics={}, can_be_added=True,
            is_present=self._is_present(effect_at), amplitudes=self.amplitudes, shapes=self.shapes,
            search=self.search.get(effect_at.effect, {}),
        )  # fmt: skip

    def has_place(self, effect_at: EffectAtJoint, added: Sequence[EffectAtJoint]) -> bool:
        needed = self.effect(effect_at).needs_elastic
        return not needed or any(self.effect(a).elastic and a.joint == effect_at.joint for a in added)

    def _is_present(self, effect_at: EffectAtJoint) -> bool:
        if self.description is None:
            return effect_at.effect in self.identified
        return effect_at.effect in self.description.joints[effect_at.joint - 1].effects

    def joints(self, name: str) -> tuple[int, ...]:
        return tuple(range(1, self._joints + 1))

    def link_values(self, joint: int) -> dict[str, float]:
        return {}

    def prepare(self, wanted: Sequence[Sequence[EffectAtJoint]], **_: Any) -> None:
        pass

    def expect(self, wanted: Sequence[Sequence[EffectAtJoint]]) -> None:
        self.expected.append([tuple(each) for each in wanted])

    def settled(self, fit: Fit) -> Fit:
        self.stayed.append(fit)
        return fit


def with_effects(*names: str, square: float = 100.0, owner: str = PLANT) -> Fit:
    """A fit of a model with these effects on joint 1, one parameter each."""
    parameters = [FreeParameter("M", "kg", "base", "M", 1.0, 1.0)]
    parameters += [FreeParameter(n, "N.m", owner, n, 1.0, 1.0, effect=i) for i, n in enumerate(names)]
    model = TableModel(residual(square), {}, tuple(EffectAtJoint(n, 1) for n in names), tuple(parameters))
    slopes = np.arange(1.0, len(parameters) + 1) * np.ones((400, 1, 1))
    return fit_of(model, values=[1.0] * len(parameters), jacobian=slopes)


class Removable(Catalogue):
    """A builder that takes effects out of table models."""

    def without(self, model: TableModel, index: int) -> TableModel:
        kept = tuple(a for i, a in enumerate(model.added_effects) if i != index)
        parameters = [p for p in model.free_parameters if p.effect != index]
        parameters = [
            replace(p, effect=kept.index(EffectAtJoint(p.key, 1))) if p.effect is not None else p for p in parameters
        ]
        return replace(model, added_effects=kept, free_parameters=tuple(parameters))
