"""Effects put into a loop: into the torque balance of the plant, or as a component into the wiring.

A model is always built anew from the base and the list of its effects, so that an effect is as easily taken
out again as it is put in.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fmu_didim.components import Component, ModelComponent
from fmu_didim.components.compiled_model import with_compiled_twin
from fmu_didim.discovery.augmentation.black_box import TorquePart, can_be_added, finer, splice_part, torque_part
from fmu_didim.discovery.augmentation.ranges import travelled
from fmu_didim.effects import EFFECTS, Effect, MeasurementEffect, Search, TorqueEffect
from fmu_didim.effects.coulomb import Coulomb
from fmu_didim.effects.nonlinear import NonlinearEffect
from fmu_didim.effects.spliced import SplicedEffect
from fmu_didim.errors import InputError
from fmu_didim.master import logged_torque, splice_effect
from fmu_didim.prediction.loop_model import LOG, PLANT, Addition, Knob, LoopModel, Run
from fmu_didim.robot import RobotDescription, RobotModel
from fmu_didim.signals import Variable


@dataclass(frozen=True)
class Proposal:
    """An effect with the values from which it is fitted.

    Attributes:
        addition: effect and joint.
        values: start value of each of its free parameters, by the plain name (``Fs``, ``vs``).
        scales: size of a noticeable change of them; the value itself where absent.
    """

    addition: Addition
    values: Mapping[str, float]
    scales: Mapping[str, float] = field(default_factory=dict)


class Workshop:
    """Builds loop models with effects; keeps the plants it has compiled.

    Args:
        base: the loop without added effects.
        description: the robot, None for a black-box plant, which then gets effects through its wiring.
        effects: the catalogue by name.
    """

    def __init__(
        self,
        base: LoopModel,
        description: RobotDescription | None,
        effects: Mapping[str, Effect] = EFFECTS,
    ) -> None:
        self.base, self.description, self.effects = base, description, effects
        self._substeps = _chosen_substeps(base.plant)
        self._plants: dict[tuple[Addition, ...], Component] = {}
        self._searches: dict[Addition, dict[str, Search]] = {}
        self._ticks: int | None = None
        # CasADi's expressions are not made to be built by several threads at once.
        self._lock = threading.RLock()
        self._ranges = [travelled(base, j) for j in range(1, base.joint_count + 1)]

    def effect(self, addition: Addition) -> Effect:
        """The effect of an addition."""
        return self.effects[addition.effect]

    def joints(self, name: str) -> tuple[int, ...]:
        """The joints, from 1, on which an effect may be; of one of the whole log the first stands for all."""
        return tuple(range(1, self.base.joint_count + 1))[: 1 if self.is_of_log(name) else None]

    def is_of_log(self, name: str) -> bool:
        """Whether an effect changes the log as a whole, and not the loop."""
        return isinstance(self.effects[name], MeasurementEffect)

    def joint_type(self, joint: int) -> str:
        """Type of a joint, counted from 1."""
        if self.description is not None:
            return self.description.joints[joint - 1].type
        unit = self.base.runs["train"].problem.parameters.torque_units[joint - 1]
        return "prismatic" if unit == "N" else "revolute"

    def search(self, addition: Addition) -> dict[str, Search]:
        """The searched parameters of an effect, their grids moved to where the reference goes and the data can tell."""
        if addition not in self._searches:
            effect, kind = self.effect(addition), self.joint_type(addition.joint)
            units = {v.name: v.unit for v in (*effect.parameters(kind), *effect.shapes(kind))}  # type: ignore[arg-type]
            within = self._ranges[addition.joint - 1]
            self._searches[addition] = {
                name: within.adapted(s, units[name])
                for name, s in effect.search(kind).items()  # type: ignore[arg-type]
            }
        return self._searches[addition]

    def free_parameters(self, addition: Addition) -> tuple[tuple[Variable, ...], tuple[Variable, ...]]:
        """Amplitudes and searched shapes of an effect, by their plain names."""
        effect, kind = self.effect(addition), self.joint_type(addition.joint)
        searched = self.search(addition)
        shapes = tuple(v for v in effect.shapes(kind) if v.name in searched)  # type: ignore[arg-type]
        amplitudes = effect.parameters(kind)  # type: ignore[arg-type]
        if isinstance(effect, NonlinearEffect):
            amplitudes = tuple(v for v in amplitudes if v.name in searched)
        return amplitudes, shapes

    def cost(self, addition: Addition) -> float:
        """Parameters that an effect counts as when models are compared."""
        amplitudes, _ = self.free_parameters(addition)
        search = self.search(addition)
        return sum(1.0 for v in amplitudes if v.name not in search) + sum(s.cost for s in search.values())

    def build(self, model: LoopModel, proposals: Sequence[Proposal]) -> LoopModel:
        """``model`` with further effects, which start at the values proposed.

        Raises:
            InputError: an effect cannot be added to this plant.
        """
        with self._lock:
            return self._built(model, proposals)

    def _built(self, model: LoopModel, proposals: Sequence[Proposal]) -> LoopModel:
        additions = (*model.additions, *(p.addition for p in proposals))
        knobs = list(model.knobs)
        for index, proposal in enumerate(proposals, start=len(model.additions)):
            known = {knob.name for knob in knobs}
            knobs += [k for k in self._knobs(proposal, index) if k.name not in known]
        plant = self._plant(additions)
        offered = {v.name for v in plant.parameters}
        knobs = [k for k in knobs if k.owner != PLANT or k.key in offered]
        runs, logged = self._wired(additions)
        built = replace(model, plant=plant, runs=runs, logged=logged, knobs=tuple(knobs), additions=additions)
        return built.refined(self._finer(additions))

    def _finer(self, additions: Sequence[Addition]) -> int:
        """Ticks in a control period: more than one where a torque of the plant stands in the wiring."""
        if not any(isinstance(self.part(a), TorquePart) for a in additions):
            return 1
        if self._ticks is None:
            self._ticks = finer(self._with_friction())  # one number for all models, which are compared
        return self._ticks

    def _with_friction(self) -> LoopModel:
        """The base with further Coulomb friction in the wiring, the steepest effect that is likely."""
        sizes = 0.1 * np.sqrt(np.mean(self.base.runs["train"].measured ** 2, axis=0))
        wanted = [(Addition("coulomb", j), size) for j, size in enumerate(sizes, start=1)]
        runs = dict(self.base.runs)
        for addition, size in wanted:
            if self.part(addition) is None:
                continue
            run = self._with_part(runs["train"], Coulomb(), addition.joint)
            name = splice_name(addition)
            part = run.system.components[name].with_parameters({"Fc": float(size)})
            runs["train"] = replace(run, system=run.system.replace(name, part))
        joints = range(1, self.base.joint_count + 1)
        system, plant = runs["train"].system, runs["train"].problem.plant
        return replace(self.base, runs=runs, logged=tuple(logged_torque(system, j, plant=plant) for j in joints))

    def _with_part(self, run: Run, effect: TorqueEffect, joint: int) -> Run:
        kind, begin = self.joint_type(joint), float(run.problem.experiment.reference.time[0])
        system = splice_part(run.system, effect, joint, kind, start_time=begin, plant=run.problem.plant)  # type: ignore[arg-type]
        return replace(run, system=system)

    def without(self, model: LoopModel, index: int) -> LoopModel:
        """A model without one of its effects; its other knobs keep their values."""
        additions = tuple(a for i, a in enumerate(model.additions) if i != index)
        knobs = tuple(
            replace(k, effect=k.effect - 1 if k.effect is not None and k.effect > index else k.effect)
            for k in model.knobs
            if k.effect != index
        )
        with self._lock:
            runs, logged = self._wired(additions)
            plant = self._plant(additions)
            built = replace(model, plant=plant, runs=runs, logged=logged, knobs=knobs, additions=additions)
            return built.refined(self._finer(additions))

    def described(self, additions: Sequence[Addition]) -> RobotDescription | None:
        """The robot description with all effects, wherever they act."""
        if self.description is None:
            return None
        return self._description([a for a in additions if not self.is_of_log(a.effect)])

    def _knobs(self, proposal: Proposal, index: int) -> list[Knob]:
        addition = proposal.addition
        effect = self.effect(addition)
        amplitudes, shapes = self.free_parameters(addition)
        search = self.search(addition)
        spliced, nonlinear = self.is_spliced(addition), isinstance(effect, NonlinearEffect)
        of_log = isinstance(effect, MeasurementEffect)
        owner = splice_name(addition) if spliced else LOG if of_log else PLANT
        knobs = []
        for variable, is_shape in (*((v, False) for v in amplitudes), *((v, True) for v in shapes)):
            number = f"_{addition.joint}" if is_shape or nonlinear else f"{addition.joint}"
            name = variable.name if of_log else f"{variable.name}{number}"
            if nonlinear and not is_shape and variable.name not in proposal.values:
                continue  # nothing to be seen of it: it stays as it is without the effect
            value = proposal.values.get(variable.name, variable.start)
            low, high = -np.inf, np.inf
            if isinstance(effect, NonlinearEffect):
                low, high = effect.limits.get(variable.name, (low, high))
            elif is_shape:
                low, high = shape_limits(search[variable.name], variable.name in effect.signed)
            knobs.append(
                Knob(
                    name=name,
                    unit=variable.unit,
                    owner=owner,
                    key=variable.name if spliced else name,
                    value=float(value),
                    scale=float(abs(proposal.scales.get(variable.name, value)) or 1e-3),
                    lowest=float(low),
                    highest=float(high),
                    effect=index,
                    is_shape=is_shape,
                )
            )
        return knobs

    def can_add(self, addition: Addition) -> bool:
        """Whether an effect can be added to this plant: to a black box only what its wiring can take."""
        anywhere = self.description is not None or self.is_of_log(addition.effect)
        return anywhere or self.part(addition) is not None

    def is_spliced(self, addition: Addition) -> bool:
        """Whether an effect is a component of its own in the wiring."""
        return self.part(addition) is not None

    def part(self, addition: Addition) -> SplicedEffect | None:
        """The component that an effect is in the wiring, None if it belongs into the equations of the plant."""
        effect = self.effect(addition)
        if isinstance(effect, TorqueEffect) and self.description is None:
            kind = self.joint_type(addition.joint)
            if can_be_added(self.base, effect, addition.joint, kind):  # type: ignore[arg-type]
                return torque_part(effect)
        return effect if isinstance(effect, SplicedEffect) else None

    def _plant(self, additions: Sequence[Addition]) -> Component:
        inner = tuple(a for a in additions if not self.is_spliced(a) and not self.is_of_log(a.effect))
        if not inner:
            return self.base.plant
        if self.description is None:
            raise InputError("This plant has no robot description, so nothing can be added to its torque balance.")
        known = self._plants.get(inner)
        if known is None:
            block = RobotModel(self._description(inner)).block()
            known = with_compiled_twin(ModelComponent(block))
            if self._substeps is not None:
                known = known.with_substeps(self._substeps) or known
            self._plants[inner] = known
        return known

    def _description(self, additions: Sequence[Addition]) -> RobotDescription:
        assert self.description is not None
        joints = list(self.description.joints)
        for addition in additions:
            joint = joints[addition.joint - 1]
            if addition.effect not in joint.effects:
                joints[addition.joint - 1] = joint.model_copy(update={"effects": (*joint.effects, addition.effect)})
        return self.description.model_copy(update={"joints": tuple(joints)})

    def _wired(self, additions: Sequence[Addition]) -> tuple[dict[str, Run], tuple[str, ...]]:
        """The experiments with all splices in their wiring, and the signals that are logged."""
        runs, joints = dict(self.base.runs), range(1, self.base.joint_count + 1)
        plant = runs["train"].problem.plant
        for addition in additions:
            effect, kind = self.effect(addition), self.joint_type(addition.joint)
            if isinstance(effect, SplicedEffect):
                runs = {
                    label: replace(run, system=splice_effect(run.system, effect, addition.joint, kind, plant=plant))  # type: ignore[arg-type]
                    for label, run in runs.items()
                }
            elif isinstance(effect, TorqueEffect) and self.is_spliced(addition):
                runs = {label: self._with_part(run, effect, addition.joint) for label, run in runs.items()}
        return runs, tuple(logged_torque(runs["train"].system, j, plant=plant) for j in joints)


def _chosen_substeps(plant: Component) -> int | None:
    """Integration substeps that the user chose for the plant; the augmented plants take over the choice."""
    chosen = getattr(plant, "substeps", None) or getattr(plant, "options", {}).get("substeps")
    return int(chosen) if chosen else None


def shape_limits(search: Search, signed: bool) -> tuple[float, float]:
    """How far a fit may take a shape beyond the grid on which it was found."""
    if search.logarithmic and not signed:
        return search.lowest / 3, search.highest * 3
    room = 0.5 * (search.highest - search.lowest)
    return (search.lowest - room if signed else 0.8 * search.lowest), search.highest + room


def splice_name(addition: Addition) -> str:
    """Name of the component of an effect in the wiring."""
    return f"{addition.effect}{addition.joint}"
