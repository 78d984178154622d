"""The unit of stamps of which a file says none, told by its velocities; and temperatures beside the log."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from fmu_didim.case import load_case
from fmu_didim.data.signals import Array
from fmu_didim.workflow.init import start_case
from fmu_didim.workflow.init.roles import guess
from fmu_didim.workflow.init.time_unit import unit_by_motion
from tests.cases import SCARA
from tests.conftest import ROOT

ROBOT, CONTROLLER = ROOT / "fmus/scara/robot.yaml", ROOT / "controllers/scara_pd.yaml"
TIME = np.arange(400) * 0.005
Q1, DQ1 = np.sin(3 * TIME) + 0.2 * TIME, 3 * np.cos(3 * TIME) + 0.2
NOISE = np.random.default_rng(5).normal(size=(2, TIME.size))


@pytest.mark.parametrize(
    ("stamps", "columns", "unit"),
    [
        (1e3 * TIME, {"q1": Q1, "dq1": DQ1}, "ms"),
        (1e6 * TIME + 7e8, {"q1": Q1, "dq1": DQ1}, "us"),
        (1e9 * TIME, {"q1": Q1, "dq1": DQ1}, "ns"),
        (TIME, {"q1": Q1, "dq1": DQ1}, ""),  # s
        (1e3 * TIME, {"q1": Q1, "tau1": DQ1}, ""),  # nothing says it
        (TIME, {"q1": Q1, "dq1": 1e3 * DQ1}, ""),  # mrad/s, as nobody logs at 200 kHz
        (1e3 * TIME, {"q1": Q1, "dq1": -DQ1}, ""),
        (1e3 * TIME, {"q1": Q1, "dq2": DQ1}, ""),
        # One that stands still says nothing, one that contradicts says that neither is known.
        (1e3 * TIME, {"q1": Q1, "dq1": DQ1, "q2": 1e-5 * NOISE[0], "dq2": 1e-4 * NOISE[1]}, "ms"),
        (1e3 * TIME, {"q1": Q1, "dq1": DQ1, "q2": Q1, "dq2": 1e-3 * DQ1}, ""),
        # Positions in degrees, velocities in rad/s, and nothing says so: no unit of time fits.
        (1e3 * TIME, {"q1": np.degrees(Q1), "dq1": DQ1}, ""),
        (1e3 * TIME, {"q1": Q1 + 1e-3 * NOISE[0], "dq1": DQ1 + 0.1 * NOISE[1]}, "ms"),
        (1e3 * TIME, {"q1": np.where(TIME > 1, np.nan, Q1), "dq1": DQ1}, ""),
        (1e3 * TIME, {"q1": Q1 * 1e300, "dq1": DQ1}, ""),
    ],
)
def test_unit_of_stamps(stamps: Array, columns: dict[str, Array], unit: str) -> None:
    assert unit_by_motion(stamps, columns, [guess(name, "") for name in columns]) == unit


def log(path: Path, *, ms: bool, temperatures: dict[str, float]) -> Path:
    """The training run of the SCARA with its reference in one file, at 200 Hz."""
    run = load_case(SCARA).model.experiments["estimation"]
    motion = run.reference
    names = ("q1", "q2", "dq1", "dq2")
    torque = [np.interp(motion.time, run.time, run.torque[:, j]) for j in range(2)]
    columns = {
        "Time": np.rint(1e3 * motion.time) if ms else motion.time,
        **{f"{name}_ref": motion.column(name) for name in names},
        "tau1": torque[0], "tau2": torque[1],
        **{name: np.full(motion.time.size, value) for name, value in temperatures.items()},
    }  # fmt: skip
    rows = zip(*columns.values(), strict=True)
    text = "\n".join([",".join(columns), *(",".join(f"{value:.9g}" for value in row) for row in rows)])
    path.write_text(f"{text}\n", encoding="utf-8")
    return path


def test_a_log_in_ms_with_temperatures_runs_as_it_is(tmp_path: Path) -> None:
    given = log(tmp_path / "log.csv", ms=True, temperatures={"Temp1": 41.0, "Temp2": 38.0})
    started = start_case([given, ROBOT, CONTROLLER], tmp_path / "case")
    assert not any(started.to_fill_in.values())
    assert ("log.csv", "Time", "time in ms, by its velocities, 200 Hz") in started.found
    assert ("log.csv", "Temp2", "temperature of joint 2") in started.found
    case = load_case(tmp_path / "case/case.yaml")
    run = case.model.experiments["estimation"]
    assert run.reference.step == pytest.approx(0.005)
    assert run.measured_starts["temperature_start1"] == pytest.approx(41 + 273.15)


@pytest.mark.parametrize(
    ("temperatures", "columns"),
    [
        ({"Temp1": 41.0, "Temp2": 38.0}, {"temperature1": "Temp1", "temperature2": "Temp2"}),
        ({"oil_temperature": 41.0}, {"temperature": "oil_temperature"}),
        ({"Temp1": 41.0}, None),  # of one of two joints
        ({"motor_temp1": 41.0, "gear_temp1": 38.0, "motor_temp2": 41.0, "gear_temp2": 38.0}, None),  # which one?
        ({}, None),
    ],
)
def test_temperatures_of_a_log(tmp_path: Path, temperatures: dict[str, float], columns: dict[str, str] | None) -> None:
    given = log(tmp_path / "log.csv", ms=False, temperatures=temperatures)
    start_case([given, ROBOT, CONTROLLER], tmp_path / "case")
    content = yaml.safe_load((tmp_path / "case/case.yaml").read_text(encoding="utf-8"))["train"]
    assert content.get("temperature", {}).get("columns") == columns


def test_all_runs_state_temperatures_or_none(tmp_path: Path) -> None:
    logs = [
        log(tmp_path / "one.csv", ms=False, temperatures={"Temp1": 41.0, "Temp2": 38.0}),
        log(tmp_path / "two.csv", ms=False, temperatures={}),
    ]
    start_case([*logs, ROBOT, CONTROLLER], tmp_path / "case")
    assert "temperature:" not in (tmp_path / "case/case.yaml").read_text(encoding="utf-8")


def test_a_file_of_temperatures_alone_is_no_run(tmp_path: Path) -> None:
    given = log(tmp_path / "log.csv", ms=False, temperatures={})
    gears = tmp_path / "gears.csv"
    gears.write_text("t,T1 [degC],T2 [degC]\n0,41,38\n60,43,39\n", encoding="utf-8")
    start_case([given, gears, ROBOT, CONTROLLER], tmp_path / "case")
    content = yaml.safe_load((tmp_path / "case/case.yaml").read_text(encoding="utf-8"))
    assert set(content) >= {"train"} and "experiments" not in content and "validation" not in content
    assert content["train"]["temperature"]["file"] == "../gears.csv"
    assert load_case(tmp_path / "case/case.yaml").model.experiments["estimation"].measured_starts
