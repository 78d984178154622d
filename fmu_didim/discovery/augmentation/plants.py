"""Plants with further effects in their equations, each compiled once."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from fmu_didim.base.errors import InputError
from fmu_didim.components import Component, ModelComponent
from fmu_didim.components.compiled_model import with_compiled_twin
from fmu_didim.discovery.augmentation.places import BaseLoop, LoopEffect
from fmu_didim.discovery.progress import Progress
from fmu_didim.dynamics.block import Block
from fmu_didim.dynamics.robot import RobotDescription, RobotModel
from fmu_didim.model.loop_model import EffectAtJoint
from fmu_didim.model.workers import side_by_side


class Plants:
    """The plants of a loop with effects in their equations."""

    def __init__(self, loop: BaseLoop) -> None:
        self.loop = loop
        plant = loop.model.loop.plant
        self._substeps = getattr(plant, "substeps", None) or getattr(plant, "options", {}).get("substeps")
        self._compiled: dict[tuple[EffectAtJoint, ...], Component] = {(): plant}

    def plant(self, added: Sequence[LoopEffect]) -> Component:
        """The plant with those of these effects that change its equations.

        Raises:
            InputError: the plant is a black box.
        """
        key = _key(added)
        if key not in self._compiled:
            self._compiled[key] = self._compile(self._block(added))
        return self._compiled[key]

    def compile(self, wanted: Sequence[Sequence[LoopEffect]], *, progress: Progress, workers: int) -> None:
        """Compile the plants with these effects side by side: a compiler keeps one core busy, and takes seconds."""
        missing = {_key(added): added for added in wanted}
        blocks = {key: self._block(added) for key, added in missing.items() if key not in self._compiled}
        report = progress.counted("compiling plant", len(blocks))

        def compile_one(key: tuple[EffectAtJoint, ...], block: Block) -> None:
            if not progress.is_time_up:
                self._compiled[key] = self._compile(block)
                report("")

        side_by_side([partial(compile_one, key, block) for key, block in blocks.items()], workers)

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


def _key(added: Sequence[LoopEffect]) -> tuple[EffectAtJoint, ...]:
    return tuple(one.effect_at for one in added if one.changes_equations)
