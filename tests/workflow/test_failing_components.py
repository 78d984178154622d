"""A component that fails by itself: its name, the time and the call are the headline, whoever suffers from it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from fmu_didim import check, discover, identify, load_result, simulate
from fmu_didim.base.errors import FmuDidimError, SimulationError
from fmu_didim.cli.main import main
from fmu_didim.components import load_fmu
from fmu_didim.cosim import simulate as run_loop
from fmu_didim.cosim.execution.instance_pool import InstancePool
from fmu_didim.data.signals import trajectory, write_csv
from fmu_didim.export import build_fmu
from fmu_didim.fit.estimate import RefusedError
from tests.awkward.build import awkward_fmu
from tests.helpers import component, loop, reference, scara, scara_pd
from tests.patience import patience

RATE, LENGTH = 100.0, 2.0
FAULTS = {
    "ERROR_IN_STEP": r"failed: fmi2DoStep at t = 0\.03 s of the FMU returned Error\.[\s\S]*the solver gave up",
    "NAN_OUTPUT": r"failed at t = 0\.0[67] s: {component}\.\w+ = nan, while all its inputs are numbers",
    "CRASH_IN_STEP": r"failed at t = 0\.03 s: The FMU crashed its process \(SIGSEGV[\s\S]*during step",
    "EXIT_IN_STEP": r"failed at t = 0\.03 s: The FMU ended its process \(exit status 7\)[\s\S]*during step",
    "HANG_IN_STEP": r"failed at t = 0\.03 s: The FMU gave no answer within [0-9.]+ s[\s\S]*during step",
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
    limit = patience(2.0 if fault == "HANG_IN_STEP" else 60.0)  # others must not run into it
    stated = {"rerun": "re-instantiate", "isolated": True, "time_limit_s": limit} if isolated else {}
    return {"source": str(awkward_fmu(folder, fault))} | stated


@pytest.mark.gate
def test_the_loop_without_faults_is_identified(folder: Path) -> None:
    found = identify(written(folder)).parameters["a"]
    assert found.value == pytest.approx(2.0, abs=3 * found.std)


CASES = [
    ("CRASH_IN_STEP", True), ("ERROR_IN_STEP", False),
    pytest.param("NAN_OUTPUT", False, marks=pytest.mark.slow),
    *(
        pytest.param(fault, True, marks=pytest.mark.slow)
        for fault in ("EXIT_IN_STEP", "ERROR_IN_STEP", "NAN_OUTPUT", "HANG_IN_STEP")
    ),
]  # fmt: skip


@pytest.mark.gate
@pytest.mark.parametrize("component", ["plant", pytest.param("controller", marks=pytest.mark.slow)])
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


@pytest.mark.gate
@pytest.mark.parametrize("component", ["plant", "controller"])
def test_a_failure_in_the_middle_of_an_identification(
    folder: Path, component: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """After some runs that went well; told on the command line and in the saved refusal, too."""
    monkeypatch.setenv("FMU_DIDIM_WORKERS", "1")  # the FMU counts the steps in each process by itself
    path = written(folder, **{component: source(folder, "ERROR_LATER", isolated=False) | {"rerun": "reset"}})
    assert main(["identify", str(path), "--out", str(folder / "out"), "--quiet"]) == 1
    told = capsys.readouterr().err
    assert re.search(f"fmu-didim: The {component} {LATER}", told), told
    assert "physical" not in told.split("\n")[1]
    if (folder / "out").is_dir():
        assert load_result(folder / "out").document.advice.startswith(f"The {component} failed")


@pytest.mark.gate
@pytest.mark.parametrize(
    ("fault", "isolated"),
    [
        ("ERROR_IN_STEP", False),
        *(pytest.param(*c, marks=pytest.mark.slow) for c in (("NAN_OUTPUT", False), ("CRASH_IN_STEP", True))),
    ],
)
def test_the_headline_of_a_discovery(folder: Path, fault: str, isolated: bool) -> None:
    path = written(folder, plant=source(folder, fault, isolated=isolated))
    with pytest.raises(FmuDidimError) as caught:
        discover(path, folder / "out")
    told = str(caught.value)
    assert re.search("^The plant " + FAULTS[fault].replace("{component}", "plant"), told), told


def test_a_refusal_at_a_minimum_keeps_its_reason() -> None:
    """Values that no machine can have are no matter of a failure on the way to them."""
    failure = SimulationError("it gave up.", where="a.fmu", got="said so", next_step="Change it.").in_component(
        "plant", 0.5
    )
    refused = RefusedError(
        "The model is not physical.", iterations=(), got="ZZ1 < 0", values=np.zeros(1), next_step="Change it."
    )
    headed = refused.because_of(failure)
    assert headed.what == "The plant failed at t = 0.5 s: it gave up."
    assert headed.got == "said so; so that there is no answer: The model is not physical.; ZZ1 < 0"
    assert headed.where == "a.fmu" and headed.values is refused.values
    minimum = RefusedError(
        "The model is not physical.", iterations=(), values=np.zeros(1), deviation=np.ones(1), next_step="Change it."
    )
    assert minimum.because_of(failure) is minimum
    assert refused.because_of(None) is refused
    assert failure.in_component("controller", 1.0).component == "plant"  # the first one counts


def test_equations_that_are_known_here_are_not_blamed() -> None:
    """They fail by the values that they are given: it is no failure to head a refusal with."""
    motion, pool = reference(), InstancePool()
    made = load_fmu(build_fmu(scara().block())).with_parameters({"ZZ2": 1e-7, "MX2": 0.0, "MY2": 0.0})
    light, law = made.built_from(scara().block()), component("model", scara_pd())
    with pytest.raises(SimulationError, match=r"^The plant failed"):
        run_loop(loop(light, law, motion), motion, pool=pool)
    assert pool.failure is None
    with pytest.raises(SimulationError, match=r"^The plant failed"):
        run_loop(loop(made, law, motion), motion, pool=pool)  # the same FMU, and nobody knows what is in it
    assert pool.failure is not None and pool.failure.component == "plant"
