"""Effects put into a loop: into the torque balance of the plant, or as a component into the wiring.

A model is always built anew from the base and the list of its effects, so that an effect is as easily taken
out again as it is put in.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from fmu_didim.base.errors import InputError
from fmu_didim.components import Component, ModelComponent
from fmu_didim.components.compiled_model import with_compiled_twin
from fmu_didim.cosim import System, insert_effect
from fmu_didim.data.signals import Variable
from fmu_didim.discovery.augmentation.black_box import (
    START_POSITION,
    START_TIME,
    TorquePart,
    can_be_added,
    insert_part,
    subdivision,
    torque_part,
)
from fmu_didim.discovery.augmentation.ranges import travelled
from fmu_didim.discovery.progress import Watch
from fmu_didim.dynamics.block import Block
from fmu_didim.dynamics.effects import EFFECTS, Effect, InsertedEffect, JointType, Search, TorqueEffect
from fmu_didim.dynamics.robot import RobotDescription, RobotModel
from fmu_didim.model.free_parameter import LOG, PLANT, FreeParameter, joint_parameter
from fmu_didim.model.loop_description import EffectAtJoint
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.motion import joint_reference
from fmu_didim.model.workers import side_by_side

LIKELY_SIZE = 0.1
"""[1] Of the steepest effects, with which that is tried, as a fraction of the torque."""
SMALLEST_SCALE = 1e-3
"""[SI] Noticeable change of a parameter that is proposed as zero."""
BEYOND_GRID = 3.0
"""[1] By which factor a fit may take a shape beyond its logarithmic grid,"""
BEYOND_RANGE = 0.5
"""[1] and by which fraction of its range beyond another one,"""
BELOW_RANGE = 0.8
"""[1] or down to which fraction of its lowest value where it has one sign."""


@dataclass(frozen=True)
class Proposal:
    """An effect with the values from which it is fitted.

    Attributes:
        effect_at: effect and joint.
        values: start value of each of its free parameters, by the plain name (``Fs``, ``vs``).
        scales: size of a noticeable change of them; the value itself where absent.
    """

    effect_at: EffectAtJoint
    values: Mapping[str, float]
    scales: Mapping[str, float] = field(default_factory=dict)


class LoopModelBuilder:
    """Builds loop models with effects; keeps the plants it has compiled.

    Args:
        base: the loop without added effects.
        description: the robot, None for a black-box plant, which then gets effects through its wiring.
        effects: the catalogue by name.
    """

    def __init__(
        self, base: LoopModel, description: RobotDescription | None, effects: Mapping[str, Effect] = EFFECTS
    ) -> None:
        self.base, self.description, self.effects = base, description, effects
        self._substeps = _chosen_substeps(base.plant)
        self._offered = {v.name for v in base.plant.parameters}
        self._plants: dict[tuple[EffectAtJoint, ...], Component] = {}
        self._searches: dict[EffectAtJoint, dict[str, Search]] = {}
        self._ticks: int | None = None
        # CasADi's expressions are not made to be built by several threads at once.
        self._lock = threading.RLock()
        self._ranges = [travelled(base, j) for j in range(1, base.joint_count + 1)]

    def effect(self, effect_at: EffectAtJoint) -> Effect:
        """The effect itself, from the catalogue."""
        return self.effects[effect_at.effect]

    def joints(self, name: str) -> tuple[int, ...]:
        """The joints, from 1, on which an effect may be; of one of the whole log or of the base the first stands for
        all."""
        is_of_none = self.is_of_log(name) or self.effects[name].acts_on_base
        return tuple(range(1, self.base.joint_count + 1))[: 1 if is_of_none else None]

    def is_of_log(self, name: str) -> bool:
        """Whether an effect changes the log as a whole, and not the loop."""
        return self.effects[name].is_of_log

    def joint_type(self, joint: int) -> JointType:
        """Type of a joint, counted from 1."""
        if self.description is not None:
            return self.description.joints[joint - 1].type
        unit = self.base.parameters.torque_units[joint - 1]
        return "prismatic" if unit == "N" else "revolute"

    def search(self, effect_at: EffectAtJoint) -> dict[str, Search]:
        """The searched parameters of an effect, their grids moved to where the reference goes and the data can tell."""
        if effect_at not in self._searches:
            effect, kind = self.effect(effect_at), self.joint_type(effect_at.joint)
            units = {v.name: v.unit for v in (*effect.parameters(kind), *effect.shapes(kind))}
            within = self._ranges[effect_at.joint - 1]
            grids = effect.search(kind)
            if self.is_own(effect_at):  # with the shapes that the plant has
                joint = effect_at.joint
                grids = {n: s for n, s in grids.items() if joint_parameter(n, joint, is_shape=True) in self._offered}
            self._searches[effect_at] = {name: within.adapted(s, units[name]) for name, s in grids.items()}
        return self._searches[effect_at]

    def parameters_of(self, effect_at: EffectAtJoint) -> tuple[tuple[Variable, ...], tuple[Variable, ...]]:
        """Amplitudes and searched shapes of an effect, by their plain names."""
        effect, kind = self.effect(effect_at), self.joint_type(effect_at.joint)
        searched = self.search(effect_at)
        shapes = tuple(v for v in effect.shapes(kind) if v.name in searched)
        amplitudes = effect.parameters(kind)
        if not effect.is_linear:
            amplitudes = tuple(v for v in amplitudes if v.name in searched)
        return amplitudes, shapes

    def cost(self, effect_at: EffectAtJoint) -> float:
        """Parameters that an effect counts as when models are compared."""
        amplitudes, _ = self.parameters_of(effect_at)
        return parameter_cost([v.name for v in amplitudes], self.search(effect_at))

    def build(self, model: LoopModel, proposals: Sequence[Proposal]) -> LoopModel:
        """``model`` with further effects, which start at the values proposed.

        Raises:
            InputError: an effect cannot be added to this plant.
        """
        with self._lock:
            added_effects = (*model.added_effects, *(p.effect_at for p in proposals))
            free_parameters = list(model.free_parameters)
            for index, proposal in enumerate(proposals, start=len(model.added_effects)):
                known = {parameter.name for parameter in free_parameters}
                free_parameters += [k for k in self._free_parameters_of(proposal, index) if k.name not in known]
            built = self._with(added_effects, model)
            offered = {v.name for v in built.plant.parameters}
            kept = tuple(k for k in free_parameters if k.owner != PLANT or k.key in offered)
            return replace(built, free_parameters=kept)

    def _with(self, added_effects: tuple[EffectAtJoint, ...], model: LoopModel) -> LoopModel:
        """The model with these effects in plant and wiring instead of those that it has."""
        with self._lock:
            return replace(
                model,
                plant=self._plant(added_effects),
                systems=self._wired(added_effects),
                added_effects=added_effects,
                added_components=self._components(added_effects),
                subdivision=self._subdivision(added_effects),
            )

    def _subdivision(self, added_effects: Sequence[EffectAtJoint]) -> int:
        """Ticks in a control period: more than one where a torque of the plant stands in the wiring."""
        if not any(isinstance(self.part(a), TorquePart) for a in added_effects):
            return 1
        if self._ticks is None:
            self._ticks = subdivision(self._with_steepest())  # one number for all models, which are compared
        return self._ticks

    def _with_steepest(self) -> LoopModel:
        """The base with more of the steepest effects that are likely in the wiring, such as Coulomb friction."""
        sizes = LIKELY_SIZE * np.sqrt(np.mean(self.base.measured**2, axis=0))
        steepest = [name for name, effect in self.effects.items() if effect.sets_ticks]
        systems, added = dict(self.base.systems), []
        for effect_at, size in ((EffectAtJoint(name, j), s) for name in steepest for j, s in enumerate(sizes, start=1)):
            part = self.part(effect_at)
            if part is None:
                continue
            added.append(effect_at)
            name, amplitudes = self.inserted_name(effect_at), self.parameters_of(effect_at)[0]
            for label, system in systems.items():
                system = self._with_part(label, system, part, effect_at.joint)
                component = system.components[name].with_parameters({v.name: float(size) for v in amplitudes})
                systems[label] = system.replace(name, component)
        components = self._components(added)
        return replace(self.base, systems=systems, added_effects=tuple(added), added_components=components)

    def _with_part(self, label: str, system: System, part: InsertedEffect, joint: int) -> System:
        kind, plant = self.joint_type(joint), self.base.plant_name
        if isinstance(part, TorquePart):
            position, _ = joint_reference(self.base.experiments[label].reference, joint)
            begin = float(self.base.experiments[label].reference.time[0])
            starts = {START_TIME: begin, START_POSITION: float(position[0])}
            return insert_part(system, part, joint, kind, starts=starts, plant=plant)
        return insert_effect(system, part, joint, kind, plant=plant)

    def without(self, model: LoopModel, index: int) -> LoopModel:
        """A model without one of its effects; its other free parameters keep their values."""
        added_effects = tuple(a for i, a in enumerate(model.added_effects) if i != index)
        free_parameters = tuple(
            replace(k, effect=k.effect - 1 if k.effect is not None and k.effect > index else k.effect)
            for k in model.free_parameters
            if k.effect != index
        )
        return self._with(added_effects, replace(model, free_parameters=free_parameters))

    def link_values(self, joint: int) -> dict[str, float]:
        """Inertial parameters of the link of a joint, counted from 1, by their plain names; nothing for a black box."""
        return {} if self.description is None else dict(self.description.joints[joint - 1].parameters)

    def described(self, added_effects: Sequence[EffectAtJoint]) -> RobotDescription | None:
        """The robot description with all effects, wherever they act."""
        if self.description is None:
            return None
        return self._description([a for a in added_effects if not self.is_of_log(a.effect)])

    def _free_parameters_of(self, proposal: Proposal, index: int) -> list[FreeParameter]:
        effect_at = proposal.effect_at
        effect = self.effect(effect_at)
        amplitudes, shapes = self.parameters_of(effect_at)
        search = self.search(effect_at)
        spliced, nonlinear, of_log = self.is_inserted(effect_at), not effect.is_linear, effect.is_of_log
        owner = self.inserted_name(effect_at) if spliced else LOG if of_log else PLANT
        free_parameters = []
        for variable, is_shape in (*((v, False) for v in amplitudes), *((v, True) for v in shapes)):
            number = f"_{effect_at.joint}" if is_shape or nonlinear else f"{effect_at.joint}"
            name = variable.name if of_log else f"{variable.name}{number}"
            if nonlinear and not is_shape and variable.name not in proposal.values:
                continue  # nothing to be seen of it: it stays as it is without the effect
            value = proposal.values.get(variable.name, variable.start)
            low, high = -np.inf, np.inf
            if nonlinear:
                low, high = effect.limits.get(variable.name, (low, high))
            elif is_shape:
                low, high = shape_limits(search[variable.name], variable.name in effect.signed)
            free_parameters.append(
                FreeParameter(
                    name=name,
                    unit=variable.unit,
                    owner=owner,
                    key=variable.name if spliced else name,
                    value=float(value),
                    scale=float(abs(proposal.scales.get(variable.name, value)) or SMALLEST_SCALE),
                    lowest=float(low),
                    highest=float(high),
                    effect=index,
                    is_shape=is_shape,
                )
            )
        return free_parameters

    def can_add(self, effect_at: EffectAtJoint) -> bool:
        """Whether an effect can be added to this plant: to a black box what it has itself, and what its wiring can
        take; at an encoder where the controller sees it."""
        if self.effect(effect_at).place == "sensor":
            position = f"{self.base.plant_name}.q{effect_at.joint}"
            return any(c.source == position for c in self.base.systems[self.base.first].connections)
        anywhere = self.description is not None or self.is_of_log(effect_at.effect)
        return anywhere or self.is_own(effect_at) or self.part(effect_at) is not None

    def is_own(self, effect_at: EffectAtJoint) -> bool:
        """Whether a plant that is a black box has an effect already: parameters with the names of its amplitudes, such
        as ``Fc1``, none of which is identified."""
        effect = self.effect(effect_at)
        if self.description is not None or not isinstance(effect, TorqueEffect):
            return False
        return self._has(effect_at, self._offered - set(self.base.parameters.plant_names))

    def is_identified(self, effect_at: EffectAtJoint) -> bool:
        """Whether the base model identifies the parameters of an effect that a black box has."""
        is_torque = isinstance(self.effect(effect_at), TorqueEffect)
        return self.description is None and is_torque and self._has(effect_at, set(self.base.parameters.plant_names))

    def _has(self, effect_at: EffectAtJoint, names: set[str]) -> bool:
        """Whether the names of all amplitudes of an effect in a plant are among these."""
        amplitudes = self.effect(effect_at).parameters(self.joint_type(effect_at.joint))
        own = {joint_parameter(v.name, effect_at.joint, is_shape=False) for v in amplitudes}
        return bool(own) and own <= names

    def is_inserted(self, effect_at: EffectAtJoint) -> bool:
        """Whether an effect is a component of its own in the wiring."""
        return self.part(effect_at) is not None

    def inserted_name(self, effect_at: EffectAtJoint) -> str:
        """Name of the component of an effect in the wiring."""
        return f"{self.effect(effect_at).name}{effect_at.joint}"

    def part(self, effect_at: EffectAtJoint) -> InsertedEffect | None:
        """The component that an effect is in the wiring, None if it belongs into the equations of the plant."""
        effect = self.effect(effect_at)
        if isinstance(effect, TorqueEffect) and self.description is None:
            kind = self.joint_type(effect_at.joint)
            if not self.is_own(effect_at) and can_be_added(self.base, effect, effect_at.joint, kind):
                given = {v.name for v in self.base.plant.outputs}
                return torque_part(effect, integrates=f"q{effect_at.joint}" not in given)
        return effect if isinstance(effect, InsertedEffect) else None

    def compile(self, wanted: Sequence[Sequence[EffectAtJoint]], *, watch: Watch, workers: int) -> None:
        """Compile the plants with these effects side by side: a compiler keeps one core busy, and takes seconds."""
        groups = (self._inner(added_effects) for added_effects in wanted)
        missing = [inner for inner in dict.fromkeys(groups) if inner and inner not in self._plants]
        with self._lock:
            blocks = [self._block(inner) for inner in missing]
        told = watch.counted("compiling plant", len(missing))

        def one(inner: tuple[EffectAtJoint, ...], block: Block) -> None:
            if not watch.is_over:
                self._plants[inner] = self._compiled(block)
                told("")

        side_by_side([partial(one, inner, block) for inner, block in zip(missing, blocks, strict=True)], workers)

    def _plant(self, added_effects: Sequence[EffectAtJoint]) -> Component:
        inner = self._inner(added_effects)
        if not inner:
            return self.base.plant
        if inner not in self._plants:
            self._plants[inner] = self._compiled(self._block(inner))
        return self._plants[inner]

    def _inner(self, added_effects: Sequence[EffectAtJoint]) -> tuple[EffectAtJoint, ...]:
        """Those effects that belong into the equations of the plant."""
        return tuple(
            a for a in added_effects if not (self.is_inserted(a) or self.is_own(a) or self.is_of_log(a.effect))
        )

    def _block(self, inner: Sequence[EffectAtJoint]) -> Block:
        if self.description is None:
            raise InputError("This plant has no robot description, so nothing can be added to its torque balance.")
        return RobotModel(self._description(inner)).block()

    def _compiled(self, block: Block) -> Component:
        component = with_compiled_twin(ModelComponent(block))
        return component if self._substeps is None else component.with_substeps(self._substeps)

    def _description(self, added_effects: Sequence[EffectAtJoint]) -> RobotDescription:
        assert self.description is not None
        joints = list(self.description.joints)
        for effect_at in added_effects:
            joint = joints[effect_at.joint - 1]
            if effect_at.effect not in joint.effects:
                joints[effect_at.joint - 1] = joint.model_copy(update={"effects": (*joint.effects, effect_at.effect)})
        return self.description.model_copy(update={"joints": tuple(joints)})

    def _components(self, added_effects: Sequence[EffectAtJoint]) -> dict[str, int]:
        """Components that effects put into the wiring, and their joints."""
        return {self.inserted_name(a): a.joint for a in added_effects if self.is_inserted(a)}

    def _wired(self, added_effects: Sequence[EffectAtJoint]) -> dict[str, System]:
        """The loops of the experiments with all splices in their wiring."""
        systems = dict(self.base.systems)
        for effect_at in added_effects:
            part = self.part(effect_at)
            if part is not None:
                for label, system in systems.items():
                    systems[label] = self._with_part(label, system, part, effect_at.joint)
        return systems


def _chosen_substeps(plant: Component) -> int | None:
    """Integration substeps that the user chose for the plant; the augmented plants take over the choice."""
    chosen = getattr(plant, "substeps", None) or getattr(plant, "options", {}).get("substeps")
    return int(chosen) if chosen else None


def parameter_cost(amplitudes: Sequence[str], search: Mapping[str, Search]) -> float:
    """Parameters that amplitudes and searched shapes count as when models are compared."""
    return sum(1.0 for name in amplitudes if name not in search) + sum(s.cost for s in search.values())


def shape_limits(search: Search, signed: bool) -> tuple[float, float]:
    """How far a fit may take a shape beyond the grid on which it was found."""
    if search.logarithmic and not signed:
        return search.lowest / BEYOND_GRID, search.highest * BEYOND_GRID
    room = BEYOND_RANGE * (search.highest - search.lowest)
    return (search.lowest - room if signed else BELOW_RANGE * search.lowest), search.highest + room
