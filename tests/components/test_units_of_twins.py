"""A compiled twin takes values in the units of its model, or there is none."""

from __future__ import annotations

from dataclasses import replace

import pytest

from fmu_didim.components.compiled_model import with_compiled_twin
from fmu_didim.components.model import ModelComponent
from fmu_didim.dynamics.robot import RobotModel, read_robot
from tests.conftest import ROOT


@pytest.mark.parametrize(("unit", "compiled"), [("m", True), ("mm", False)])
def test_a_model_that_is_not_in_si_units_has_no_compiled_twin(unit: str, compiled: bool) -> None:
    block = RobotModel(read_robot(ROOT / "fmus/emps/robot.yaml")).block()
    parameters = tuple(replace(v, unit=unit) if v.name == "q_start1" else v for v in block.parameters)
    found = with_compiled_twin(ModelComponent(replace(block, parameters=parameters)))
    assert (found.twin is not None) is compiled
