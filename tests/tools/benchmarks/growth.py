"""How the time and the memory of a whole ``fmu-didim identify`` grow with joints, samples and experiments."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from fmu_didim.data.excitation import Fourier, FourierJoint
from tests.tools.benchmarks.command_start import command
from tests.tools.benchmarks.figure import EXPONENT, PARAMETERS, Figure, Settings

RATE_HZ = 200
"""[Hz] Of the control."""
PERIOD_S = 10.0
"""[s] Of the motion."""
HARMONICS = 5
AMPLITUDE = 0.6
"""[rad] Of the motion of each joint."""
INERTIA = 2.0
"""[kg.m^2] Of the motors, seen by the joint, so that one law fits all postures."""
BANDWIDTH = 15.0
"""[rad/s] Of the control."""
NOISE = 0.02
"""[1] Of the torque, relative to its deviation."""
MEASURED = (
    "import resource, subprocess, sys; subprocess.run(sys.argv[1:]); "
    "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss, file=sys.stderr)"
)
"""Runs a command and prints its memory in KB. A process of its own, as small as can be: what one has taken before it
becomes another program counts, and a benchmark that has run others before is large."""
LARGEST_S, LARGEST_MB = 30.0, 1000.0
"""What a million samples of two joints may take."""


@dataclass(frozen=True)
class Size:
    """Joints of an arm, samples of the log of each experiment (at the rate of the control), and experiments."""

    joints: int = 2
    samples: int = 2000
    experiments: int = 1


@dataclass(frozen=True)
class Cost:
    """Seconds, MB at their highest, and the number of parameters."""

    seconds: float
    memory_mb: float
    parameters: int


CURVES: Mapping[str, Mapping[int, Size]] = {
    "joints": {n: Size(joints=n) for n in (2, 4, 6, 8, 12)},
    "samples": {n: Size(samples=n) for n in (1000, 10_000, 100_000, 1_000_000)},
    "experiments": {n: Size(experiments=n) for n in (1, 3, 10, 30, 100)},
}
"""What grows -> its number -> the case."""


def run(settings: Settings) -> list[Figure]:
    """The exponents of time and memory of each curve by least squares on the logarithms; the points stand beside."""
    usual = {name: len(curve) - (name != "samples") for name, curve in CURVES.items()}
    counts = {name: settings.size(usual[name], 2, len(curve)) for name, curve in CURVES.items()}
    curves = {
        name: {n: _cost(size) for n, size in list(CURVES[name].items())[:count]} for name, count in counts.items()
    }
    result = [figure for name, costs in curves.items() for figure in _exponents(name, costs)]
    largest = curves["samples"].get(1_000_000)
    if largest is not None:
        result += [
            Figure("identify, a million samples of two joints, seconds", largest.seconds, LARGEST_S),
            Figure("identify, a million samples of two joints, MB", largest.memory_mb, LARGEST_MB),
        ]
    return result


def _exponents(name: str, costs: Mapping[int, Cost]) -> list[Figure]:
    """Of the time and of the memory of one curve."""
    result = []
    for what, unit in (("seconds", "s"), ("memory_mb", "MB")):
        values = {n: float(getattr(cost, what)) for n, cost in costs.items()}
        exponent = float(np.polyfit(np.log(list(values)), np.log(list(values.values())), 1)[0])
        medians = {f"{n} {name} {unit}": value for n, value in values.items()}
        if unit == "s":
            medians |= {f"{n} {name} {PARAMETERS}": float(cost.parameters) for n, cost in costs.items()}
        title = "time" if unit == "s" else "memory"
        result.append(
            Figure(f"identify as a whole command, {title} over {name}{EXPONENT}", exponent, None, "at most", medians)
        )
    return result


def _cost(size: Size) -> Cost:
    """Of an identification, warm."""
    with tempfile.TemporaryDirectory() as name:
        # What a first run compiles depends on the joints alone.
        short = write_case(Path(name) / "short", replace(size, samples=1000, experiments=1))
        _identified(short, Path(name) / "first")
        case = write_case(Path(name), size)
        seconds, memory = _identified(case, Path(name) / "result")
        result = yaml.safe_load((Path(name) / "result/result.json").read_text(encoding="utf-8"))
        return Cost(seconds, memory, len(result["parameters"]))


def _identified(case: Path, out: Path) -> tuple[float, float]:
    """Seconds, and MB of memory at their highest where the system says it; a doubtful answer is no failure here."""
    call, begin = [*command(), "identify", str(case), "--out", str(out)], time.perf_counter()
    measured = [sys.executable, "-c", MEASURED, *call] if find_spec("resource") else call
    done = subprocess.run(measured, capture_output=True, text=True)
    seconds = time.perf_counter() - begin
    assert "Report: " in done.stdout, done.stderr[-2000:]
    return seconds, float(done.stderr.split()[-1]) / 1024 if measured is not call else float("nan")


def write_case(folder: Path, size: Size) -> Path:
    """A case of an arm whose axes turn by right angles, with PD control, and its logs, simulated with noise."""
    folder.mkdir(exist_ok=True)
    (folder / "robot.yaml").write_text(yaml.safe_dump(robot(size.joints)), encoding="utf-8")
    (folder / "controller.yaml").write_text(yaml.safe_dump(controller(size.joints)), encoding="utf-8")
    labels = [f"run_{k}" for k in range(1, size.experiments + 1)]
    experiments = {
        label: {
            "reference": motion(size, seed).model_dump(mode="json"), "torque": {"file": f"torque_{seed}.csv"},
            "role": "estimation",
        }
        for seed, label in enumerate(labels, start=1)
    }  # fmt: skip
    content = {
        "schema": 1, "name": "arm", "robot": "robot.yaml", "plant": {"kind": "fmu"},
        "controller": {"kind": "fmu", "source": "controller.yaml"}, "experiments": experiments,
    }  # fmt: skip
    path = folder / "case.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    for seed, label in enumerate(labels, start=1):
        _write_log(folder, path, label, seed, size)
    return path


def _write_log(folder: Path, case: Path, label: str, seed: int, size: Size) -> None:
    """The log of an experiment."""
    loop = folder / "loop.csv"
    subprocess.run(
        [*command(), "simulate", str(case), "--experiment", label, "--out", str(loop)], check=True, capture_output=True
    )
    names = ["t", *(f"tau{j}" for j in range(1, size.joints + 1))]
    table = np.genfromtxt(loop, delimiter=",", names=True, max_rows=size.samples)
    torque = np.column_stack([table[name] for name in names[1:]])
    torque += NOISE * torque.std(axis=0) * np.random.default_rng(seed).normal(size=torque.shape)
    rows = np.column_stack([table["t"], torque])
    np.savetxt(folder / f"torque_{seed}.csv", rows, "%.9g", ",", header=",".join(names), comments="")


def robot(joints: int) -> dict[str, Any]:
    """The description of an arm whose axes turn by right angles."""
    links = [
        {
            "type": "revolute", "alpha": (0, "pi/2", "-pi/2")[1 + k % 2 if k else 0], "a": 0.2 if k % 2 else 0.0,
            "d": 0.1, "effects": ["motor_inertia", "viscous", "coulomb"],
            "parameters": {
                "XX": 0.05, "YY": 0.04, "ZZ": 0.03, "MX": 0.05, "MY": 0.02, "MZ": 0.03, "M": 1.0, "Ia": INERTIA,
                "Fv": 2.0, "Fc": 1.0,
            },
        }
        for k in range(joints)
    ]  # fmt: skip
    return {"schema": 1, "name": "arm", "joints": links}


def controller(joints: int) -> dict[str, Any]:
    """PD control."""
    return {
        "schema": 1, "law": "pd", "name": "arm_pd", "joints": ["revolute"] * joints, "rate_hz": RATE_HZ,
        "velocity": "measured", "Kp": [INERTIA * BANDWIDTH**2] * joints, "Kd": [1.4 * INERTIA * BANDWIDTH] * joints,
    }  # fmt: skip


def motion(size: Size, seed: int) -> Fourier:
    """Periods of a motion with random coefficients."""
    rng = np.random.default_rng(seed)
    raw = rng.normal(size=(2, size.joints, HARMONICS)) / np.arange(1, HARMONICS + 1)
    raw *= AMPLITUDE / np.abs(raw).sum(axis=(0, 2))[None, :, None]
    joints = tuple(
        FourierJoint(cosine=tuple(raw[0, j].tolist()), sine=tuple(raw[1, j].tolist())) for j in range(size.joints)
    )
    return Fourier(fundamental_hz=1 / PERIOD_S, duration_s=size.samples / RATE_HZ, joints=joints)
