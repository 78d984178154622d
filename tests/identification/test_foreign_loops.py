"""Loops with the FMUs of other tools as they are, by the defaults of a case, their data by FMPy.

Right values or a doubt that names the cause, and nothing named where nothing is missing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
import yaml
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave

from fmu_didim import discover, identify
from fmu_didim.case import load_case
from fmu_didim.data.signals import trajectory, write_csv
from tests.checks.test_reading import gain
from tests.foreign import external_fmu

NOISE = 0.01
"""[1] Of the torque of each log."""
KP, RATE = 8.0, 100
"""Gain and rate in Hz of the control of the speed, :func:`tests.checks.test_reading.gain`."""


class Slave:
    """FMPy's instance, its variables by their names."""

    def __init__(self, path: Path, folder: Path, values: Mapping[str, float]) -> None:
        described = fmpy.read_model_description(str(path), validate=False)
        self._reference = {v.name: v.valueReference for v in described.modelVariables}
        kind, self._double = (FMU3Slave, "Float64") if described.fmiVersion.startswith("3") else (FMU2Slave, "Real")
        self._fmu = kind(
            guid=described.guid, unzipDirectory=str(fmpy.extract(str(path), unzipdir=str(folder / path.stem))),
            modelIdentifier=described.coSimulation.modelIdentifier, instanceName=path.stem,
        )  # fmt: skip
        self._fmu.instantiate()
        if kind is FMU2Slave:
            self._fmu.setupExperiment(startTime=0.0)
            self.set(values)
        self._fmu.enterInitializationMode()
        if kind is FMU3Slave:
            self.set(values)
        self._fmu.exitInitializationMode()

    def set(self, values: Mapping[str, float]) -> None:
        getattr(self._fmu, f"set{self._double}")([self._reference[name] for name in values], list(values.values()))

    def step(self, time: float, size: float, output: str) -> float:
        """The output after a step."""
        self._fmu.doStep(time, size)
        return float(getattr(self._fmu, f"get{self._double}")([self._reference[output]])[0])

    def end(self) -> None:
        self._fmu.terminate()
        self._fmu.freeInstance()


Logged = Callable[[np.ndarray, np.ndarray, Path], np.ndarray]
"""From time (K,), set point of the speed (K,) and a folder to the torque (K,)."""


def case_of(folder: Path, document: dict[str, Any], speeds: Callable[[np.ndarray, float], np.ndarray], step: float,
            rate_hz: int, logged: Logged) -> Path:  # fmt: skip
    """The case with logs at some ticks, noise added, and the set point of the speed as reference."""
    rng = np.random.default_rng(3)
    time = np.arange(5001 if step < 0.005 else 1601) * step
    for label, faster in (("train", 1.0), ("validation", 1.1)):
        wanted = speeds(time, faster)
        torque = logged(time, wanted, folder / label)
        noisy = torque + NOISE * torque.std() * rng.normal(size=torque.size)
        chosen = slice(0, -1, round(1 / step / rate_hz))
        write_csv(trajectory(time, {"dq1": wanted}), folder / f"{label}_reference.csv")
        write_csv(trajectory(time[chosen], {"tau1": noisy[chosen]}), folder / f"{label}.csv")
        document[label] = {"reference": {"file": f"{label}_reference.csv"}, "torque": {"file": f"{label}.csv"}}
    path = folder / "case.yaml"
    path.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
    return path


def near(found: Mapping[str, Any], truth: Mapping[str, float]) -> bool:
    return all(abs(found[name].value - true) < 3.5 * found[name].std for name, true in truth.items())


# ---- a spring pendulum of Dymola 2023x, FMI 3.0, with a control of the speed of one's own --------------------------

PENDULUM = {"mass.m": 1.4, "spring.c": 15.0}
FMIZOO = "github.com/ThummeTo/FMIZoo.jl (models/bin/Dymola/2023x/3.0)"


def pendulum_case(folder: Path, truth: str) -> Path:
    """A mass at a spring, of which the velocity is fed back; the data by the FMU that is named."""
    plant, source = (external_fmu(name, FMIZOO) for name in ("SpringPendulumExtForce1D", truth))

    def logged(time: np.ndarray, wanted: np.ndarray, place: Path) -> np.ndarray:
        one, speed, torque = Slave(source, place, PENDULUM), 0.0, np.zeros(time.size)
        for k, value in enumerate(wanted):
            torque[k] = KP * (value - speed)
            one.set({"extForce": torque[k]})
            speed = one.step(k / RATE, 1 / RATE, "v")
        one.end()
        return torque

    document: dict[str, Any] = {
        "schema": 1, "name": "spring", "loop": {"rate_hz": RATE}, "estimator": {"kind": "clie"},
        "plant": {"kind": "fmu", "source": str(plant), "inputs": {"tau1": "extForce"}, "outputs": {"dq1": "v"}},
        "controller": {"kind": "fmu", "source": str(gain(folder))},
        "identify": {"m": {"parameter": "mass.m", "minimum": 0.01}, "c": {"parameter": "spring.c"}},
    }  # fmt: skip
    speeds = lambda t, f: sum(1.5 * np.sin(2 * np.pi * f * k * t / 4 + k) for k in (1, 2, 3, 5))  # noqa: E731
    return case_of(folder, document, speeds, 1 / RATE, 50, logged)


