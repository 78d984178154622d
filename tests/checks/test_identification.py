"""What speaks against identified values: limits, experiments that differ, coarse steps, held-out data."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fmu_didim import identify
from fmu_didim.case import load_case
from fmu_didim.checks.identification import checked, limit_diagnostics
from fmu_didim.dynamics.robot import read_robot, write_robot
from fmu_didim.fit.solver.numerical_noise import Roughness
from fmu_didim.model.free_parameter import LONGEST_DELAY, delay_parameter
from fmu_didim.workflow.output.result import Result
from tests.identification.test_several_experiments import case, run


@pytest.fixture(scope="module")
def outcome() -> Result:
    return identify(load_case("examples/scara/identify.yaml"))


def again(outcome: Result, **changes: object) -> list[str]:
    estimate = replace(outcome.estimate, **changes)
    found = checked(estimate, outcome.validations).judgement
    return [d.code.name for d in found.reasons]


def test_a_right_model_is_valid(outcome: Result) -> None:
    assert (outcome.verdict, outcome.reasons, outcome.exit_code) == ("valid", [], 0)
    assert again(outcome) == []


def test_coarse_steps_are_told(outcome: Result) -> None:
    assert again(outcome, integration_shift=np.array([0.01, 0.5])) == ["integration-too-coarse"]
    assert again(outcome, integration_shift=np.full(2, np.nan)) == []


@pytest.mark.parametrize(
    ("change", "jitter", "told"),
    [(0.09, 0.09, 0), (0.11, 0.09, 1), (np.nan, 0.0, 1), (0.0, 0.11, 1), (0.5, 1.0, 2)],
)
def test_rough_sensitivities_are_told(outcome: Result, change: float, jitter: float, told: int) -> None:
    assert again(outcome, roughness=Roughness(change, "ZZ1", jitter)) == told * ["sensitivity-rough"]


def test_another_inertia_that_the_log_does_not_exclude_is_told(outcome: Result) -> None:
    found = checked(replace(outcome.estimate, rivals=(("Ia6", 0.0068),)), outcome.validations).judgement
    assert (found.verdict, [d.code.name for d in found.reasons]) == ("doubtful", ["another-minimum"])
    assert (found.reasons[0].place, found.reasons[0].value) == ("Ia6", 0.0068)


@pytest.mark.gate
def test_what_is_neither_identified_nor_known_is_told(outcome: Result, tmp_path: Path) -> None:
    """Friction of joint 2 left out of the list: the values of the others depend on what the description has."""
    assert not any("Not identified" in remark for remark in outcome.document.remarks)
    robot = read_robot("fmus/scara/robot.yaml")
    assert not isinstance(robot.identified, str)
    fewer = {name: own for name, own in robot.identified.items() if name != "Fv2"}
    write_robot(robot.model_copy(update={"identified": fewer}), tmp_path / "robot.yaml")
    case_of_fewer = load_case("examples/scara/identify.yaml").with_(
        robot=str(tmp_path / "robot.yaml"), plant={"kind": "model"}, estimator={"kind": "didim", "start": "reference"}
    )
    found = identify(case_of_fewer).document.remarks
    assert any("Not identified, but taken as the description has them: Fv2 = 0.013" in remark for remark in found)


@pytest.mark.parametrize(("value", "told"), [(1.0, 0), (0.0, 0), (LONGEST_DELAY, 1)])
def test_limits(outcome: Result, value: float, told: int) -> None:
    """A delay of zero is a value as any other; its highest one is a limit."""
    model = outcome.model.with_free([replace(delay_parameter(1.0), value=value)])
    found = limit_diagnostics(replace(outcome.estimate, model=model, covariance=np.array([[0.01]])))
    assert len(found) == told
    assert all(d.place == "delay" and d.bound == LONGEST_DELAY for d in found)


@pytest.mark.gate
def test_held_out_experiment_with_another_payload(tmp_path: Path) -> None:
    """Without a word the values would be called right, though they do not hold for the other experiment."""
    experiments = {
        "empty": run(tmp_path, "empty", "train", seed=1),
        "loaded": {**run(tmp_path, "loaded", "validation", payload=True, seed=2), "role": "validation"},
    }
    found = identify(case(tmp_path, experiments))
    assert (found.verdict, found.exit_code) == ("doubtful", 4)
    assert [(r.code, r.place) for r in found.reasons] == [("worse-on-held-out", "loaded: joint 2")]
    assert all(r.value is not None and r.value > 1.25 for r in found.reasons)
    assert "fmu-didim discover" in found.reasons[0].next_step
    assert "DOUBTFUL" in found.summary()


def test_without_held_out_data_it_is_said(tmp_path: Path) -> None:
    found = identify(case(tmp_path, {"empty": run(tmp_path, "empty", "train", seed=1)}))
    assert found.verdict == "valid"
    assert any("held out" in remark for remark in found.document.remarks)
