"""The tool of small ripples at known counts: what it hides, states and counts."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.tools.known_ripples.__main__ import main
from tests.tools.known_ripples.cases import MOTORS, WRONG, make, stated
from tests.tools.known_ripples.score import figures_of, read, result_of


def finding(effect: str, joint: int, count: float, origin: str = "") -> dict[str, Any]:
    name = "eccentricity_number" if effect == "encoder_eccentricity" else "nr"
    return {
        "effect": effect,
        "joint": joint,
        "parameters": [{"name": f"{name}_{joint}", "value": count}],
        "origin": origin,
    }


@pytest.mark.parametrize(
    ("findings", "clutter", "named", "origin", "false"),
    [
        ([], True, False, "", 0),
        ([finding("torque_ripple", 2, 40.3, "commutation")], True, True, "commutation", 0),
        ([finding("current_ripple", 2, 39.2)], True, True, "", 0),
        ([finding("torque_ripple", 2, 41.2)], True, False, "", 1),  # another frequency
        ([finding("torque_ripple", 1, 40.0)], True, False, "", 1),  # another joint
        ([finding("torque_ripple", 2, 23.2)], True, False, "", 0),  # planted by the simulator
        ([finding("torque_ripple", 2, 23.2)], False, False, "", 1),
        ([finding("encoder_eccentricity", 2, 40.0)], True, True, "", 0),
        ([{"effect": "stribeck", "joint": 2, "parameters": []}], True, False, "", 0),  # no ripple
    ],
)
def test_what_counts(findings: list[Any], clutter: bool, named: bool, origin: str, false: int) -> None:
    hidden = [{"joint": 2, "count": 40}]
    reasons = [{"code": "ripple-not-of-motor"}] if false else []
    found = result_of("r001_050_20hz", "right", hidden, {"findings": findings, "reasons": reasons}, clutter=clutter)
    assert (found.level, found.rate, found.named, found.origin, len(found.false)) == (0.5, 20, named, origin, false)
    assert found.told == bool(false)
    right = f"{int(bool(origin))} of {int(named)}"
    row = ["0.5 σ", "20 Hz", "0 of 0", f"{int(named)} of 1", right, f"{false} of 1"]
    assert figures_of([found])["levels"][-1] == f"| {' | '.join(row)} |"


def test_the_shares_of_plants_without_a_ripple() -> None:
    false = {"findings": [finding("torque_ripple", 1, 40.0)], "reasons": []}
    nothing: dict[str, Any] = {"findings": [], "reasons": []}
    clean = [result_of("r002_000_20hz", "right", [], one, clutter=False) for one in (false, nothing)]
    other = [result_of("o002_000_20hz", "right", [], one, clutter=False) for one in (nothing, nothing, nothing)]
    found = figures_of([*clean, *other])
    assert (found["clean_right"], found["clean_right_false"]) == ("2", "1 of 2")
    assert (found["other_right"], found["other_right_false"]) == ("3", "0 of 3")
    assert "other_nothing" not in found


def test_a_plant_and_what_is_stated_of_its_motor(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    make(tmp_path, 2, 0.5, (20,))
    case = tmp_path / "r002_050_20hz"
    truth = yaml.safe_load((case / "truth.yaml").read_text())
    known = json.loads((case / "motor.json").read_text())
    motor, counts = MOTORS[2]
    assert known["motor"] == motor and known["hidden"][0]["count"] in counts
    assert truth["truth"][0]["form"] == f"a sin({known['hidden'][0]['count']} q + p)"
    assert max(truth["gap_after_refit_sigma_rms_per_joint"]["train"]) == pytest.approx(0.5, rel=0.06)
    for how, ratio in (("nothing", None), ("right", 50), ("wrong", WRONG * 50)):
        robot = yaml.safe_load((stated(case, tmp_path / how, how).parent / "robot.yaml").read_text())
        assert [j.get("motor", {}).get("gear_ratio") for j in robot["joints"]] == [ratio] * len(robot["joints"])
    (case / "right" / "result").mkdir(parents=True)
    (case / "right" / "result" / "findings.json").write_text(json.dumps({"findings": [], "reasons": []}))
    assert [(r.name, r.how, r.named) for r in read(tmp_path)] == [("r002_050_20hz", "right", False)]
    assert main(["score", str(tmp_path), "--figures", str(tmp_path / "figures.json")]) == 0
    assert "r002_050_20hz right: not named" in capsys.readouterr().out
    assert json.loads((tmp_path / "figures.json").read_text())["figures"]["levels"][-1].endswith("| 0 of 1 |")
