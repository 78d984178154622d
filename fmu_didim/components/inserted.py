"""Effects of drives and sensors as components, compiled once and kept."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

from fmu_didim.components.compiled_model import with_compiled_twin
from fmu_didim.components.model import ModelComponent
from fmu_didim.data.signals import Variable
from fmu_didim.dynamics.effects import JointType
from fmu_didim.dynamics.effects.inserted import InsertedEffect


@dataclass(frozen=True)
class InsertedComponent(ModelComponent):
    """A component that holds its effect, from which its place in the drive follows.

    Attributes:
        effect: the effect whose block it is.
    """

    effect: InsertedEffect | None = None

    def with_parameters(self, values: Mapping[str, float]) -> InsertedComponent:
        other = super().with_parameters(values)
        return replace(self, block=other.block, twin=other.twin)

    def with_names(self, inputs: tuple[Variable, ...], outputs: tuple[Variable, ...]) -> InsertedComponent:
        other = super().with_names(inputs, outputs)
        return replace(self, block=other.block, twin=other.twin)

    def with_substeps(self, count: int) -> InsertedComponent:
        return self  # nothing is integrated

    def describe(self) -> dict[str, Any]:
        values = {v.name: v.start for v in self.parameters}
        return {**super().describe(), "effect": self.block.name, "parameters": values}


def inserted_component(
    effect: InsertedEffect, joint_type: JointType, step: float, values: Mapping[str, float] | None = None
) -> InsertedComponent:
    """The component with input ``u`` and output ``y`` that has this effect; it also runs in the compiled loop.

    Args:
        effect: the effect; joint_type: type of its joint.
        step: control period, s.
        values: parameters by their plain names; the others are neutral.

    Raises:
        UnknownNameError: the effect has no such parameter.
    """
    return _neutral(effect, joint_type, step).with_parameters(dict(values or {}))


@lru_cache(maxsize=64)
def _neutral(effect: InsertedEffect, joint_type: JointType, step: float) -> InsertedComponent:
    model = with_compiled_twin(ModelComponent(effect.block(joint_type, step)))
    return InsertedComponent(model.block, model.substeps, model.twin, effect)
