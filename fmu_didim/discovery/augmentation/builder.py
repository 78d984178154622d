"""Effects added to a loop, each in the place where it acts.

A model is always built anew from the base and the list of its effects, so that effects are added and taken out in the
same way.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from types import MappingProxyType

import numpy as np

from fmu_didim.discovery.augmentation.black_box import subdivision
from fmu_didim.discovery.augmentation.places import BaseLoop, InController, InWiring, LoopEffect, Proposal, placed
from fmu_didim.discovery.augmentation.plants import Plants, described
from fmu_didim.discovery.progress import Progress
from fmu_didim.dynamics.effects import EFFECTS, Effect
from fmu_didim.dynamics.robot import RobotDescription
from fmu_didim.fit.fit import Fit
from fmu_didim.model.free_parameter import PLANT, plain_name
from fmu_didim.model.loop_model import EffectAtJoint, LoopModel

LIKELY_SIZE = 0.1
"""[1] Of the steepest effects, with which that is tried, as a fraction of the torque."""


class LoopModelBuilder:
    """Builds loop models with effects.

    Where an effect acts is decided once for each joint; see :mod:`fmu_didim.discovery.augmentation.places`.

    Args:
        base: the loop without added effects.
        description: the robot, None for a black-box plant, which then gets effects through its wiring.
        effects: the catalogue by name.
        start: name of a free parameter -> value from which the base was fitted; those that are not in it are as in
            ``base``.
    """

    def __init__(
        self,
        base: LoopModel,
        description: RobotDescription | None,
        effects: Mapping[str, Effect] = EFFECTS,
        *,
        start: Mapping[str, float] = MappingProxyType({}),
    ) -> None:
        self.base, self.description, self.effects, self.start = base, description, effects, start
        self.loop = BaseLoop(base, description)
        places = (EffectAtJoint(name, j) for name in effects for j in range(1, base.joint_count + 1))
        self._placed = {a: placed(a, effects[a.effect], self.loop) for a in places}
        self._plants = Plants(self.loop)

    def at(self, effect_at: EffectAtJoint) -> LoopEffect:
        """An effect at a joint, in the place where it acts."""
        return self._placed[effect_at]

    def effect(self, effect_at: EffectAtJoint) -> Effect:
        """The effect itself, from the catalogue."""
        return self.effects[effect_at.effect]

    def cost_in(self, fit: Fit, effect_at: EffectAtJoint) -> float:
        """Parameters that an effect of a fit counts as with the values that it has there."""
        placed = self.at(effect_at)
        return placed.cost_with(*self.shapes_in(fit, effect_at)) if placed.harmonics else placed.cost

    def shapes_in(self, fit: Fit, effect_at: EffectAtJoint) -> tuple[dict[str, float], dict[str, float]]:
        """Values of the shapes of an effect of a fit, and their standard deviations, by the plain names."""
        index = fit.model.added_effects.index(effect_at)
        own = {
            plain_name(p.name, effect_at.joint): i for i, p in enumerate(fit.model.free_parameters)
            if p.effect == index and p.is_shape
        }  # fmt: skip
        deviations = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
        return {n: float(fit.values[i]) for n, i in own.items()}, {n: float(deviations[i]) for n, i in own.items()}

    def joints(self, name: str) -> tuple[int, ...]:
        """The joints, from 1, that an effect may act on; only the first one if it acts on the whole log or the base."""
        effect = self.effects[name]
        return tuple(range(1, self.base.joint_count + 1))[: 1 if effect.is_of_log or effect.acts_on_base else None]

    def has_place(self, effect_at: EffectAtJoint, added_effects: Sequence[EffectAtJoint]) -> bool:
        """Whether an effect has its place beside those added: what acts in an elastic gear needs one on its joint."""
        if not self.effect(effect_at).needs_elastic:
            return True
        present = self.description is not None and self.description.joints[effect_at.joint - 1].is_elastic
        return present or any(self.effect(a).elastic and a.joint == effect_at.joint for a in added_effects)

    def link_values(self, joint: int) -> dict[str, float]:
        """Inertial parameters of the link of a joint, counted from 1, by their plain names; nothing for a black box."""
        return {} if self.description is None else dict(self.description.joints[joint - 1].parameters)

    def described(self, added_effects: Sequence[EffectAtJoint]) -> RobotDescription | None:
        """The robot description with all effects, wherever they act; None for a black box."""
        return None if self.description is None else described(self.description, self._at_all(added_effects))

    def build(self, model: LoopModel, proposals: Sequence[Proposal]) -> LoopModel:
        """``model`` with further effects, which start at the values proposed.

        Raises:
            InputError: an effect cannot be added to this plant.
        """
        free_parameters = list(model.free_parameters)
        for index, proposal in enumerate(proposals, start=len(model.added_effects)):
            known = {parameter.name for parameter in free_parameters}
            own = self.at(proposal.effect_at).free_parameters(proposal, index)
            free_parameters += [parameter for parameter in own if parameter.name not in known]
        built = self._with_effects(model, (*model.added_effects, *(p.effect_at for p in proposals)))
        offered = {v.name for v in built.loop.plant.parameters}
        return built.with_free(p for p in free_parameters if p.owner != PLANT or p.key in offered)

    def without(self, model: LoopModel, index: int) -> LoopModel:
        """A model without one of its effects and those that have no place without it; its other free parameters keep
        their values."""
        others = tuple(a for i, a in enumerate(model.added_effects) if i != index)
        kept = [i for i, a in enumerate(model.added_effects) if i != index and self.has_place(a, others)]
        free_parameters = [
            k if k.effect is None else replace(k, effect=kept.index(k.effect))
            for k in model.free_parameters
            if k.effect is None or k.effect in kept
        ]
        return self._with_effects(model.with_free(free_parameters), tuple(model.added_effects[i] for i in kept))

    def prepare(self, wanted: Sequence[Sequence[EffectAtJoint]], *, progress: Progress, workers: int) -> None:
        """Compile what models with these effects need, plants side by side, as far as the time allows.

        Models that are built in threads must be prepared first: CasADi expressions are not thread-safe.
        """
        self._plants.compile(
            [self._at_all(added_effects) for added_effects in wanted], progress=progress, workers=workers
        )
        for added_effects in wanted:
            if not progress.is_time_up:
                self._with_effects(self.base, tuple(added_effects))

    def expect(self, wanted: Sequence[Sequence[EffectAtJoint]]) -> None:
        """Let what is prepared next serve models with these effects, too."""
        self._plants.expect([self._at_all(added_effects) for added_effects in wanted])

    def settled(self, fit: Fit) -> Fit:
        """A fit whose model stays, with a plant of its own effects alone, none that stand idle."""
        model = fit.model
        plant = self._plants.alone(self._at_all(model.added_effects))
        return fit if plant is model.loop.plant else replace(fit, model=model.with_loop(plant=plant))

    def _at_all(self, added_effects: Sequence[EffectAtJoint]) -> list[LoopEffect]:
        return [self.at(effect_at) for effect_at in added_effects]

    def _with_effects(self, model: LoopModel, added_effects: tuple[EffectAtJoint, ...]) -> LoopModel:
        """The model with these effects in plant and wiring instead of those that it has."""
        added = self._at_all(added_effects)
        wired = self._wired(model, [one for one in added if isinstance(one, InWiring)])
        ticks = self._ticks if any(one.needs_short_steps for one in added) else 1
        factors = {one.owner: one.gains for one in added if isinstance(one, InController)}
        model = wired.with_loop(plant=self._plants.plant(added), subdivision=ticks, factors=factors)
        return replace(model, added_effects=added_effects)

    def _wired(self, model: LoopModel, parts: Sequence[InWiring]) -> LoopModel:
        """The model with the wiring of the base and these components in it."""
        systems = dict(self.base.loop.systems)
        for part in parts:
            systems = {label: part.wired(system, label) for label, system in systems.items()}
        return model.with_loop(systems=systems, added_components={p.owner: p.effect_at.joint for p in parts})

    @cached_property
    def _ticks(self) -> int:
        """Ticks in a control period of models with a torque of the plant in the wiring, found with more of the steepest
        effects, such as Coulomb friction, than is likely: one number for all, so that models can be compared."""
        sizes = LIKELY_SIZE * np.sqrt(np.mean(self.base.measured**2, axis=0))
        steepest = [one for one in self._placed.values() if one.effect.sets_ticks and isinstance(one, InWiring)]
        model = self._wired(replace(self.base, added_effects=tuple(p.effect_at for p in steepest)), steepest)
        systems = dict(model.loop.systems)
        for part in steepest:
            values = {v.name: float(sizes[part.effect_at.joint - 1]) for v in part.amplitudes}
            for label, system in systems.items():
                component = system.components[part.owner].with_parameters(values)
                systems[label] = system.replace(part.owner, component)
        return subdivision(model.with_loop(systems=systems))
