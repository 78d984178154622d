"""All that is wrong with a campaign is told at once, before anything runs."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest
import yaml

from fmu_didim import InputError, Log, RobotModel, load_case, read_robot, study
from fmu_didim.campaigns.validation import case_problems, read_campaign
from fmu_didim.cli.main import main
from fmu_didim.dynamics.effects import TorqueEffect
from tests.campaigns.helpers import CASE, LAWS

GOOD: dict[str, Any] = {"name": "good", "case": str(CASE), "noise": {"relative": 0.05}}
MISTAKES: dict[str, tuple[dict[str, Any], str]] = {
    "unknown key": ({"sheduler": "here"}, r"sheduler: unknown key.*Valid keys: schema, name"),
    "negative noise": ({"noise": {"relative": -1}}, r"noise.relative: must be 0 or more"),
    "a seed twice": ({"seeds": [1, 1]}, "seeds: 1 is there twice"),
    "no list": ({"vary": {"loop.delay_samples": 3}}, r"vary.loop.delay_samples: give a list"),
    "unknown field": ({"vary": {"train.torqe.rate_hz": [5]}}, "train.torqe: unknown key. Did you mean 'torque'"),
    "bad value": ({"vary": {"train.torque.rate_hz": [20, -5]}}, r"rate_hz = -5: train.torque.rate_hz: .*than 0"),
    "too fast": ({"vary": {"validation.torque.rate_hz": [20, 4000]}}, r"rate_hz = 4000: .*than the control rate"),
    "no file": ({"vary": {"controller.source": [LAWS[0], "absent.yaml"]}}, r"absent: the file .*yaml does not exist"),
    "bad option": ({"vary": {"estimator.kind": ["didim", "dydim"]}}, "there is no estimator 'dydim'; valid: didim"),
    "bad name": ({"vary": {"estimator.start": [{"ZZ1R": 1}, {"ZZ9": 1}]}}, r"ZZ9: 1.*: There is no base parameter"),
    "bad parameter": ({"vary": {"robot.joints.0.parameters.Fq": [1]}}, r"robot.joints.0: unknown parameters Fq; valid"),
    "no such FMU": ({"limits": {"instances": {"v.fmu": 2}}}, r"limits.instances: no case names 'v.fmu' .*pd.yaml"),
    "no element": ({"vary": {"robot.joints.4.a": [1]}}, r"vary.robot.joints.4.a: The list has no such element"),
}  # fmt: skip
"""What is wrong -> entries that are merged into a good campaign, and what is told of it."""


LOADED = ("too fast", "bad name")
"""Those that are seen when the case is loaded."""


def merged(*parts: dict[str, Any]) -> dict[str, Any]:
    found: dict[str, Any] = {**GOOD, "vary": {}}
    for part in parts:
        for key, value in part.items():
            found[key] = {**found["vary"], **value} if key == "vary" else value
    return found


def problems(content: dict[str, Any]) -> list[str]:
    """What is told without loading a case."""
    plan, found = read_campaign(content, Path())
    return [*found, *(case_problems(plan, None)[0] if plan is not None else [])]


@pytest.mark.parametrize("name", [name for name in MISTAKES if name not in LOADED])
def test_each_mistake_by_its_form(name: str) -> None:
    entries, told = MISTAKES[name]
    found = problems(merged(entries))
    assert len(found) == 1
    assert re.search(told, found[0])


@pytest.mark.gate
def test_thirteen_mistakes_at_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "campaign.yaml"
    file.write_text(yaml.safe_dump(merged(*(entries for entries, _ in MISTAKES.values()))))
    assert main(["campaign", "run", str(file), "--out", str(tmp_path / "out"), "--workers", "1"]) == 1
    said = capsys.readouterr().err
    assert "has 13 problems" in said
    for name, (_, told) in MISTAKES.items():
        assert re.search(told, said), name
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("entries", "told"),
    [
        ({"noise": None, "seeds": 3}, "seeds: measured data have no noise seed"),
        ({"vary": [{"zip": {"loop.delay_samples": [1, 2], "loop.rate_hz": [1]}}]}, "as many values for each field"),
        ({"vary": [{"grid": {"a": [1]}, "zip": {"b": [1]}}]}, "give one of grid, zip, list"),
        ({"vary": [{"random": {"loop.delay_s": {"low": 0, "high": 1}}}]}, "random and latin_hypercube need count"),
        ({"vary": [{"random": {"loop.delay_s": {"low": 2, "high": 1}}, "count": 2}]}, "low must be less than high"),
        ({"vary": [{"grid": {"loop": [{}]}}, {"grid": {"loop.delay_s": [1]}}]}, "is part of loop"),
        ({"vary": [{"grid": {"loop.delay_s": [0]}}, {"grid": {"loop.delay_s": [1]}}]}, "varies in two blocks"),
        ({"vary": {"loop.delay_s": []}}, "has no values"),
        ({"seeds": 0}, "at least one"),
        ({"case": None}, "give case"),
        ({"case": "absent.yaml"}, r"The file does not exist. \(absent.yaml\)"),
    ],
)  # fmt: skip
def test_what_contradicts_itself(entries: dict[str, Any], told: str) -> None:
    assert any(re.search(told, text) for text in problems({**GOOD, **entries}))


@pytest.mark.gate
def test_a_good_campaign_has_no_problem(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "campaign.yaml"
    vary = {"controller.source": LAWS[:2], "train.torque.rate_hz": [20, 10, 10.0]}
    file.write_text(yaml.safe_dump({**GOOD, "vary": vary, "seeds": 5}))
    command = ["campaign", "run", str(file), "--out", str(tmp_path / "out"), "--workers", "1"]
    assert main([*command, "--dry-run"]) == 0
    said = capsys.readouterr().out
    assert "good: 20 runs of 4 cases" in said
    assert "10 further runs equal others" in said
    assert "by two trials; nothing was written" in said
    assert not (tmp_path / "out").exists()


def law(q_ref: Any, dq_ref: Any, q: Any, dq: Any) -> Any:
    return q_ref - q - dq


LOG = Log(np.arange(3.0), np.zeros((3, 2)))
LOADED = load_case("examples/scara/identify.yaml")


@pytest.mark.parametrize(
    ("entries", "told"),
    [
        ({"vary": {"controller": [law]}}, r"vary\.controller\n  got:   law\n  next:  .*file\.py:Name"),
        ({"vary": {"controller.source": [control.ss(*[np.eye(2)] * 4, 0.005)]}}, "got:   StateSpace"),
        ({"verb": "discover", "options": {"effects": [TorqueEffect]}}, r"options\.effects\n  got:   TorqueEffect"),
        ({"truth": {"train": {"torque": LOG}}}, r"truth\.train\.torque\n  got:   Log\n  next:  .*write_csv"),
        ({"case": LOADED.with_(controller=law, loop={"rate_hz": 200})}, r"case\.controller\.source\n  got:   law"),
        ({"case": LOADED.with_signals({"train_10hz.csv": LOG.signals})}, r"torque\.file\n  got:   Trajectory"),
    ],
    ids=["law", "system", "effect", "log", "law of a loaded case", "signals of a loaded case"],
)
def test_objects_in_memory_are_refused_with_the_way_out(entries: dict[str, Any], told: str) -> None:
    with pytest.raises(InputError, match=told):
        study(**{"case": str(CASE), "vary": {"train.torque.rate_hz": [5]}, **entries})


@pytest.mark.gate
def test_robots_in_memory_become_part_of_the_campaign(tmp_path: Path) -> None:
    robot = read_robot("fmus/scara/robot.yaml")
    found = study(LOADED.with_(robot=robot), vary={"robot.joints.0.parameters.Fv": [0.03, 0.06]}, out=tmp_path)
    found.check(workers=1)
    other = study(str(CASE), vary={"robot": [robot, RobotModel(robot.with_values({"Fv1": 0.06}))]}, out=tmp_path)
    friction = [
        each.plan.content(run.settings).case["robot"]["joints"][0]["parameters"]["Fv"]
        for each in (found, other) for run in each.plan.runs
    ]  # fmt: skip
    assert friction == [0.03, 0.06, 0.03, 0.06]
