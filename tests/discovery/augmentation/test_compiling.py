"""Plants of candidates, compiled side by side before they are asked for."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from fmu_didim.case import load_case
from fmu_didim.discovery.augmentation import plants
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.augmentation.places import BaseLoop, Proposal, placed
from fmu_didim.discovery.progress import Progress
from fmu_didim.dynamics.effects import EFFECTS, TorqueEffect
from fmu_didim.dynamics.robot import RobotModel, read_robot
from fmu_didim.fit.fit import Fit
from fmu_didim.model.loop_model import EffectAtJoint, LoopModel
from tests.discovery.by_hand import TableModel, fit_of, residual
from tests.discovery.helpers import arm_case
from tests.helpers import ROOT, model_of

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


# ---- plants that several models share: what one of them lacks stands idle -------------------------------------------

CUBIC, STRIBECK, LOADED, EFFICIENCY, LUGRE = (
    EffectAtJoint(name, 1)
    for name in ("cubic_spring", "stribeck", "load_dependent_friction", "directional_efficiency", "lugre")
)


def effects_of(block: Any) -> set[str]:
    """Names of the parameters that no arm without effects has."""
    return {v.name for v in block.parameters} & {"k1", "kcube1", "Fs1", "Fl1", "Fldrive1", "Flback1", "Fz1", "K_1"}


def test_candidates_that_can_stand_idle_share_a_plant(builder: tuple[LoopModelBuilder, list[Any]]) -> None:
    """What needs the transmitted torque, which takes longer to simulate, another one; states and gears none."""
    made, compiled = builder
    wanted = [[SPRING], [LUGRE], [CUBIC], [LOADED], [GEAR], [EFFICIENCY], [STRIBECK]]
    made.prepare(wanted, progress=Progress(), workers=1)
    own = [{"Fz1"}, {"K_1"}, {"Fl1", "Fldrive1", "Flback1"}, {"k1", "kcube1", "Fs1"}]
    assert sorted(map(sorted, map(effects_of, compiled))) == sorted(map(sorted, own))
    values = {"k": 3.0}
    model = made.build(made.base, [Proposal(SPRING, values)])
    settled = made.settled(start_fit(model)).model
    assert len(compiled) == 5 and effects_of(compiled[-1]) == {"k1"}
    assert model.names == settled.names and settled.loop.plant is not model.loop.plant
    torque, alone = (m.torque(m.start) for m in (model, settled))
    np.testing.assert_allclose(torque, alone, rtol=0, atol=1e-9 * np.abs(alone).max())
    assert np.abs(alone - made.base.torque(made.base.start)).max() > 0.1
    assert made.settled(start_fit(settled)).model is settled and len(compiled) == 5


def start_fit(model: LoopModel) -> Fit:
    """A fit that stands where its model starts."""
    return replace(fit_of(TableModel(residual(1.0), {})), model=model)


def test_a_model_without_one_of_its_effects_has_the_plant_with_it(builder: tuple[LoopModelBuilder, list[Any]]) -> None:
    made, compiled = builder
    both = made.build(made.base, [Proposal(SPRING, {"k": 3.0}), Proposal(LUGRE, {})])
    assert len(compiled) == 1
    without_spring, without_friction = made.without(both, 0), made.without(both, 1)
    assert without_spring.loop.plant is both.loop.plant  # its stiffness is zero there
    assert len(compiled) == 2 and effects_of(compiled[-1]) == {"k1"}  # bristles have states
    assert without_friction.loop.plant is not both.loop.plant
    assert "k1" not in without_spring.names and without_spring.added_effects == (LUGRE,)


@pytest.mark.parametrize(
    ("expected", "plants_with"),
    [
        ([], [{"k1"}]),
        ([[SPRING], [CUBIC], [STRIBECK]], [{"k1", "kcube1", "Fs1"}]),
        ([[LOADED], [LUGRE], [GEAR]], [{"k1"}]),  # none of which shares its plant
        ([[CUBIC, STRIBECK]], [{"k1", "kcube1", "Fs1"}]),
    ],
)
def test_what_is_expected_shares_what_is_compiled(
    builder: tuple[LoopModelBuilder, list[Any]], expected: list[Any], plants_with: list[set[str]]
) -> None:
    made, compiled = builder
    made.expect(expected)
    made.prepare([[SPRING]], progress=Progress(), workers=1)
    assert [effects_of(block) for block in compiled] == plants_with


def test_beside_what_is_added_candidates_share_too(builder: tuple[LoopModelBuilder, list[Any]]) -> None:
    made, compiled = builder
    made.expect([[LUGRE, STRIBECK], [CUBIC]])  # the second one is none beside bristles
    made.prepare([[LUGRE, SPRING], [LUGRE]], progress=Progress(), workers=1)
    assert [effects_of(block) for block in compiled] == [{"Fz1", "k1", "Fs1"}]


@pytest.mark.parametrize("name", EFFECTS)
def test_what_can_stand_idle_changes_nothing_there(name: str) -> None:
    """Neither the equations nor the step of the integration, at any motion, torque and shape."""
    effect, robot = EFFECTS[name], read_robot(ROOT / "fmus/scara/robot.yaml")
    loop = BaseLoop(model_of("examples/scara/identify.yaml"), robot)
    at = placed(EffectAtJoint(name, 1), effect, loop)
    timeless = isinstance(effect, TorqueEffect) and "time" not in effect.needs
    stateless = timeless and not effect.states("revolute")  # type: ignore[attr-defined]
    if not at.can_stand_idle:
        assert not stateless or effect.is_form or effect.sets_rate  # type: ignore[attr-defined]
        return
    assert stateless
    plain, idle = RobotModel(robot).block(), RobotModel(at.described(robot)).block()
    values = dict(zip((v.name for v in plain.parameters), plain.parameter_values, strict=True))
    chosen = np.random.default_rng(0)
    for _ in range(20):
        x, u = chosen.normal(size=len(plain.states)), chosen.normal(size=2)
        p = [values.get(v.name, v.start) for v in idle.parameters]
        own = plain.parameter_values
        np.testing.assert_allclose(idle.update(x, u, p), plain.update(x, u, own), rtol=1e-9, atol=1e-9)
        shown = [[v.name for v in idle.outputs].index(v.name) for v in plain.outputs]  # some show the load as well
        np.testing.assert_allclose(idle.output(x, u, p).full()[shown], plain.output(x, u, own), rtol=1e-9, atol=1e-9)
        assert plain.rate_bound is not None and idle.rate_bound is not None
        np.testing.assert_allclose(idle.rate_bound(x, p), plain.rate_bound(x, plain.parameter_values), rtol=1e-9)
