"""Plants of which only an FMU is known: their equations, and cases of those who have them."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
import yaml

from fmu_didim import simulate
from fmu_didim.data.signals import Trajectory, Variable, trajectory, write_csv
from fmu_didim.dynamics.block import Block
from fmu_didim.export import build_fmu
from tests.awkward.build import by

EXTERNAL = "FMU_DIDIM_EXTERNAL_FMUS"
"""Variable that names the folder of FMUs of others."""
RATE = 200
"""Hz of the control."""
PHASES = (0.3, 1.1, 2.0, -0.5)
Torque = Callable[[Mapping[str, ca.SX], ca.SX, ca.SX], tuple[ca.SX, ca.SX]]
"""(parameters, q, dq) -> inertia, torque of all that resists."""


def external_fmu(name: str, place: str) -> Path:
    """An FMU that is not shipped; what asks for it is skipped where it is absent.

    Args:
        place: where it can be had.
    """
    path = Path(os.environ.get(EXTERNAL, "external-fmus")) / f"{name}.fmu"
    if not path.is_file():
        pytest.skip(f"needs {path.name}, which is not shipped: get it from {place} and set {EXTERNAL} to its folder")
    return path


def sines(seconds: float, *, period_s: float = 4.0, size: float = 0.5) -> Trajectory:
    """A periodic motion of one joint that starts neither at zero nor at rest."""
    time = np.arange(round(seconds * RATE) + 1) / RATE
    columns = {name: np.zeros(time.size) for name in ("q1", "dq1", "ddq1")}
    for phase, k in zip(PHASES, (1, 2, 3, 5), strict=True):
        w = 2 * np.pi * k / period_s
        for order, name in enumerate(columns):
            columns[name] += size / k * w**order * np.sin(w * time + phase + order * np.pi / 2)
    return trajectory(time, columns)


def one_joint(name: str, parameters: Mapping[str, float], balance: Torque, *, rate: float = 400.0) -> Block:
    """Block of a plant with one joint under the names of its maker: ``torque``, ``phi`` and ``w``."""

    def slopes(p: Mapping[str, ca.SX], x: list[ca.SX], u: ca.SX) -> list[ca.SX]:
        inertia, resisting = balance(p, x[0], x[1])
        return [x[1], (u - resisting) / inertia]

    return plant_block(name, parameters, slopes, count=2, rate=rate)


def crane(p: Mapping[str, ca.SX], x: list[ca.SX], u: ca.SX) -> list[ca.SX]:
    """A trolley that a drum of 1 m pulls, with a load that swings: states phi, w, angle of the load and its rate."""
    sine, cosine = ca.sin(x[2]), ca.cos(x[2])
    pull = p["m"] * sine * (p["l"] * x[3] ** 2 + 9.81 * cosine)
    slope = (u - p["d"] * x[1] + pull) / (p["M"] + p["m"] * sine**2)
    return [x[1], slope, x[3], -(cosine * slope + 9.81 * sine + p["b"] * x[3]) / p["l"]]


def plant_block(
    name: str,
    parameters: Mapping[str, float],
    slopes: Callable[[Mapping[str, ca.SX], list[ca.SX], ca.SX], list[ca.SX]],
    *,
    count: int,
    rate: float = 400.0,
) -> Block:
    """Block of a plant with a torque, a position and a velocity, the first of its states."""
    p, x, u = ca.SX.sym("p", len(parameters) + 2), ca.SX.sym("x", count), ca.SX.sym("u")
    named = {key: p[i] for i, key in enumerate(parameters)}
    starts = ca.vertcat(p[len(parameters) :], ca.SX.zeros(count - 2))
    return Block(
        name=name,
        inputs=(Variable("torque", "N.m", "input", 0.0),),
        outputs=(Variable("phi", "rad", "output", 0.0), Variable("w", "rad/s", "output", 0.0)),
        states=tuple(Variable(f"state{i}", "1", "local", 0.0) for i in range(count)),
        parameters=(
            *(Variable(key, "1", "parameter", value) for key, value in parameters.items()),
            Variable("phi_0", "rad", "parameter", 0.0), Variable("w_0", "rad/s", "parameter", 0.0),
        ),
        update=ca.Function("update", [x, u, p], [ca.vertcat(*slopes(named, ca.vertsplit(x), u))]),
        output=ca.Function("output", [x, u, p], [x[:2]]),
        start=ca.Function("start", [u, p], [starts]),
        rate_bound=ca.Function("rate", [x, p], [ca.SX(rate)]),
    )  # fmt: skip


def spring_pendulum(p: Mapping[str, ca.SX], q: ca.SX, dq: ca.SX) -> tuple[ca.SX, ca.SX]:
    """A pendulum against a spring, with Coulomb friction where it has the parameter ``Fc``."""
    friction = p["Fc"] * ca.tanh(dq / 0.02) if "Fc" in p else ca.SX(0)
    return p["m"] * p["l"] ** 2, p["m"] * 9.81 * p["l"] * ca.sin(q) + p["k"] * q + p["d"] * dq + friction


def foreign_case(
    folder: Path,
    plant: Path,
    truth: Path,
    identify: Mapping[str, Any],
    *,
    plant_entries: Mapping[str, Any] | None = None,
    values: Mapping[str, float] | None = None,
    gains: tuple[float, float] = (60.0, 6.0),
    noise: float = 0.01,
    size: float = 0.5,
    controller: Mapping[str, Any] | None = None,
    velocity: str = "measured",
) -> Path:
    """A case of a foreign plant whose data another FMU has made, with noise of that fraction of the torque.

    Args:
        values: parameters of the plant that made the data.
    """
    law = {
        "schema": 1, "law": "pd", "name": "pd", "joints": ["revolute"], "rate_hz": float(RATE), "velocity": velocity,
        "Kp": [gains[0]], "Kd": [gains[1]],
    }  # fmt: skip
    (folder / "controller.yaml").write_text(yaml.safe_dump(law), encoding="utf-8")
    names = {"inputs": {"tau1": "torque"}, "outputs": {"q1": "phi"}}
    if velocity == "measured":
        names["outputs"]["dq1"] = "w"
    starts = {"parameter_names": {"q_start1": "phi_0", "dq_start1": "w_0"}}
    document: dict[str, Any] = {
        "schema": 1, "name": "foreign",
        "plant": {"kind": "fmu", "source": str(plant), **names, **starts, **(plant_entries or {})},
        "controller": controller or {"kind": "model", "source": "controller.yaml"},
        "identify": dict(identify), "estimator": {"kind": "clie"}, "loop": {"rate_hz": RATE},
    }  # fmt: skip
    rng = np.random.default_rng(5)
    for label, period_s in (("train", 4.0), ("validation", 4.4)):
        write_csv(sines(12.0, period_s=period_s, size=size), folder / f"{label}_reference.csv")
        reference = {"file": f"{label}_reference.csv"}
        made = {k: v for k, v in document.items() if k not in ("identify", "estimator", "validation")}
        made["plant"] = {**document["plant"], "source": str(truth), "parameters": dict(values or {})}
        made["identify"] = dict(identify)
        made["train"] = {"reference": reference, "torque": {"file": "none.csv", "rate_hz": 100}}
        (folder / "making.yaml").write_text(yaml.safe_dump(made), encoding="utf-8")
        table = simulate(folder / "making.yaml")
        torque = table.column("tau1")[:-1:2]
        torque = torque + noise * float(np.std(torque)) * rng.normal(size=torque.shape)
        write_csv(trajectory(table.time[:-1:2], {"tau1": torque}), folder / f"{label}.csv")
        document[label] = {"reference": reference, "torque": {"file": f"{label}.csv"}}
    path = folder / "case.yaml"
    path.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
    return path


def exported(folder: Path, block: Block, tool: str = "Vendor 1.0") -> Path:
    """The block as an FMU that counts as another tool's."""
    folder.mkdir(parents=True, exist_ok=True)
    return by(tool, build_fmu(block, directory=folder))
