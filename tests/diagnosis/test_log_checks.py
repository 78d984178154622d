"""Logs that cannot be those of the loop: turned signs, joints in another order, other units."""

from __future__ import annotations

import re

import numpy as np
import pytest

from fmu_didim.diagnosis.log_checks import check_log
from fmu_didim.errors import InputError
from fmu_didim.prediction.loop_model import LoopModel
from fmu_didim.signals import Array
from tests.discovery.helpers import arm_model, with_torque


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> LoopModel:
    return arm_model(tmp_path_factory.mktemp("arm"), joints=2)


def off(arm: LoopModel, torque: Array) -> LoopModel:
    """The loop with this log; its parameters start 40 % off."""
    model = with_torque(arm, torque)
    factors = np.where(np.arange(model.start.size) % 2, 0.6, 1.4)
    return model.with_values(model.start * factors)


def test_a_log_of_the_loop_passes(arm: LoopModel) -> None:
    noise = 0.3 * np.std(arm.measured, axis=0) * np.random.default_rng(1).normal(size=arm.measured.shape)
    assert check_log(off(arm, arm.measured + noise), "estimation") == ()


@pytest.mark.parametrize("turned", [[1], [2], [1, 2]])
def test_turned_signs_are_refused_with_their_joints(arm: LoopModel, turned: list[int]) -> None:
    sign = np.array([-1.0 if j in turned else 1.0 for j in (1, 2)])
    with pytest.raises(InputError) as refused:
        check_log(off(arm, sign * arm.measured), "estimation")
    assert f"joint {', '.join(map(str, turned))}" in str(refused.value)
    assert re.search(r"correlation -(0\.9|1\.0)", str(refused.value))


def test_joints_in_another_order_are_refused(arm: LoopModel) -> None:
    with pytest.raises(InputError, match=r"another order[\s\S]*column 1 shows joint 2, column 2 shows joint 1"):
        check_log(off(arm, arm.measured[:, ::-1]), "estimation")


@pytest.mark.parametrize("factor", [1000.0, 1 / 120])
def test_another_unit_is_remarked(arm: LoopModel, factor: float) -> None:
    (remark,) = check_log(off(arm, arm.measured * [1.0, factor]), "estimation")
    assert "joint 2" in remark
    assert "unit" in remark


def test_a_loop_that_cannot_run_from_the_start_is_left_to_the_fit(arm: LoopModel) -> None:
    assert check_log(arm.with_values(arm.start * -1.0), "estimation") == ()
