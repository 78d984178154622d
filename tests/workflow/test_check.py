"""What the verb check says of a case before any long work."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from fmu_didim import (
    Checked,
    IdentificationError,
    RobotModel,
    build_fmu,
    check,
    discover,
    identify,
    load_case,
    read_robot,
    trajectory,
)
from fmu_didim.base.diagnostics import DOUBT, PROBLEM, DiagnosedError
from fmu_didim.cli.main import main
from fmu_didim.workflow.reference.codes import all_codes
from tests.workflow.three_experiments import three_experiments

CASE = "examples/scara/identify.yaml"
ROBOT = Path("fmus/scara/robot.yaml")


def lines(found: Checked) -> str:
    """The summary as one line, so that it does not matter where it breaks."""
    return " ".join(found.summary().split())


def test_case_without_fault_is_ready() -> None:
    found = check(CASE)
    assert found.ok
    assert found.found(PROBLEM) == found.found(DOUBT) == found.confounded == ()
    assert [d.code.name for d in found.diagnostics] == ["parameters-not-significant"]
    assert "will not distinguish Fv1 from zero" in lines(found) and "Fv1 * " in found.summary()
    assert found.parameters == load_case(CASE).model.names
    assert found.start == "the motion that the measured torque implies"
    assert 4 < found.error_percent["validation"] < 10
    assert found.consistency is None
    assert max(len(line) for line in found.summary().splitlines()) <= 100
    assert lines(found).endswith("READY: nothing stands against an identification")


def test_experiments_are_shown_with_their_roles() -> None:
    text = lines(check(three_experiments()))
    assert "payload (estimation): 201 samples at 20 Hz" in text
    assert "check (validation): 101 samples at 10 Hz" in text
    assert "ZZ2[payload]" in text


def test_torque_with_the_wrong_sign_is_a_problem() -> None:
    case = load_case(CASE)
    log = case.model.experiments["estimation"]
    turned = trajectory(log.time, {"tau1": -log.torque[:, 0], "tau2": log.torque[:, 1]})
    found = check(case.with_signals({"train_10hz.csv": turned}))
    assert not found.ok
    assert "PROBLEM torque-sign: estimation: joint 1: The measured torque runs against the simulated one" in lines(
        found
    )
    assert "Next: Reverse the sign of these columns" in lines(found)
    assert lines(found).endswith("NOT READY: fix the problems above")


def test_problem_is_refused_by_identify_and_discover_and_a_doubt_goes_on(tmp_path: Path) -> None:
    case = load_case(CASE)
    log = case.model.experiments["estimation"]
    turned = trajectory(log.time, {"tau1": -log.torque[:, 0], "tau2": log.torque[:, 1]})
    for verb in (identify, discover):
        with pytest.raises(DiagnosedError, match=r"runs against[\s\S]*torque-sign[\s\S]*estimation: joint 1"):
            verb(case.with_signals({"train_10hz.csv": turned}))
    outcome = identify(case.with_(validation={"torque": None}))
    assert (outcome.verdict, [reason.code for reason in outcome.reasons]) == ("doubtful", ["validation-without-torque"])


def test_codes_of_all_modules_are_printed_with_meaning_and_advice(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "--codes"]) == 0
    printed = capsys.readouterr().out
    flat = " ".join(printed.split())
    written = {
        name
        for path in Path("fmu_didim").rglob("*.py")
        for name in re.findall(r'(?m)^[A-Z_]+ = CATALOGUE\(\s*"([a-z0-9-]+)"', path.read_text(encoding="utf-8"))
    }
    assert {code.name for code in all_codes()} == written and len(written) > 25
    for code in all_codes():
        assert f"{code.name} ({code.severity.value}) {code.meaning}" in flat
        assert not code.next_step or f"Next: {code.next_step}" in flat
    assert max(map(len, printed.splitlines())) <= 100


def test_check_without_a_case_says_what_it_needs(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check"]) == 1
    assert "check needs a case" in capsys.readouterr().err


def test_parameters_that_cannot_be_told_apart_are_named() -> None:
    gains = {f"gain{j}": {"of": "drive", "joint": j} for j in (1, 2)}
    case = load_case(CASE).with_(identify=gains, estimator={"kind": "didim", "start": "reference"})
    found = check(case)
    assert {"gain1", "gain2"} <= set(found.confounded)
    assert not found.ok
    assert "PROBLEM parameters-confounded: These data do not tell" in lines(found)
    assert "Leave one of them out" in lines(found)
    with pytest.raises(IdentificationError, match="apart"):
        identify(case)


def test_delay_that_the_estimator_frees_is_among_the_parameters() -> None:
    assert check(load_case(CASE).with_(estimator={"estimate_delay": True})).parameters[-1] == "delay"


def fmu_of(robot: Path, folder: Path) -> str:
    """The FMU of a robot description, built in a folder."""
    return str(build_fmu(RobotModel(read_robot(robot)).block(), directory=folder).resolve())


@pytest.mark.gate
def test_plant_that_is_not_that_of_the_description_is_a_warning(tmp_path: Path) -> None:
    longer = tmp_path / "longer.yaml"
    longer.write_text(ROBOT.read_text(encoding="utf-8").replace("a: 0.5", "a: 0.6"), encoding="utf-8")
    found = check(load_case(CASE).with_(plant={"source": fmu_of(longer, tmp_path)}))
    assert found.consistency is not None
    assert found.consistency.warnings()
    assert set(found.consistency.warnings()) <= {d.text for d in found.found(DOUBT) if d.code.name == "plant-differs"}
    assert "DOUBT plant-differs: plant: MX2: the column differs most" in lines(found)
    same = check(load_case(CASE).with_(plant={"source": fmu_of(ROBOT, tmp_path)}))
    assert same.ok
    assert "it agrees with the robot description" in lines(same)


def test_parameter_that_does_not_act_is_a_problem_and_the_exit_code_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    document = yaml.safe_load(Path(CASE).read_text(encoding="utf-8"))
    document |= {
        "robot": None,
        "plant": {"source": fmu_of(ROBOT, tmp_path)},
        "controller": {"source": str(Path("controllers/scara_pd.yaml").resolve())},
        "identify": {"ZZ2": {}, "idle": {"parameter": "q_start1"}},
        "estimator": {"kind": "clie"},
        "validation": None,
    }
    document["train"]["torque"]["file"] = str(Path("examples/scara/train_10hz.csv").resolve())
    path = tmp_path / "case.yaml"
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    assert main(["check", str(path)]) == 1
    printed = " ".join(capsys.readouterr().out.split())
    assert "PROBLEM parameter-idle: plant: Some parameters have no effect in the plant: idle (q_start1" in printed


def test_loop_that_cannot_be_simulated_is_a_problem() -> None:
    case = load_case(CASE)
    log = case.model.experiments["estimation"]
    nothing = trajectory(log.time, {"tau1": 1e-6 * np.sin(log.time), "tau2": 1e-6 * np.cos(log.time)})
    unstable = case.with_(controller={"parameters": {"Kd1": -400.0}}).with_signals({"train_10hz.csv": nothing})
    found = check(unstable)
    assert found.error_percent == {}
    assert "PROBLEM no-start: The torque cannot be simulated at any start:" in lines(found)
    assert "from the values of the description: " in lines(found)
