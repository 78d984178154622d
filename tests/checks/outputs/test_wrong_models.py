"""What is wrong with a model or its data is doubted, and the right suspect is named first; a right model is valid."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from fmu_didim import identify
from fmu_didim.workflow.output.result import Result
from tests.room import forbidden, room_case, room_fmu, write_room


class Wrong(NamedTuple):
    """How the data are made, what else the case says, and how the text about the first suspect begins."""

    data: dict[str, Any]
    case: dict[str, Any]
    suspect: str


KNOWN = {"model": {"source": "", "parameters": {"R1": 0.1, "R2": 0.25}}, "identify": {"T0": {}}}
WRONG = {
    "C of another house": Wrong({"C": 2400.0}, KNOWN, r"C = 2\.[34]\d?e\+03 ± \de\+01 J/K in the place of 2000"),
    "an input that acts three rows later": Wrong({"delay": 3}, {}, r"Ti1 acting 1[789]\d ± \d s later than recorded"),
    "an offset of the sensor": Wrong({"offset": 1.0}, {}, r"T that shows (0\.9|1\.0)\d* ± 0\.\d+ degC more than it is"),
    "another initial state": Wrong({"T0": 21.0}, {}, r"T0 = 2[01]\.?\d* ± 0\.\d+ degC in the place of 20"),
    "a third neighbour": Wrong({"third": (0.5, 15.0)}, {}, "an influence that was not recorded"),
    "a drift of the sensor": Wrong({"drift": 2.0}, {}, r"T that drifts by (1\.9|2)\d* ± 0\.\d+ degC over"),
}  # fmt: skip


def identified(folder: Path, data: dict[str, Any], case: dict[str, Any] | None = None) -> Result:
    write_room(folder, **data)
    changes = dict(case or {})
    if "model" in changes:
        changes["model"] = {**changes["model"], "source": str(room_fmu())}
    return identify(room_case(folder, **changes))


@pytest.mark.parametrize("name", WRONG)
def test_the_right_suspect_is_named_first(tmp_path: Path, name: str) -> None:
    wrong = WRONG[name]
    found = identified(tmp_path, wrong.data, wrong.case)
    assert found.verdict == "doubtful"
    assert found.reasons[0].code == "residual-follows", found.reasons
    text = found.reasons[0].text
    assert re.search(rf"as would leave {wrong.suspect}", text), text
    of_robots = forbidden(" ".join([*(f"{r.text} {r.next_step}" for r in found.reasons), *found.document.remarks]))
    assert not of_robots


@pytest.mark.parametrize("seed", range(3))
def test_a_right_model_is_valid(tmp_path: Path, seed: int) -> None:
    found = identified(tmp_path, {"seed": 100 + seed})
    assert found.verdict == "valid", found.reasons
    for name, true in (("R1", 0.1), ("R2", 0.25)):
        assert abs(found.parameters[name].value - true) < 4 * found.parameters[name].std


@pytest.mark.parametrize("sun", [20.0, 30.0])
@pytest.mark.parametrize("seed", range(3))
def test_a_sun_that_is_not_recorded_is_doubted(tmp_path: Path, sun: float, seed: int) -> None:
    """It leaves a residual of five to eight times the noise, which follows no input and passed for coloured noise."""
    assert identified(tmp_path, {"sun": sun, "seed": 100 + seed}).verdict == "doubtful"


def test_noise_with_a_memory_is_none(tmp_path: Path) -> None:
    """Some per cent of what the room moves."""
    for seed in range(3):
        found = identified(tmp_path, {"memory": 0.9, "seed": 100 + seed})
        assert found.verdict == "valid", found.reasons


@pytest.mark.gate
def test_hardly_any_right_model_is_doubted(tmp_path: Path) -> None:
    verdicts = [identified(tmp_path, {"seed": 1000 + seed}).verdict for seed in range(20)]
    assert verdicts.count("valid") >= 19, verdicts


def test_what_is_taken_on_trust_is_said(tmp_path: Path) -> None:
    """R1, R2 and C together only set how fast the room follows and where it goes: R1 C alone shows."""
    found = identified(tmp_path, {})
    told = [remark for remark in found.document.remarks if "taken on trust" in remark]
    assert [text.partition(":")[0] for text in told] == ["C", "T0"]
    assert told[0].startswith("C: 2000 J/K is taken on trust: an error of 10 % would not show"), told
    assert re.search(r"R1 by \d+(\.\d)? sigma \(-10 %\), R2 by \d+(\.\d)? sigma \(-10 %\)", told[0]), told
    assert found.verdict == "valid"
    assert re.search(r"Provided that the data do not hide an error of 10 % of C \(2000 J/K\), which", found.summary())


def test_a_single_outlier_is_told(tmp_path: Path) -> None:
    found = identified(tmp_path, {"outlier": 3.0})
    told = [*found.document.remarks, *(reason.text for reason in found.reasons)]
    assert any("1 of 500 samples lies up to" in text for text in told), told


def test_noise_beyond_what_is_stated_is_doubted(tmp_path: Path) -> None:
    columns = {"T": {"name": "T", "std": 0.05}}
    found = identified(tmp_path, {}, {"measured": {"file": "room.csv", "columns": columns}})
    assert [reason.code for reason in found.reasons] == ["residual-above-noise"]
    assert found.reasons[0].place == "T"


def test_noise_as_stated_is_valid(tmp_path: Path) -> None:
    columns = {"T": {"name": "T", "std": 0.1}}
    assert identified(tmp_path, {}, {"measured": {"file": "room.csv", "columns": columns}}).verdict == "valid"


def held_out(folder: Path, **data: Any) -> Result:
    """A fit of one experiment, with another one held out."""
    write_room(folder)
    write_room(folder, seed=2, name="other_", **data)
    runs = {
        name: {
            "inputs": {"file": f"{prefix}weather.csv", "interpolation": "held"},
            "measured": f"{prefix}room.csv", "role": role,
        }
        for name, prefix, role in (("june", "", "estimation"), ("july", "other_", "validation"))
    }  # fmt: skip
    return identify(room_case(folder, inputs=None, measured=None, experiments=runs))


def test_a_held_out_experiment_agrees(tmp_path: Path) -> None:
    assert held_out(tmp_path).verdict == "valid"


def test_a_held_out_experiment_of_another_house_is_doubted(tmp_path: Path) -> None:
    found = held_out(tmp_path, R1=0.12)
    assert [(reason.code, reason.place) for reason in found.reasons] == [("worse-on-held-out", "july: T")]
    assert "discover" not in found.reasons[0].next_step


def test_a_value_at_its_limit_is_an_answer_that_is_doubted(tmp_path: Path) -> None:
    found = identified(tmp_path, {}, {"identify": {"R1": {"minimum": 0.11, "start": 0.15}, "R2": {"minimum": 0}}})
    assert "at-limit" in [reason.code for reason in found.reasons]
    assert found.parameters["R1"].value == 0.11


@pytest.mark.parametrize("rows", [1, 5])
def test_the_interpolation_of_the_inputs_is_a_suspect(tmp_path: Path, rows: int) -> None:
    """The room holds its inputs for so many rows of the file, of which only those are given."""
    write_room(tmp_path, noise=0.01, hold=rows)
    weather = np.loadtxt(tmp_path / "weather.csv", delimiter=",", skiprows=1)
    kept = np.vstack([weather[::rows], weather[-1:]])[: None if rows > 1 else -1]
    np.savetxt(tmp_path / "weather.csv", kept, delimiter=",", header="t,Ti1,Ti2", comments="")
    inputs = {"file": "weather.csv", "interpolation": "linear"}
    found = identify(room_case(tmp_path, inputs=inputs))
    assert found.verdict == "doubtful"
    assert re.search(r"as would leave inputs that were held from row to row \(to (99|10\d)", found.reasons[0].text)
    assert "interpolation: held" in found.reasons[0].next_step
    assert identify(room_case(tmp_path, inputs={**inputs, "interpolation": "held"})).verdict == "valid"
