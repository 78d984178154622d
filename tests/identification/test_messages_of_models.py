"""Faults that users met: a reference that stands still, advice in a circle, and words that mean nothing for a model."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from fmu_didim import identify
from fmu_didim.base.errors import FmuDidimError
from fmu_didim.case import load_case
from fmu_didim.data.signals import trajectory, write_csv
from fmu_didim.fit.estimate import RefusedError
from tests.awkward.build import EVENTS, library, pack
from tests.case.calibration.models import case_of, noisy, steps_of_lag
from tests.cases import ENTRIES, plant_case
from tests.checks.data.right import with_log

TIME = np.linspace(0, 20, 101)


@pytest.mark.gate
def test_a_reference_that_stands_still_is_fitted_to_its_end(tmp_path: Path) -> None:
    """It ended, after a complete fit, in an IndexError: such a reference has no frequency."""
    time = np.arange(0, 3.0, 0.005)
    still = {"q1": 0.4 + 0 * time, "q2": -0.3 + 0 * time, "dq1": 0 * time, "dq2": 0 * time}
    write_csv(trajectory(time, still), tmp_path / "still.csv")
    write_csv(trajectory(time[::4], {"tau1": 0 * time[::4], "tau2": 0 * time[::4]}), tmp_path / "log.csv")
    entries = {name: ENTRIES[name] for name in ("Fv1", "ZZ2", "Fv2")}
    train = {
        "reference": {"file": str(tmp_path / "still.csv")}, "torque": {"file": str(tmp_path / "log.csv")},
        "initial_state": {"q1": 0.0, "q2": 0.0, "dq1": 0.0, "dq2": 0.0},
    }  # fmt: skip
    path = plant_case(tmp_path, entries)
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    del content["validation"]
    path.write_text(yaml.safe_dump({**content, "train": train}), encoding="utf-8")
    case = load_case(path)
    rng = np.random.default_rng(0)
    truth = np.array([0.03, 0.063, 0.013])
    model = with_log(case.model, lambda torque: case.model.torque(truth) + 0.02 * rng.normal(size=torque.shape))
    found = case.estimator.estimate(model)
    assert (np.abs(found.value - truth) < 4 * found.standard_deviation).all()


def test_advice_about_where_a_state_starts_does_not_go_in_a_circle(tmp_path: Path) -> None:
    """``identify: {x: {}}`` is told to be called ``x.start``, which then is taken, and is an answer."""
    pack(tmp_path / "events.fmu", EVENTS, library("events"))
    log = trajectory(TIME, {"y": np.sin(TIME)})
    entries = {"schema": 1, "name": "e", "model": "events.fmu", "measured": "log"}
    with pytest.raises(FmuDidimError) as told:
        load_case({**entries, "identify": {"x": {}}}, folder=tmp_path, signals={"log": log})
    (advised,) = set(re.findall(r"x\.start", str(told.value)))
    case = load_case({**entries, "identify": {advised: {}}}, folder=tmp_path, signals={"log": log})
    assert case.model.names == (advised,)


def test_a_model_that_diverges_is_not_told_to_lower_gains() -> None:
    """X = X0 exp(mu t) overflows."""
    case = case_of(
        "growth", {"log": noisy(TIME, {"X": 0.1 * np.exp(0.1 * TIME)}, 0.01, 0)}, measured="log",
        identify={"mu": {"start": 1e4}, "X0": {}},
    )  # fmt: skip
    with pytest.raises(RefusedError) as error:
        case.estimator.estimate(case.model)
    assert not re.search(r"\b(gains?|reference|closed loop|torque)\b", str(error.value)), str(error.value)


@pytest.mark.parametrize("common", [False, True])
def test_two_experiments_of_one_output_each_speak_of_outputs(common: bool) -> None:
    """ "There is no column named 'tau2'" was told where each experiment has an output of its own."""
    stepped = steps_of_lag(TIME, {0.0: 1.0}, constant=1.5, gain=2.0, start=0.0)
    signals = {"u": trajectory(np.array([0.0, 20.0]), {"u": np.ones(2)})}
    signals |= {name: noisy(TIME, {name: stepped, **({"y": stepped} if common else {})}, 0.01, 0) for name in "yz"}
    runs = {name: {"inputs": {"file": "u", "interpolation": "held"}, "measured": name} for name in "yz"}
    if common:
        found = identify(case_of("lag", signals, experiments=runs, identify={"T": {}, "k": {}}))
        assert abs(found.parameters["T"].value - 1.5) < 4 * found.parameters["T"].std
        return
    with pytest.raises(FmuDidimError) as error:
        case_of("lag", signals, experiments=runs, identify={"T": {}, "k": {}})
    assert "tau" not in str(error.value)
    assert re.search("No output was measured in all experiments", str(error.value))


def test_a_limit_that_a_coarse_solver_leads_to_is_called_a_limit() -> None:
    """With one step of a lag a sample, its time constant is too short by a tenth, and was "not physical" there."""
    time = np.linspace(0, 20, 21)
    stepped = steps_of_lag(time, {0.0: 1.0, 10.0: -1.0}, constant=0.4, gain=2.0, start=0.0)
    signals = {
        "u": trajectory(np.array([0.0, 10.0, 20.0]), {"u": np.array([1.0, -1.0, -1.0])}),
        "log": noisy(time, {"y": stepped}, 0.001, 0),
    }
    case = case_of(
        "lag", signals, inputs={"file": "u", "interpolation": "held"}, measured="log",
        identify={"T": {"start": 0.8, "minimum": 0.6}, "k": {}},
    )  # fmt: skip
    found = identify(case)
    codes = {reason.code for reason in found.reasons}
    assert "at-limit" in codes
    assert found.parameters["T"].value == 0.6
    text = " ".join([*(f"{r.text} {r.next_step}" for r in found.reasons), *found.document.remarks])
    assert "physical" not in text and "not-physical" not in codes
