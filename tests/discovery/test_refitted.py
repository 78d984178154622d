"""Friction whose smoothing the description states otherwise: what identify doubts, discover names and writes down."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from fmu_didim import discover, identify
from tests.discovery.helpers import arm_case

TRUE = 0.02
"""rad/s, of the machine."""


def stated(folder: Path, velocity: float, hidden: dict[str, dict[str, float]] | None = None) -> Path:
    """The case of an arm whose description states this smoothing velocity of joint 1."""
    case = arm_case(folder, hidden)
    path = folder / "robot.yaml"
    robot = yaml.safe_load(path.read_text(encoding="utf-8"))
    assert robot["joints"][0]["parameters"].get("v0", TRUE) == TRUE
    robot["joints"][0]["parameters"]["v0"] = velocity
    path.write_text(yaml.safe_dump(robot, sort_keys=False), encoding="utf-8")
    return case


@pytest.mark.gate
@pytest.mark.parametrize("velocity", [0.2, 0.1])
def test_it_is_a_finding_and_written_into_the_robot(velocity: float, tmp_path: Path) -> None:
    case, out = stated(tmp_path, velocity), tmp_path / "out"
    sent = identify(case)
    assert sent.verdict == "doubtful"
    assert any("fmu-didim discover" in reason.next_step for reason in sent.document.reasons)
    found = discover(case, out)
    document = found.document
    assert (document.answer, found.verdict) == ("named", "valid")
    (finding,) = document.findings
    assert (finding.title, finding.joint) == ("Other smoothing of Coulomb friction", 1)
    assert f"instead of {velocity}" in finding.equation
    (value,) = finding.parameters
    assert value.value == pytest.approx(TRUE, rel=0.1)
    assert finding.gap["validation"].before > 2 * finding.gap["validation"].after
    assert document.ratio_interval is not None
    low, high = document.ratio_interval
    assert low is not None and high is not None and high < 1
    robot = yaml.safe_load((out / "robot_augmented.yaml").read_text(encoding="utf-8"))
    assert robot["joints"][0]["parameters"]["v0"] == pytest.approx(value.value, rel=1e-9)
    again = identify(out / "case_augmented.yaml")
    assert again.verdict == "valid", again.document.reasons


@pytest.mark.gate
def test_what_is_stated_rightly_is_no_finding(tmp_path: Path) -> None:
    found = discover(stated(tmp_path, TRUE), tmp_path / "out")
    assert (found.document.answer, found.document.findings) == ("nothing", [])
    assert not [note for note in found.document.notes if "was fitted" in note]
    assert not (tmp_path / "out" / "robot_augmented.yaml").exists()


@pytest.mark.gate
def test_beside_an_effect_it_is_told(tmp_path: Path) -> None:
    found = discover(stated(tmp_path, 0.1, {"quadratic_viscous": {"Fq": 0.3}}), tmp_path / "out")
    assert [(f.effect, f.joint) for f in found.document.findings] == [("quadratic_viscous", 1)]
    assert [note for note in found.document.notes if note.startswith("v0_1 was fitted: 0.0")]
