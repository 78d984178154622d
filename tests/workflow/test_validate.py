"""All mistakes of a case at once, each with its file and line; places that are still to be filled in."""

from __future__ import annotations

from pathlib import Path

import pytest

from fmu_didim.base.errors import InputError
from fmu_didim.case import read_case
from fmu_didim.controllers import read_controller
from fmu_didim.dynamics.robot import read_robot
from fmu_didim.workflow.validate import mistakes

CASE = """\
schema: 1
name: wrong
robot: robot.yaml
plant: {kind: fmu}
controller: {kind: fmu, source: pd.yaml}
lop: {rate_hz: 200}
train:
  reference: {file: motion.csv, columns: {q1: {name: Achse1, unit: mm}}}
  torque:
    file: log.csv
    columns: {tau1: Moment}
validation:
  reference: {file: absent.csv}
  torque: {file: log.csv, rate_hz: -5}
"""
ROBOT = "schema: 1\nname: arm\njoints:\n  - type: revolute\n    effects: [viscos]\n"
PD = "schema: 1\nlaw: pd\nname: pd\njoints: [revolute]\nrate_hz: 200\nKp: [1, 2]\nKd: [1]\n"


def folder(path: Path, case: str = CASE, robot: str = ROBOT, law: str = PD) -> Path:
    for name, text in (("case.yaml", case), ("robot.yaml", robot), ("pd.yaml", law)):
        (path / name).write_text(text, encoding="utf-8")
    rows = "".join(f"{0.005 * k:.3f},{k % 7}\n" for k in range(40))
    (path / "motion.csv").write_text("t,Achse1\n" + rows, encoding="utf-8")
    (path / "log.csv").write_text("t,Drehmoment\n" + rows, encoding="utf-8")
    return path / "case.yaml"


def test_all_mistakes_at_once_with_their_lines(tmp_path: Path) -> None:
    text = "\n".join(mistake.text for mistake in mistakes(folder(tmp_path)))
    for part in (
        "line 6, lop: unknown key. Did you mean 'loop'?",
        "line 14, validation.torque.rate_hz: must be greater than 0",
        "line 5, joints.0.effects",
        "viscos",
        "Kp has 2 values for 1 joints",
        "There is no column named 'Moment'",
        "log.csv",
    ):
        assert part in text, part


def test_mistakes_in_the_data_name_the_file(tmp_path: Path) -> None:
    case = CASE.replace("lop:", "loop:").replace(", rate_hz: -5", "")
    robot, law = ROBOT.replace("viscos", "viscous"), PD.replace("[1, 2]", "[1]")
    found = {
        Path(mistake.where.partition(",")[0]).name: mistake.text
        for mistake in mistakes(folder(tmp_path, case, robot, law))
    }
    assert set(found) == {"motion.csv", "log.csv", "absent.csv"}
    assert "unit of q1" in found["motion.csv"] and "valid: rad" in found["motion.csv"]


def test_right_case_has_none() -> None:
    assert mistakes("examples/scara/identify.yaml") == []


def test_what_is_to_be_filled_in_is_told_with_its_line_and_comment(tmp_path: Path) -> None:
    robot = ROBOT.replace("[viscos]", "[viscous]").replace(
        "name: arm", "name: arm\ngravity: EDIT  # in the base frame, m/s2"
    )
    law = PD.replace("Kp: [1, 2]", "Kp: [EDIT]  # of the drive").replace("Kd: [1]", "Kd: [-]")
    case = folder(tmp_path, CASE.replace("Moment", "EDIT"), robot, law)
    with pytest.raises(InputError, match=r"line 3, gravity: still to be filled in \(in the base frame, m/s2\)"):
        read_robot(tmp_path / "robot.yaml")
    with pytest.raises(
        InputError, match=r"2 problems:\n  - line 6, Kp\.0: still to be filled in \(of the drive\)\n  - line 7, Kd"
    ):
        read_controller(tmp_path / "pd.yaml")
    with pytest.raises(InputError, match=r"line 11, train\.torque\.columns\.tau1: still to be filled in"):
        read_case(case)