@pytest.mark.gate
def test_a_spring_pendulum_that_lacks_nothing_is_valid_and_nothing_is_named(tmp_path: Path) -> None:
    case = pendulum_case(tmp_path, "SpringPendulumExtForce1D")
    result = identify(case)
    assert result.verdict == "valid", result.document.reasons
    assert near(result.document.parameters, {"m": 1.4, "c": 15.0})
    found = discover(case)
    assert (found.document.answer, found.document.findings) == ("nothing", [])


@pytest.mark.gate
def test_friction_of_a_spring_pendulum_is_suspected_and_named(tmp_path: Path) -> None:
    """Modelica's own friction, with sticking: Coulomb, viscous and Stribeck."""
    case = pendulum_case(tmp_path, "SpringFrictionPendulumExtForce1D")
    result = identify(case)
    assert result.verdict == "doubtful"
    assert "friction" in result.document.reasons[0].text
    found = discover(case)
    assert found.document.answer in ("named", "named_with_remainder")
    assert found.document.findings[0].effect == "coulomb"


# ---- a drive and its controller, both of Dymola 2021x -------------------------------------------------------------

DRIVE = {"inertia1.J": 1.2, "inertia2.J": 1.7, "spring.c": 9e3, "spring.d": 130.0}
NAMES = ("J1", "J2", "c", "d")


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two masses at 1 kHz; the controller gives its command after its step."""
    place, step, folder = "tests/resources of github.com/CATIA-Systems/FMPy", 1e-3, tmp_path_factory.mktemp("pair")
    plant, law = (external_fmu(name, place) for name in ("Drivetrain", "Controller"))

    def logged(time: np.ndarray, wanted: np.ndarray, place: Path) -> np.ndarray:
        one, other, speed = Slave(plant, place, DRIVE), Slave(law, place, {"PI.yMax": 1000.0}), 0.0
        torque = np.zeros(time.size)
        for k, value in enumerate(wanted):
            other.set({"u_s": value, "u_m": speed})
            torque[k] = other.step(k * step, step, "y")
            one.set({"tau": torque[k]})
            speed = one.step(k * step, step, "w")
        one.end()
        other.end()
        return torque

    document: dict[str, Any] = {
        "schema": 1, "name": "pair", "loop": {"rate_hz": 1 / step}, "estimator": {"kind": "clie"},
        "plant": {"kind": "fmu", "source": str(plant), "inputs": {"tau1": "tau"}, "outputs": {"dq1": "w"}},
        "controller": {
            "kind": "fmu", "source": str(law), "inputs": {"dq_ref1": "u_s", "dq1": "u_m"}, "outputs": {"command1": "y"},
            "parameters": {"PI.yMax": 1000.0},
        },
        "identify": {n: {"parameter": own, "minimum": 1e-3} for n, own in zip(NAMES, DRIVE, strict=True)},
    }  # fmt: skip
    waves = ((2.0, 0.3), (1.0, 1.1), (0.5, 4.3), (0.3, 9.0), (0.3, 17.0))
    speeds = lambda t, faster: sum(a * np.sin(2 * np.pi * faster * f * t) for a, f in waves)  # noqa: E731
    return case_of(folder, document, speeds, step, 100, logged)


@pytest.mark.gate
def test_a_pair_of_dymola_is_doubted_for_when_its_command_holds_and_valid_when_that_is_said(pair: Path) -> None:
    result = identify(pair)
    assert result.verdict == "doubtful"
    reason = result.document.reasons[0]
    assert (reason.code, reason.place) == ("reading-acts", "controller")
    assert "controller: {outputs_after_step: true}" in reason.next_step
    said = identify(load_case(pair).with_(controller={"outputs_after_step": True}))
    assert said.verdict == "valid", said.document.reasons
    assert near(said.document.parameters, dict(zip(NAMES, DRIVE.values(), strict=True)))


@pytest.mark.slow
@pytest.mark.parametrize(("stated", "verdict"), [({}, "doubtful"), ({"outputs_after_step": True}, "valid")])
def test_nothing_is_named_in_a_pair_of_dymola(pair: Path, stated: dict[str, Any], verdict: str) -> None:
    found = discover(load_case(pair).with_(controller=stated))
    assert (found.document.answer, found.document.findings, found.verdict) == ("nothing", [], verdict)
