"""A component that fails by itself: its name, the time and the call are the headline, whoever suffers from it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from fmu_didim import check, identify, load_result, simulate
from fmu_didim.cli import main
from fmu_didim.errors import FmuDidimError
from fmu_didim.signals import trajectory, write_csv
from tests.awkward.build import awkward_fmu

RATE, LENGTH = 100.0, 2.0
FAULTS = {
    "ERROR_IN_STEP": r"failed: fmi2DoStep at t = 0\.03 s of the FMU returned Error\.[\s\S]*the solver gave up",
    "NAN_OUTPUT": r"failed at t = 0\.0[67] s: {component}\.\w+ = nan, while all its inputs are numbers",
    "CRASH_IN_STEP": r"failed at t = 0\.03 s: The FMU crashed its process \(SIGSEGV[\s\S]*during step",
    "EXIT_IN_STEP": r"failed at t = 0\.03 s: The FMU ended its process \(exit status 7\)[\s\S]*during step",
    "HANG_IN_STEP": r"failed at t = 0\.03 s: The FMU gave no answer within 1 s[\s\S]*during step",
}
"""Fault of ``slave.c`` -> headline, after the name of the component."""
LATER = r"failed: fmi2DoStep at t = [\d.]+ s of the FMU returned Error\.[\s\S]*the licence has run out"


def written(folder: Path, *, plant: dict[str, Any] | None = None, controller: dict[str, Any] | None = None) -> Path:
    """A case of one joint, both parts slaves of ``slave.c`` as FMUs, with torque of faultless ones."""
    sound = str(awkward_fmu(folder))
    case = {
        "name": "one joint",
        "plant": {"source": sound, "inputs": {"tau1": "u"}, "outputs": {"q1": "y"}} | (plant or {}),
        "controller": {"source": sound, "inputs": {"q_ref1 - q1": "u"}, "outputs": {"command1": "y"}}
        | (controller or {}),
        "loop": {"rate_hz": RATE, "algebraic_loops": "previous"},
        "identify": {"a": {"start": 1.5}},
        "estimator": {"kind": "clie"},
        "train": {
            "reference": {"kind": "chirp", "start_hz": 0.3, "stop_hz": 2.0, "duration_s": LENGTH,
                          "joints": [{"amplitude": 1.0}]},
            "torque": {"file": "log.csv"},
        },
    }  # fmt: skip
    path = folder / "case.yaml"
    path.write_text(yaml.safe_dump(case), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Torque at 20 Hz of the loop with the right value, a = 2, with a little noise."""
    folder = tmp_path_factory.mktemp("log")
    table = simulate(written(folder), parameters={"a": 2.0})
    tau = table.column("tau1")[::5][:-1] + 1e-3 * np.random.default_rng(1).normal(size=40)
    write_csv(trajectory(table.time[::5][:-1], {"tau1": tau}), folder / "log.csv")
    return folder / "log.csv"


@pytest.fixture
def folder(tmp_path: Path, log: Path) -> Path:
    (tmp_path / "log.csv").write_bytes(log.read_bytes())
    return tmp_path


def source(folder: Path, fault: str, *, isolated: bool) -> dict[str, Any]:
    stated = {"rerun": "re-instantiate", "isolated": True, "time_limit_s": 1.0} if isolated else {}
    return {"source": str(awkward_fmu(folder, fault))} | stated


def test_the_loop_without_faults_is_identified(folder: Path) -> None:
    found = identify(written(folder)).parameters["a"]
    assert found.value == pytest.approx(2.0, abs=3 * found.std)


CASES = [(fault, True) for fault in FAULTS] + [("ERROR_IN_STEP", False), ("NAN_OUTPUT", False)]


@pytest.mark.parametrize("component", ["plant", "controller"])
@pytest.mark.parametrize(("fault", "isolated"), CASES)
def test_the_headline(folder: Path, component: str, fault: str, isolated: bool) -> None:
    path = written(folder, **{component: source(folder, fault, isolated=isolated)})
    headline = f"^The {component} " + FAULTS[fault].replace("{component}", component)
    for verb in (simulate, identify):
        with pytest.raises(FmuDidimError) as caught:
            verb(path)
        assert re.search(headline, str(caught.value)), str(caught.value)
    try:
        told = check(path).summary()
    except FmuDidimError as error:
        told = str(error)
    assert re.search(headline.replace("^", ""), " ".join(told.split())), told


@pytest.mark.parametrize("component", ["plant", "controller"])
def test_a_failure_in_the_middle_of_an_identification(
    folder: Path, component: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """After some runs that went well; told on the command line and in the saved refusal, too."""
    path = written(folder, **{component: source(folder, "ERROR_LATER", isolated=False) | {"rerun": "reset"}})
    assert main(["identify", str(path), "--out", str(folder / "out"), "--quiet"]) == 1
    told = capsys.readouterr().err
    assert re.search(f"fmu-didim: The {component} {LATER}", told), told
    assert "physical" not in told.split("\n")[1]
    if (folder / "out").is_dir():
        assert load_result(folder / "out").advice.startswith(f"The {component} failed")
