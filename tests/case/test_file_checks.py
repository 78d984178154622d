"""Files that cannot be used are refused when the case is loaded, with code, figure, bound and next step."""

from __future__ import annotations

from typing import Any

import pytest

from fmu_didim.base.diagnostics import DiagnosedError
from fmu_didim.case import load_case
from fmu_didim.data.signals import Trajectory, trajectory
from fmu_didim.workflow.data import case_diagnostics
from tests.cases import SCARA
from tests.helpers import reference

TRAIN = {"reference": None, "torque": {"file": "train_10hz.csv"}}


def log(scale: float = 1.0) -> Trajectory:
    case = load_case(SCARA).with_(validation=None)
    own = case.model.experiments["estimation"]
    inside = own.time < 8.0
    return trajectory(own.time[inside] * scale, {f"tau{j + 1}": own.torque[inside, j] for j in (0, 1)})


def loaded(motion: Trajectory, torque: Trajectory, **changes: Any) -> Any:
    content = load_case(SCARA).content
    content |= {"validation": None, "train": {"reference": {"file": "motion.csv"}, "torque": {"file": "log.csv"}}}
    content["train"]["torque"] |= changes
    return load_case(content, folder=SCARA.parent, signals={"motion.csv": motion, "log.csv": torque})


def scaled(motion: Trajectory, scale: float) -> Trajectory:
    return trajectory(motion.time * scale, {name: motion.column(name) for name in motion.names})


def test_right_files_are_loaded() -> None:
    assert loaded(reference(8.0), log()).model.experiments["estimation"].time.size == 80


@pytest.mark.parametrize(
    ("motion", "torque", "changes", "code", "value", "bound", "text"),
    [
        (
            reference(8.0, period=0.01),
            log(),
            {},
            "reference-rate",
            100.0,
            200.0,
            r"100 Hz\), and the loop runs at 200 Hz",
        ),
        (reference(8.0, period=0.001), log(), {}, "reference-rate", 1000.0, 200.0, "1000 Hz"),
        (
            scaled(reference(8.0), 1e3),
            log(),
            {},
            "time-unit",
            5.0,
            0.005,
            "of the reference seem to be in milliseconds",
        ),
        (reference(8.0), log(1e3), {}, "time-unit", 7900.0, 8.005, "of the log seem to be in milliseconds"),
        (reference(8.0), log(1e6), {}, "time-unit", 7.9e6, 8.005, "of the log seem to be in microseconds"),
        (
            reference(8.0),
            log(1e3),
            {"rate_hz": 10},
            "time-unit",
            7900.0,
            8.005,
            "of the log seem to be in milliseconds",
        ),
        (reference(8.0), log(), {"quantity": "command"}, "command-without-gain", None, None, "gains of the drives"),
    ],
)
def test_what_is_refused(
    motion: Trajectory, torque: Trajectory, changes: dict[str, Any], code: str, value: float, bound: float, text: str
) -> None:
    if "rate_hz" in changes:
        torque = scaled(torque, 1.0)
    with pytest.raises(DiagnosedError, match=text) as refused:
        loaded(motion, torque, **changes)
    (found,) = refused.value.found
    assert found.code.name == code
    assert f"code:  {code}" in str(refused.value) and f"next:  {found.code.next_step}" in str(refused.value)
    if value is not None:
        assert (found.value, found.bound) == (pytest.approx(value), pytest.approx(bound))


def test_a_validation_without_log_is_told() -> None:
    case = load_case(SCARA).with_(validation={"torque": None})
    (found,) = case_diagnostics(case)
    assert (found.code.name, found.place) == ("validation-without-torque", "validation")
