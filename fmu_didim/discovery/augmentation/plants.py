"""Plants with further effects in their equations, each compiled once."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from functools import partial

from fmu_didim.base.errors import InputError
from fmu_didim.components import Component, ModelComponent
from fmu_didim.components.compiled_model import with_compiled_twin
from fmu_didim.discovery.augmentation.places import BaseLoop, LoopEffect
from fmu_didim.discovery.progress import Progress
from fmu_didim.dynamics.block import Block
from fmu_didim.dynamics.effects import TorqueEffect
from fmu_didim.dynamics.robot import RobotDescription, RobotModel
from fmu_didim.model.loop_model import EffectAtJoint
from fmu_didim.model.workers import side_by_side

Key = tuple[EffectAtJoint, ...]


class Plants:
    """The plants of a loop with effects in their equations.

    A compiler takes a second for a robot of six joints, a simulation hundredths. So candidates that can stand idle in a
    plant share one, in which all but one of them are zero; and a model without one of its effects has the plant with
    it.
    """

    def __init__(self, loop: BaseLoop) -> None:
        self.loop = loop
        plant = loop.model.loop.plant
        self._substeps = getattr(plant, "substeps", None) or getattr(plant, "options", {}).get("substeps")
        self._compiled: dict[Key, Component] = {(): plant}
        self._effects: dict[EffectAtJoint, LoopEffect] = {}
        self._expected: list[Sequence[LoopEffect]] = []

    def plant(self, added: Sequence[LoopEffect]) -> Component:
        """The plant with those of these effects that change its equations, beside others that stand idle.

        Raises:
            InputError: the plant is a black box.
        """
        found = self._known(_key(added))
        return self.alone(added) if found is None else found

    def alone(self, added: Sequence[LoopEffect]) -> Component:
        """The plant with no other effects; raises InputError as :meth:`plant`."""
        key = _key(added)
        if key not in self._compiled:
            self._keep(key, added, self._compile(self._block(added)))
        return self._compiled[key]

    def expect(self, wanted: Sequence[Sequence[LoopEffect]]) -> None:
        """Let what is compiled next serve plants with these effects, too, instead of those that were expected
        before."""
        self._expected = list(wanted)

    def compile(self, wanted: Sequence[Sequence[LoopEffect]], *, progress: Progress, workers: int) -> None:
        """Compile plants for these effects side by side, one for all that can stand idle in it: a compiler keeps one
        core busy."""
        missing = [added for added in wanted if self._known(_key(added)) is None]
        expected = [added for added in self._expected if self._known(_key(added)) is None]
        plants = {_key(added): added for added in shared(missing, expected)}
        blocks = {key: self._block(added) for key, added in plants.items()}
        report = progress.counted("compiling plant", len(blocks))

        def compile_one(key: Key, block: Block) -> None:
            if not progress.is_time_up:
                self._keep(key, plants[key], self._compile(block))
                report("")

        side_by_side([partial(compile_one, key, block) for key, block in blocks.items()], workers)

    def _known(self, key: Key) -> Component | None:
        """The compiled plant with these effects and the fewest that stand idle; None if there is none."""
        if key in self._compiled:
            return self._compiled[key]
        wanted = set(key)
        fitting = [
            own
            for own in tuple(self._compiled)
            if wanted and wanted <= {*own} and all(self._effects[a].can_stand_idle for a in own if a not in wanted)
        ]
        return self._compiled[min(fitting, key=lambda own: (len(own), repr(own)))] if fitting else None

    def _keep(self, key: Key, added: Sequence[LoopEffect], plant: Component) -> None:
        self._effects |= {one.effect_at: one for one in added}
        self._compiled[key] = plant

    def _block(self, added: Sequence[LoopEffect]) -> Block:
        if self.loop.description is None:
            raise InputError(
                "This plant has no robot description, so its torque balance cannot get further effects.",
                next_step="Give the case a robot: description, or ask for effects between controller and plant only.",
            )  # fmt: skip
        changing = [one for one in added if one.changes_equations]
        return RobotModel(described(self.loop.description, changing)).block()

    def _compile(self, block: Block) -> Component:
        component = with_compiled_twin(ModelComponent(block))
        return component if not self._substeps else component.with_substeps(int(self._substeps))


def described(robot: RobotDescription, added: Sequence[LoopEffect]) -> RobotDescription:
    """A robot description with effects, wherever they act."""
    for one in added:
        robot = one.described(robot)
    return robot


def shared(
    missing: Sequence[Sequence[LoopEffect]], expected: Sequence[Sequence[LoopEffect]] = ()
) -> list[Sequence[LoopEffect]]:
    """The plants to compile: one for all that differ in effects alone that can stand idle, but for those that need the
    transmitted torque, which takes longer: they have another one.

    Args:
        missing: effects of each plant that is needed; expected: of others that will be, which share what is compiled.
    """
    needed, groups = {_key(added) for added in missing}, dict[Hashable, list[Sequence[LoopEffect]]]()
    for added in (*missing, *expected):
        own = [one for one in added if one.changes_equations]
        busy = frozenset(one.effect_at for one in own if not one.can_stand_idle)
        groups.setdefault((busy, any(_needs_load(one) for one in own)), []).append(own)
    wanted = [group for group in groups.values() if any(_key(own) in needed for own in group)]
    return [tuple({one.effect_at: one for own in group for one in own}.values()) for group in wanted]


def _needs_load(one: LoopEffect) -> bool:
    return isinstance(one.effect, TorqueEffect) and "load" in one.effect.needs


def _key(added: Sequence[LoopEffect]) -> Key:
    return tuple(one.effect_at for one in added if one.changes_equations)
