"""Cases that name the instants of the controller: read, refused, told, identified."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from fmu_didim import Log, identify, simulate
from fmu_didim.base.errors import FmuDidimError, InputError
from fmu_didim.case import Case, load_case
from fmu_didim.checks.data.checks import data_diagnostics
from fmu_didim.data.signals import trajectory, write_csv
from fmu_didim.fit.derivatives.sensitivity import sensitivity
from fmu_didim.workflow.validate import mistakes
from tests.cases import SCARA, TRUTH, scara_case

STEP, LONG_S, NOISE = 0.005, 10.0, 0.005


@cache
def slowing() -> np.ndarray:
    """Instants of a loop at 200 Hz that runs 30 % late after half of the time, a little unevenly."""
    rng = np.random.default_rng(4)
    periods = STEP * (1 + 0.3 / (1 + np.exp(-np.arange(2000) / 60 + 15)) + 0.02 * rng.random(2000))
    time = np.concatenate([[0.0], np.cumsum(periods)])
    return time[time < LONG_S]


def content() -> dict[str, Any]:
    """The SCARA example, fitted alone, at 50 Hz."""
    found: dict[str, Any] = yaml.safe_load(SCARA.read_text(encoding="utf-8"))
    del found["validation"]
    return found


def case(instants: Any = None, log: Log | None = None, **changes: Any) -> Case:
    """The example with a log in memory, and instants of the controller."""
    found = content() | changes
    run = {"reference": found["train"]["reference"]}
    if instants is not None:
        run["instants"] = instants
    if log is not None:
        run["torque"] = {"file": log, "rate_hz": 50}
    return load_case({**found, "train": run}, folder=SCARA.parent, require_torque=log is not None)


@cache
def logged() -> Log:
    """What that loop logs at each of its instants, with noise."""
    table = simulate(case(slowing()))
    torque = table.select(["tau1", "tau2"])
    noise = NOISE * torque.std(axis=0) * np.random.default_rng(1).normal(size=torque.shape)
    np.testing.assert_array_equal(table.time, slowing())
    return Log(table.time, torque + noise)


@pytest.mark.gate
def test_with_the_instants_the_truth_is_found_and_without_it_is_missed() -> None:
    named, without = (identify(case(given, logged())) for given in (slowing(), None))
    deviation = np.array([named.parameters[name].std for name in named.values])
    off, missed = (np.abs(np.array([*r.values.values()]) - TRUTH) / deviation for r in (named, without))
    assert off.max() < 4 < missed.max(), (off, missed)
    assert named.verdict == "valid"
    assert named.document.fitted_error_percent.total < 110 * NOISE
    assert without.document.fitted_error_percent.total > 1.2 * named.document.fitted_error_percent.total
    assert without.reasons[0].code == "period-changes"


def test_with_the_instants_nothing_wrong_is_told() -> None:
    assert [d.code.name for d in data_diagnostics(case(slowing(), logged()).model)] == ["control-instants"]


def test_without_them_the_loop_is_told() -> None:
    model = case(None, logged()).model
    found = data_diagnostics(model)
    assert found[0].code.name == "period-changes", found
    assert "from 5" in str(found[0]) and "6.5" in str(found[0])
    assert "instants: " in found[0].advice
    assert not {"clock-late", "clock-early", "stamps-jitter", "command-delay"} & {d.code.name for d in found}


@pytest.mark.gate
@pytest.mark.parametrize("kind", ["model", pytest.param("control", marks=pytest.mark.slow)])
def test_other_components_give_the_same(kind: str) -> None:
    table = simulate(case(slowing(), plant={"kind": kind}, controller={**content()["controller"], "kind": kind}))
    assert np.abs(table.select(["tau1", "tau2"]) - simulate(case(slowing())).select(["tau1", "tau2"])).max() < 1e-9


@pytest.mark.parametrize("delay", [0, 0.5, 1])
def test_sensitivities_are_those_of_differences(delay: float) -> None:
    model = case(slowing()[:600], Log(slowing()[:600], np.ones((600, 2))), loop={"delay_samples": delay}).model
    values = model.start
    found = sensitivity(model, values, model.torque(values))
    for i in range(values.size):
        step = 1e-4 * max(abs(values[i]), 0.01)
        pair = [model.torque(values + sign * step * (np.arange(values.size) == i)) for sign in (1, -1)]
        wanted = (pair[0] - pair[1]) / (2 * step)
        np.testing.assert_allclose(found[:, :, i], wanted, rtol=0, atol=2e-4 * np.abs(wanted).max() + 1e-7)


def test_what_is_measured_beside_the_torque_follows_the_instants(tmp_path: Path) -> None:
    times = np.arange(0.0, 9.0, 0.037)
    write_csv(trajectory(times, {"q1": 0 * times}), tmp_path / "encoder.csv")
    run = {"reference": content()["train"]["reference"], "instants": slowing(), "torque": {"file": logged()}}
    measured = {"file": str(tmp_path / "encoder.csv")}
    model = load_case({**content(), "train": {**run, "measured": measured}}, folder=SCARA.parent).model
    got = model.simulation(model.start, "estimation").channels()["q1"]
    moved = simulate(case(slowing()))
    np.testing.assert_allclose(got, np.interp(times, slowing(), moved.column("q1")), rtol=0, atol=1e-9)


# ---- the reference at the instants -------------------------------------------------------------------


def test_a_formula_is_evaluated_at_the_instants() -> None:
    given = case(slowing()).reference("estimation")
    whole = case().reference("estimation")
    np.testing.assert_array_equal(given.time, slowing())
    for name in ("q1", "dq2"):
        np.testing.assert_allclose(given.column(name), np.interp(slowing(), whole.time, whole.column(name)), atol=1e-4)


def test_a_file_is_evaluated_there_or_has_its_rows_there(tmp_path: Path) -> None:
    whole = case().reference("estimation")
    write_csv(whole, tmp_path / "even.csv", digits=17)
    write_csv(case(slowing()).reference("estimation"), tmp_path / "own.csv", digits=17)
    exact = case(slowing()).reference("estimation")
    for name, near in (("even.csv", 1e-7), ("own.csv", 0.0)):
        run = {"reference": {"file": str(tmp_path / name)}, "instants": slowing()}
        found = load_case({**content(), "train": run}, folder=SCARA.parent, require_torque=False).reference(
            "estimation"
        )
        np.testing.assert_allclose(found.select(["q1", "q2"]), exact.select(["q1", "q2"]), rtol=0, atol=near)


def test_the_loop_begins_with_the_reference_at_the_nominal_period() -> None:
    late = slowing()[400:]
    time = case(late).reference("estimation").time
    before = time[: time.size - late.size]
    np.testing.assert_array_equal(time[before.size :], late)
    np.testing.assert_allclose(before, late[0] - STEP * np.arange(before.size, 0, -1), rtol=0, atol=1e-12)
    assert 0 <= before[0] < STEP


def test_arrays_logs_and_files_name_the_same_instants(tmp_path: Path) -> None:
    (tmp_path / "loop.csv").write_text("t [ms]\n" + "\n".join(f"{1000 * (t - 0.5):.17g}" for t in slowing()), "utf-8")
    named = {"file": str(tmp_path / "loop.csv"), "offset_s": 0.5}
    for given in (slowing(), Log(slowing(), np.zeros((slowing().size, 2))), named):
        np.testing.assert_allclose(case(given).reference("estimation").time, slowing(), rtol=0, atol=1e-12)


# ---- what is refused and told ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("instants", "message"),
    [
        (slowing()[::6], "instants-rate|usually 30"),
        (1000 * slowing(), "milliseconds"),
        (slowing()[::-1], "increase"),
        (slowing()[:5], "instants of a controller"),
        (slowing() + 100, "hardly at all"),
        (np.stack([slowing(), slowing()]), "one dimension"),
    ],
    ids=["of a slower log", "in ms", "backwards", "five", "of another clock", "a matrix"],
)
def test_wrong_instants_are_refused(instants: np.ndarray, message: str) -> None:
    with pytest.raises(FmuDidimError, match=message) as caught:
        case(instants).reference("estimation")
    assert caught.value.where or "Time does not" in str(caught.value)


def test_missing_instants_are_told() -> None:
    lacking = np.delete(slowing(), [300, 700, 701])
    model = case(lacking, logged()).model
    told = {d.code.name: str(d) for d in data_diagnostics(model)}
    assert "2 instants" in told["instants-missing"]


def test_instants_and_resampling_exclude_each_other(tmp_path: Path) -> None:
    run = {"reference": {"file": "reference.csv", "resample": True}, "instants": "log.csv"}
    with pytest.raises(InputError, match="leave out resample"):
        load_case({**content(), "train": run}, folder=SCARA.parent)


def test_a_lag_of_the_drive_needs_one_period() -> None:
    robot = yaml.safe_load((SCARA.parent / content()["robot"]).read_text(encoding="utf-8"))
    joint = robot["joints"][0]
    joint["effects"] = [*joint.get("effects", ["viscous", "coulomb"]), "actuator_lag"]
    joint["parameters"]["T"] = 0.002
    with pytest.raises(InputError, match="constant control period") as caught:
        simulate(case(slowing(), robot=robot))
    assert "actuator_lag1" in str(caught.value)
    assert simulate(case(robot=robot)).time.size > 1000


def test_validate_reads_the_file_of_the_instants(tmp_path: Path) -> None:
    path = scara_case(tmp_path, train={"instants": "absent.csv"})
    assert any("absent.csv" in str(mistake) for mistake in mistakes(path))
