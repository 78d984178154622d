"""What acts in an elastic gear has a place only where there is one."""

from __future__ import annotations

import pytest

from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.augmentation.places import Proposal
from fmu_didim.dynamics.robot.files import read_robot
from fmu_didim.model.loop_model import EffectAtJoint
from tests.discovery.helpers import arm_model

GEAR, ERROR, SPRING = (EffectAtJoint(name, 2) for name in ("joint_elasticity", "transmission_error", "spring"))


HARDENING = EffectAtJoint("gear_hardening", 2)


@pytest.fixture(scope="module")
def builder(tmp_path_factory: pytest.TempPathFactory) -> LoopModelBuilder:
    folder = tmp_path_factory.mktemp("two")
    model = arm_model(folder, joints=2, seconds=1.0, gear={"K": 1500.0, "motor_share": 0.4})
    return LoopModelBuilder(model, read_robot(folder / "robot.yaml"))


def test_a_gear_must_give_way_on_its_joint(builder: LoopModelBuilder) -> None:
    assert builder.has_place(EffectAtJoint("gear_hardening", 1), ())
    assert not builder.has_place(HARDENING, ()) and builder.has_place(HARDENING, (GEAR,))
    assert builder.has_place(EffectAtJoint("transmission_error", 1), ())  # its gear is in the description
    assert not builder.has_place(ERROR, ()) and not builder.has_place(ERROR, (EffectAtJoint("backlash", 1),))
    assert builder.has_place(ERROR, (GEAR,)) and builder.has_place(ERROR, (EffectAtJoint("backlash", 2),))
    assert builder.has_place(SPRING, ()) and builder.has_place(GEAR, ())


def test_without_the_gear_its_error_goes_too_and_all_else_stays(builder: LoopModelBuilder) -> None:
    error = Proposal(ERROR, {"gear_cosine": 1e-4, "gear_sine": 2e-4, "gear_number": 60.0})
    model = builder.build(builder.base, [Proposal(GEAR, {"K": 900.0}), error, Proposal(SPRING, {"ks": 3.0, "cs": 0.5})])
    assert "gear_number_2" in model.names
    without = builder.without(model, 0)
    assert without.added_effects == (SPRING,)
    assert not {"K_2", "gear_cosine_2", "gear_number_2"} & set(without.names)
    own = [p for p in without.free_parameters if p.effect is not None]
    assert own and {p.effect for p in own} == {0} and {p.name for p in own} <= set(model.names)
    assert builder.without(model, 1).added_effects == (GEAR, SPRING)
