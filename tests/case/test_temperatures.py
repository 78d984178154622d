"""Temperatures of the gears in a case: what the plant gets of them, and what is refused or told."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmu_didim import load_case, read_robot
from fmu_didim.base.errors import InputError
from fmu_didim.case.build import Case
from fmu_didim.checks.plant.temperature import temperature_diagnostics
from tests.cases import SCARA

EFFECT = "temperature_dependent_friction"


def case(folder: Path, temperature: Any, *, held_out: Any = "same", follows: bool = False) -> Case:
    content = load_case(SCARA).content
    for label, given in (("train", temperature), ("validation", temperature if held_out == "same" else held_out)):
        if given is not None:
            content[label]["temperature"] = given
    if follows:
        robot = read_robot(SCARA.parent / content["robot"])
        joints = [joint.model_copy(update={"effects": (*joint.effects, EFFECT)}) for joint in robot.joints]
        content["robot"] = robot.model_copy(update={"joints": tuple(joints), "identified": "computed"})
        content["plant"] = {"kind": "model"}
        content["estimator"] = {"kind": "didim"}
    return load_case(content, folder=SCARA.parent)


def starts(made: Case, label: str = "estimation") -> Mapping[str, float]:
    return made.model.experiments[label].measured_starts


def log(folder: Path, rows: Mapping[str, np.ndarray], name: str = "gears.csv") -> dict[str, Any]:
    table = np.column_stack(list(rows.values()))
    np.savetxt(folder / name, table, delimiter=",", header=",".join(rows), comments="", fmt="%.9g")
    return {"file": str(folder / name)}


@pytest.mark.parametrize(("given", "first", "second"), [(30.0, 303.15, 303.15), ([30.0, 41.5], 303.15, 314.65)])
def test_numbers_are_in_degc_and_hold_over_the_run(tmp_path: Path, given: Any, first: float, second: float) -> None:
    found = starts(case(tmp_path, given))
    assert found == {
        "temperature_start1": first, "warming_start1": 0.0, "temperature_start2": second, "warming_start2": 0.0,
    }  # fmt: skip


TIME = np.linspace(0.0, 10.0, 21)


@pytest.mark.parametrize("unit", ["", " [degC]", " [K]"])
def test_a_file_gives_a_line_along_the_run(tmp_path: Path, unit: str) -> None:
    """Sensors that count in tenths of a kelvin, in the unit that the header says."""
    shift = 273.15 if "K" in unit else 0.0
    source = log(tmp_path, {
        "t": TIME, f"temperature1{unit}": np.round(25 + 0.3 * TIME, 1) + shift, f"T2{unit}": 40 + 0 * TIME + shift,
    })  # fmt: skip
    found = starts(case(tmp_path, source | {"columns": {"temperature2": "T2"}}))
    assert found["temperature_start1"] == pytest.approx(298.15, abs=0.05)
    assert found["warming_start1"] == pytest.approx(0.3, abs=0.01)
    assert (found["temperature_start2"], found["warming_start2"]) == pytest.approx((313.15, 0.0), abs=1e-9)


def test_one_column_may_stand_for_all_joints_on_a_clock_of_its_own(tmp_path: Path) -> None:
    source = log(tmp_path, {"t": TIME - 100, "oil": 25 + 0.3 * TIME})
    found = starts(case(tmp_path, source | {"columns": {"temperature": "oil"}, "offset_s": 100}))
    for j in (1, 2):
        assert found[f"temperature_start{j}"] == pytest.approx(298.15)
        assert found[f"warming_start{j}"] == pytest.approx(0.3)


def test_a_few_samples_give_their_mean(tmp_path: Path) -> None:
    source = log(tmp_path, {"t": TIME[:2], "temperature": np.array([25.0, 26.0])})
    found = starts(case(tmp_path, source | {"columns": {"temperature": {"name": "temperature"}}}))
    assert (found["temperature_start1"], found["warming_start1"]) == pytest.approx((298.65, 0.0))


@pytest.mark.parametrize(
    ("given", "held_out", "follows", "words"),
    [
        ([30.0], "same", False, "not one temperature for each joint"),
        (400.0, "same", False, "must be 200 or less"),
        (30.0, None, False, "Some runs state temperatures and some do not"),
        (None, None, True, "Friction follows the temperature, which these runs do not state"),
        ({"file": "f", "motors": [[1, 0], [0, 1]]}, "same", False, "a temperature belongs to its joint"),
        ({"file": "f", "columns": {"tau1": "a"}}, "same", False, "write temperature1, temperature2"),
    ],
)
def test_what_is_no_temperature_is_refused(
    tmp_path: Path, given: Any, held_out: Any, follows: bool, words: str
) -> None:
    with pytest.raises(InputError, match=words) as error:
        case(tmp_path, given, held_out=held_out, follows=follows)
    assert "temperature" in str(error.value) and "next:" in str(error.value)


@pytest.mark.parametrize(
    ("time", "values", "words"),
    [(TIME, 300 + 0 * TIME, "no temperature of a drive in degC"), (TIME + 60, 30 + 0 * TIME, "no sample during")],
)
def test_a_wrong_file_of_temperatures_is_refused(
    tmp_path: Path, time: np.ndarray, values: np.ndarray, words: str
) -> None:
    """Kelvins without a unit, and a file on another clock."""
    with pytest.raises(InputError, match=words):
        case(tmp_path, log(tmp_path, {"t": time, "temperature": values}) | {"columns": {"temperature": "temperature"}})


@pytest.mark.parametrize(("bend", "told"), [(5.0, True), (0.5, False)])
def test_a_temperature_that_is_no_line_is_told(tmp_path: Path, bend: float, told: bool) -> None:
    """A step halfway leaves a line by up to half of it at its sides."""
    rows = {"t": TIME, "temperature": 30 + 2 * bend * (TIME > 5)}
    made = case(tmp_path, log(tmp_path, rows) | {"columns": {"temperature": "temperature"}})
    codes = [d.code.name for d in made.model.experiments["estimation"].told]
    assert ("temperature-bent" in codes) is told


@pytest.mark.parametrize(("given", "follows", "told"), [(30.0, False, True), (30.0, True, False), (None, False, False)])
def test_temperatures_that_nothing_follows_are_told(tmp_path: Path, given: Any, follows: bool, told: bool) -> None:
    codes = [d.code.name for d in temperature_diagnostics(case(tmp_path, given, follows=follows).model)]
    assert codes == (["temperature-unused"] if told else [])
