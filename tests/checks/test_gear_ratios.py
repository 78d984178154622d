"""Gear ratios that are stated twice: by the robot description and by the case."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from fmu_didim.case import load_case
from fmu_didim.checks.plant.gear_ratios import Brought, brought_by, gear_ratio_diagnostics
from fmu_didim.workflow.data import case_diagnostics
from tests.discovery.helpers import arm_case

CODE = "gear-ratios-differ"


@pytest.mark.parametrize(
    ("stated", "brought", "told"),
    [
        ({1: 100.0}, [Brought("a", 1, 100.0)], []),
        ({1: 100.0}, [Brought("a", 1, 100.05)], []),  # as a data sheet rounds it
        ({1: 100.0}, [Brought("a", 1, 101.0)], ["joint 1: The description states a gear ratio of 100, and a 101."]),
        ({2: 100.0}, [Brought("a", 1, 50.0)], []),  # nothing is stated of joint 1
        ({1: 100.0}, [Brought("a", 1, 50.0)] * 2, ["joint 1: The description states a gear ratio of 100, and a 50."]),
        ({1: 100.0, 2: 80.0}, brought_by("m", [[-100.0, 0.0], [0.0, 80.0]]), []),  # turned the other way
        ({1: 45.0}, brought_by("m", [[45.0, 0.0], [-32.0, 32.0]]), ["shares its motors with joint 2"]),
        ({2: 32.0}, brought_by("m", [[45.0, 0.0], [-32.0, 32.0]]), ["shares its motors with joint 1"]),
        ({3: 32.0}, brought_by("m", [[45.0, 0.0, 0.0], [-32.0, 32.0, 0.0], [0.0, 0.0, 32.0]]), []),
    ],
)
def test_motors_that_are_stated_in_two_ways(stated: dict[int, float], brought: list[Brought], told: list[str]) -> None:
    found = gear_ratio_diagnostics(stated, brought)
    assert len(found) == len(told)
    assert all(text in str(one) and one.code.name == CODE for one, text in zip(found, told, strict=True))


@pytest.mark.parametrize(
    ("entry", "told"),
    [
        ({}, False), ({"columns": {"tau1": {"gear_ratio": 50.0}}}, False),
        ({"columns": {"tau1": {"gear_ratio": 51.0}}}, True),
        ({"motors": [[-50.0]]}, False), ({"motors": [[49.0]]}, True),
    ],
)  # fmt: skip
def test_a_case_whose_log_is_brought_by_another_gear(entry: dict[str, object], told: bool, tmp_path: Path) -> None:
    path = arm_case(tmp_path)
    robot = yaml.safe_load((tmp_path / "robot.yaml").read_text())
    robot["joints"][0]["motor"] = {"gear_ratio": 50}
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(robot))
    case = yaml.safe_load(path.read_text())
    case["train"]["torque"] |= entry
    path.write_text(yaml.safe_dump(case))
    codes = [d.code.name for d in case_diagnostics(load_case(path))]
    assert (CODE in codes) == told
