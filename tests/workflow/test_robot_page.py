"""The page of a robot description: what is drawn, what is told, and what is refused."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmu_didim.base.errors import InputError
from fmu_didim.cli.main import main
from fmu_didim.dynamics.robot import RobotDescription, read_robot
from fmu_didim.workflow.robot_file import reach, robot_lines, write_picture
from tests.helpers import ROOT

TX40 = ROOT / "fmus/tx40/robot.yaml"
SCARA = ROOT / "fmus/scara/robot.yaml"


def drawn(path: Path) -> dict[str, Any]:
    found = re.search(r'id="robot-data">(.*?)</script>', path.read_text(encoding="utf-8"), re.DOTALL)
    assert found is not None
    return dict(json.loads(found[1]))


def test_a_page_has_the_frames_and_the_ellipsoids_of_the_description(tmp_path: Path) -> None:
    path, robot = write_picture(read_robot(TX40), tmp_path / "robot.html"), read_robot(TX40)
    page, text = drawn(path), path.read_text(encoding="utf-8")
    for one, joint in zip(page["joints"], robot.joints, strict=True):
        assert [one[key] for key in ("alpha", "a", "theta", "d")] == [joint.alpha, joint.a, joint.theta, joint.d]
        mass, centre = joint.parameters["M"], np.array(one["ellipsoid"]["centre"])
        assert mass * centre == pytest.approx([joint.parameters.get(key, 0.0) for key in ("MX", "MY", "MZ")])
        assert (one["low"], one["high"], one["limits"]) == (-np.pi, np.pi, False)
    assert page["gravity"] == list(robot.gravity)
    assert "ZZ1 + Ia1 + YY2" in text
    assert 'id="remarks"' not in text


def test_links_without_an_ellipsoid_are_told(tmp_path: Path) -> None:
    path = write_picture(read_robot(SCARA), tmp_path / "robot.html")
    assert [one["ellipsoid"] for one in drawn(path)["joints"]] == [None, None]
    assert "Link 1 is drawn without an ellipsoid: its mass is not given." in path.read_text(encoding="utf-8")


def test_a_name_cannot_leave_its_place(tmp_path: Path) -> None:
    robot = read_robot(SCARA)
    evil = robot.joints[0].model_copy(update={"name": "</script><script>alert(1)</script>"})
    path = write_picture(robot.model_copy(update={"joints": (evil, robot.joints[1])}), tmp_path / "robot.html")
    assert "<script>alert" not in path.read_text(encoding="utf-8")
    assert drawn(path)["joints"][0]["name"] == evil.name


def planar(limits: tuple[float, float] | None, kind: str = "revolute") -> RobotDescription:
    """Two links of 0.5 m and 0.3 m; the last frame is at the end."""
    joints = [{"type": "revolute"}, {"type": kind, "a": 0.5}, {"type": "revolute", "a": 0.3}]
    if limits is not None:
        joints[1]["limits"] = limits
    return RobotDescription.model_validate({"name": "arm", "joints": joints})


@pytest.mark.parametrize(
    ("robot", "expected"),
    [
        (planar(None), 0.8),
        (planar((np.pi / 2, np.pi)), np.hypot(0.5, 0.3)),
        (planar((0.0, 0.6), "prismatic"), np.hypot(0.8, 0.6)),
        (planar((-0.7, 0.6), "prismatic"), np.hypot(0.8, 0.7)),
    ],
)
def test_reach(robot: RobotDescription, expected: float) -> None:
    assert reach(robot) == pytest.approx(expected, rel=1e-6)
    assert f"Reach: {expected:.4g} m" in "\n".join(robot_lines(robot))


def test_no_reach_where_a_joint_slides_without_limits() -> None:
    assert "Reach: not known, joint 2 slides without limits" in "\n".join(robot_lines(planar(None, "prismatic")))


def test_the_command_writes_it_and_overwrites_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = tmp_path / "scara.html"
    assert main(["robot", str(SCARA), "--page", str(page)]) == 0
    assert f"Page: {page}" in capsys.readouterr().out
    with pytest.raises(InputError, match="there already"):
        write_picture(read_robot(SCARA), page)
    with pytest.raises(InputError, match="written as a page"):
        write_picture(read_robot(SCARA), tmp_path / "scara.png")
