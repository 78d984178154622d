"""Plants of candidates, compiled side by side before they are asked for."""

from __future__ import annotations

from typing import Any

import pytest

from fmu_didim.case import load_case
from fmu_didim.discovery.augmentation import plants
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.augmentation.places import Proposal
from fmu_didim.discovery.progress import Progress
from fmu_didim.model.loop_model import EffectAtJoint
from tests.discovery.helpers import arm_case

GEAR, SPRING, LAG, CLOCK = (
    EffectAtJoint(name, 1) for name in ("joint_elasticity", "spring", "actuator_lag", "log_time_shift")
)


@pytest.fixture
def builder(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> tuple[LoopModelBuilder, list[Any]]:
    """A builder on an arm, and the blocks that it has compiled."""
    case = load_case(arm_case(tmp_path, held_out=False))
    compiled: list[Any] = []
    monkeypatch.setattr(plants, "with_compiled_twin", lambda component: compiled.append(component.block) or component)
    return LoopModelBuilder(case.model, case.parameters.model.description), compiled  # type: ignore[union-attr]


@pytest.mark.gate
def test_each_plant_is_compiled_once(builder: tuple[LoopModelBuilder, list[Any]]) -> None:
    """What stands in the wiring or changes the log needs no plant of its own."""
    made, compiled = builder
    said: list[str] = []
    wanted = [[GEAR], [SPRING], [GEAR], [LAG], [CLOCK], [LAG, SPRING]]
    made.prepare(wanted, progress=Progress(said.append), workers=2)
    assert len(compiled) == 2
    made.prepare([[SPRING]], progress=Progress(), workers=2)
    model = made.build(made.base, [Proposal(SPRING, {})])
    assert len(compiled) == 2
    assert model.added_effects == (SPRING,)
    assert model.loop.plant.block in compiled  # type: ignore[attr-defined]
    assert model.loop.plant is made.build(made.base, [Proposal(LAG, {}), Proposal(SPRING, {})]).loop.plant


def test_nothing_is_compiled_when_the_time_is_up(builder: tuple[LoopModelBuilder, list[Any]]) -> None:
    """A plant that is asked for all the same is still there."""
    made, compiled = builder
    made.prepare([[GEAR], [SPRING]], progress=Progress(ends=0.0), workers=1)
    assert compiled == []
    made.build(made.base, [Proposal(SPRING, {})])
    assert len(compiled) == 1
