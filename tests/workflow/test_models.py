"""The verbs on a case of a model: what is wrong is told before any fit, and each of them does what makes sense or says
why not."""

from __future__ import annotations

import shutil
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml

from fmu_didim import Inputs, Measured, check, identify, load_case, simulate
from fmu_didim.base.errors import IdentificationError, InputError
from fmu_didim.cli.main import main
from fmu_didim.workflow.validate import mistakes
from tests.conftest import ROOT

HOUSE = ROOT / "examples/house"
TRUTH = {"R1": 0.02, "R2": 0.01}
POSITIVE = {"minimum": 0}


@pytest.fixture(scope="module")
def house(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the files of the example."""
    folder = tmp_path_factory.mktemp("house")
    for path in HOUSE.iterdir():
        if path.suffix in (".fmu", ".csv"):
            shutil.copy(path, folder)
    return folder


@pytest.fixture(scope="module")
def arrays() -> tuple[np.ndarray, np.ndarray]:
    """The rows of the inputs and of what was measured."""
    return tuple(np.loadtxt(HOUSE / f"{n}.csv", delimiter=",", skiprows=1) for n in ("weather", "room"))  # type: ignore[return-value]


def case(folder: Path, name: str = "case.yaml", **changes: Any) -> Path:
    """A case in the folder, with changes."""
    content = {
        "name": "house", "model": "house.fmu", "inputs": "weather.csv", "measured": "room.csv",
        "identify": {"R1": POSITIVE, "R2": POSITIVE},
    } | changes  # fmt: skip
    path = folder / name
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return path


def codes(folder: Path, **changes: Any) -> dict[str, str]:
    """Code of each diagnostic -> its next step."""
    return {d.code.name: d.advice for d in check(case(folder, **changes)).diagnostics}


def test_all_mistakes_at_once(house: Path) -> None:
    path = case(
        house, idntify={},
        inputs={"file": "weather.csv", "columns": {"T_aut": "T_out", "T_beside": "besides"}},
        measured={"file": "rom.csv", "columns": {"T": {"unit": "degC", "std": 0.1}}},
        validation={"inputs": "weather_2.csv", "measured": {"file": "room_2.csv", "columns": {"T": {"unit": "m"}}}},
        identify={"R1": None, "R": None, "C": {"start": -1, "minimum": 0}, "x": {"parameter": "r2"}},
    )  # fmt: skip
    text = "\n".join(m.text for m in mistakes(path))
    for told in (
        "Did you mean 'identify'?", "give minimum <= start <= maximum", "no parameter of the model named 'R'",
        "Did you mean 'T_out'?", "no column named 'besides'", "rom.csv", "The unit of T is not one of its kind",
        "no parameter of the model named 'r2'",
    ):  # fmt: skip
        assert told in text, text
    assert "The FMU does not exist" in mistakes(case(house, model="haus.fmu"))[0].text
    assert not mistakes(case(house))


def test_check_predicts_before_any_fit(house: Path) -> None:
    found = check(case(house))
    assert found.ok and found.diagnostics == () and found.prospect is not None
    integrated = check(case(house, model={"source": "house.fmu", "solver": "cvode"}))
    assert [d.code.name for d in integrated.diagnostics] == ["exchange-chosen"]
    assert "output error" in found.summary() and "torque" not in found.summary()
    assert (found.prospect.deviation < 1e-3).all()


def test_check_takes_outputs_at_instants_of_their_own(house: Path) -> None:
    """Both count, and tell more together than each alone."""
    rows = np.loadtxt(house / "room.csv", delimiter=",", skiprows=1)[5:800:3]
    np.savetxt(house / "x.csv", rows + np.array([30.0, 0.0]), delimiter=",", header="t,x", comments="")
    both = check(case(house, measured=["room.csv", {"file": "x.csv", "columns": {"x": {"std": 0.1}}}]))
    assert "865 samples, one in 600 s, 265 of x" in both.summary()
    alone = check(case(house))
    assert both.prospect is not None and alone.prospect is not None
    assert (both.prospect.deviation < alone.prospect.deviation).all()


def test_check_names_what_cannot_be_told_apart(house: Path) -> None:
    found = codes(house, identify={"R1": POSITIVE, "R2": POSITIVE, "C": POSITIVE})
    assert "Take one of them as known" in found["parameters-confounded"]


def test_check_names_another_unit_another_start_and_a_dead_sensor(house: Path) -> None:
    rows = np.loadtxt(house / "room.csv", delimiter=",", skiprows=1)
    for name, values in (("kelvin", rows[:, 1] + 273.15), ("warm", rows[:, 1] + 3), ("dead", np.full(len(rows), 20.0))):
        np.savetxt(house / f"{name}.csv", np.c_[rows[:, 0], values], delimiter=",", header="t,T", comments="")
    assert "unit" in codes(house, measured="kelvin.csv")["output-elsewhere"]
    assert "Perhaps it is one of T_start" in codes(house, measured="warm.csv")["model-starts-elsewhere"]
    assert "model-starts-elsewhere" not in codes(
        house, measured="warm.csv", identify={"R1": POSITIVE, "T_start": None}
    )  # fmt: skip
    assert "output-constant" in codes(house, measured="dead.csv")


def test_an_input_that_never_changes_is_told(house: Path) -> None:
    rows = np.loadtxt(house / "weather.csv", delimiter=",", skiprows=1)
    table = np.c_[rows[:, :2], np.full(len(rows), 20.0)]
    np.savetxt(house / "still.csv", table, delimiter=",", header="t,T_out,T_beside", comments="")
    assert "input-rests" in codes(house, inputs="still.csv")


def test_simulate_gives_outputs_with_any_values(house: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first, other = simulate(case(house)), simulate(case(house), parameters={"R1": 0.01})
    assert first.time.size == 865 and np.abs(first.values[:, 0] - other.values[:, 0]).max() > 0.5
    assert main(["simulate", str(case(house)), "--set", "R9=1"]) == 1
    assert "parameter that is identified named 'R9'" in capsys.readouterr().err


def test_export_says_what_to_do(house: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for command, told in (
        (["export", str(case(house))], "with --ssp export does"),
        (["export", str(house / "house.fmu")], "This is an FMU already"),
    ):
        assert main(command) == 1
        assert told in capsys.readouterr().err


def test_values_go_back_as_ssv(house: Path, tmp_path: Path) -> None:
    found = identify(case(house), tmp_path)
    assert {n: v.value for n, v in found.parameters.items()} == pytest.approx(TRUTH, rel=0.02)
    assert main(["export", str(case(house)), "--result", str(tmp_path), "--ssp", str(tmp_path / "house.ssp")]) == 0
    with zipfile.ZipFile(tmp_path / "house.ssp") as archive:
        assert f'value="{found.values["R1"]!r}"' in archive.read("resources/model.ssv").decode()
    assert {"house.fmu", "weather.csv", "room.csv"} <= set(found.document.provenance["files"])


def test_a_ridge_is_refused(house: Path) -> None:
    with pytest.raises(IdentificationError, match="cannot tell some parameters apart"):
        identify(case(house, identify={"R1": POSITIVE, "R2": POSITIVE, "C": POSITIVE}))


@pytest.mark.slow
def test_a_ridge_is_refused_from_wherever_the_search_starts(house: Path) -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        start = np.array([*TRUTH.values(), 4e6]) * np.exp(rng.uniform(-1.2, 1.2, 3))
        sought = {name: POSITIVE | {"start": float(s)} for name, s in zip(("R1", "R2", "C"), start, strict=True)}
        with pytest.raises(
            IdentificationError, match=r"cannot tell some parameters apart[\s\S]*R1 \+1 %, R2 \+1 %, C -1 %"
        ):
            identify(case(house, identify=sought))


@pytest.mark.parametrize("kind", ["didim", "clie", "idim_ls"])
def test_estimators_of_robots_are_none_of_models(house: Path, kind: str) -> None:
    with pytest.raises(InputError, match="takes output_error"):
        identify(case(house, estimator={"kind": kind}))


def test_arrays_in_the_place_of_all_files(arrays: tuple[np.ndarray, np.ndarray], house: Path) -> None:
    weather, room = arrays
    found = identify(
        model=house / "house.fmu",
        inputs=Inputs(weather[:, 0], T_out=weather[:, 1], T_beside=weather[:, 2]),
        measured=Measured(room[:, 0], T=room[:, 1]),
        parameters={"R1": POSITIVE, "R2": POSITIVE},
    )
    assert found.values == identify(case(house)).values


def test_a_model_that_explodes_beyond_its_limits_is_found_from_names_alone(house: Path) -> None:
    """Steps lead to resistances below zero; a parabola through the misfit there would leave nothing of them."""
    found = identify(load_case(case(house)).with_(identify={"R1": {"minimum": None}, "R2": {"minimum": None}}))
    assert found.verdict == "valid" and found.document.iterations <= 12
    assert found.values == pytest.approx(identify(case(house)).values, rel=1e-5)


def test_frames_units_gaps_and_noise(arrays: tuple[np.ndarray, np.ndarray], house: Path) -> None:
    weather, room = arrays
    frame = pd.DataFrame(weather, columns=["time", "T_out", "T_beside"])
    kelvin = pd.DataFrame({"T": np.where(np.arange(len(room)) % 3, room[:, 1] + 273.15, np.nan)}, index=room[:, 0])
    base = load_case(case(house))
    other = base.with_(inputs=frame, measured=Measured(kelvin, units="K", std=0.1))
    (label,) = other.model.experiments
    experiment = other.model.experiments[label]
    assert experiment.time.size == np.isfinite(kelvin["T"]).sum()
    assert experiment.torque[:, 0] == pytest.approx(room[np.arange(len(room)) % 3 > 0, 1])
    assert other.model.torque_deviation == pytest.approx([0.1])
    assert base.with_(model={"parameters": {"C": 3e6}}).plant.parameter_values()["C"] == 3e6


def test_a_held_out_pair_and_several_outputs(arrays: tuple[np.ndarray, np.ndarray], house: Path) -> None:
    weather, room = arrays
    inputs = Inputs(weather[:, 0], {"T_out": weather[:, 1], "T_beside": weather[:, 2]}, interpolation="held")
    changed = check(case(house), inputs=inputs, validation=(Measured(room[:, 0], T=room[:, 1]), inputs))
    assert {label: e.role for label, e in changed.experiments.items()} == {
        "estimation": "estimation", "validation": "validation",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("objects", "told"),
    [
        ({"model": "x.fmu", "parameters": ["R1"]}, "no measured"),
        ({"model": 3, "parameters": ["R1"], "measured": Measured([0, 1], T=[1, 2])}, "runs in the loop"),
        ({"model": "x.fmu", "parameters": ["R1"], "measured": 3}, "no measurements of a model"),
        ({"log": 3}, "no robot, controller, reference"),
    ],
)
def test_objects_that_are_no_case(objects: dict[str, Any], told: str) -> None:
    with pytest.raises(InputError, match=told):
        identify(**objects)


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda: Inputs([0, 1]), "No signal was given"),
        (lambda: Inputs([0, 1], u=[1, 2, 3]), "one number for each instant"),
        (lambda: Inputs([0, 1], u=[1, np.nan]), "no number in some rows"),
        (lambda: Inputs([1, 0], u=[1, 2]), "does not increase"),
        (lambda: Measured([0, 1], y=["a", "b"]), "no array of real numbers"),
        (lambda: Measured([0, 1], y=[1, 2], units={"z": "K"}), "no signal named 'z'"),
        (lambda: Measured(pd.to_datetime(["2020-01-01", "2020-01-02"]), y=[1, 2]), "dates, not seconds"),
    ],
)
def test_arrays_that_do_not_fit(make: Any, told: str) -> None:
    with pytest.raises(InputError, match=told):
        make()
