"""An electric drive whose only output is its velocity: its FMUs, and data from a simulation in numpy."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import yaml

from fmu_didim.data.signals import Variable, trajectory, write_csv
from fmu_didim.dynamics.block import Block
from fmu_didim.export import build_fmu

J, D, KP, KI = 0.02, 0.03, 1.2, 15.0
"""Inertia in kg.m2, damping in N.m.s/rad, gains of the speed controller."""
RATE = 200.0
NOISE = 0.01


def drive(*, friction: bool = False) -> Block:
    """J dw/dt = tau - d w [- c tanh(w/0.2)], with output w alone."""
    w, tau, p = ca.SX.sym("w"), ca.SX.sym("tau"), ca.SX.sym("p", 2 + friction)
    load = p[1] * w + (p[2] * ca.tanh(w / 0.2) if friction else 0.0)
    named = [Variable("inertia.J", "kg.m2", "parameter", 0.03), Variable("bearing.d", "N.m.s/rad", "parameter", 0.05)]
    if friction:
        named.append(Variable("bearing.c", "N.m", "parameter", 0.0))
    return Block(
        name="drive", inputs=(Variable("tau", "N.m", "input"),), outputs=(Variable("w", "rad/s", "output"),),
        states=(Variable("speed", "rad/s", "local"),), parameters=tuple(named),
        update=ca.Function("update", [w, tau, p], [(tau - load) / p[0]]),
        output=ca.Function("output", [w, tau, p], [w]),
        start=ca.Function("start", [tau, p], [ca.SX(0)]),
        rate_bound=ca.Function("rate", [w, p], [p[1] / p[0] + (ca.fabs(p[2]) / 0.2 / p[0] if friction else 0.0)]),
    )  # fmt: skip


def controller() -> Block:
    """u = kp (w_ref - w) + ki sum(w_ref - w) T."""
    x, u, p = ca.SX.sym("x"), ca.SX.sym("u", 2), ca.SX.sym("p", 2)
    error = u[0] - u[1]
    return Block(
        name="speed_control", inputs=(Variable("w_ref", "rad/s", "input"), Variable("w", "rad/s", "input")),
        outputs=(Variable("u", "N.m", "output"),), states=(Variable("sum", "rad", "local"),),
        parameters=(Variable("kp", "N.m.s/rad", "parameter", KP), Variable("ki", "N.m/rad", "parameter", KI)),
        update=ca.Function("update", [x, u, p], [x + error / RATE]),
        output=ca.Function("output", [x, u, p], [p[0] * error + p[1] * x]),
        start=ca.Function("start", [u, p], [ca.SX(0)]), sample_time=1.0 / RATE,
    )  # fmt: skip


def speed(seed: int, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """Time and a periodic speed that crosses zero often."""
    rng = np.random.default_rng(seed)
    time = np.arange(round(seconds * RATE) + 1) / RATE
    phase = rng.uniform(0, 2 * np.pi, 4)
    parts = zip((9, 6, 4, 3), (1, 2, 3, 7), phase, strict=True)
    w = sum(a * (np.sin(2 * np.pi * k * time / 4.0 + p) - np.sin(p)) for a, k, p in parts)
    return time, np.asarray(w)


def torque_of(time: np.ndarray, reference: np.ndarray, friction: float) -> np.ndarray:
    """The command of the sampled loop, the drive integrated by 40 steps of Euler and Heun between two ticks."""
    w, total, found = 0.0, 0.0, []
    h = 1 / RATE / 40

    def slope(w: float, u: float) -> float:
        return (u - D * w - friction * float(np.tanh(w / 0.2))) / J

    for r in reference:
        error = r - w
        u = KP * error + KI * total
        total += error / RATE
        found.append(u)
        for _ in range(40):
            first = slope(w, u)
            w += h / 2 * (first + slope(w + h * first, u))
    return np.array(found)


def drive_case(folder: Path, *, friction: float, known: bool = False, seconds: float = 12.0) -> Path:
    """A case of the drive without friction in its model, its data with Coulomb friction of this size in N.m.

    Args:
        known: whether the FMU has a parameter for it, zero, which the case declares as Coulomb friction.
    """
    plant: dict[str, Any] = {
        "kind": "fmu", "source": str(build_fmu(drive(friction=known), directory=folder)),
        "inputs": {"tau1": "tau"}, "outputs": {"dq1": "w"},
    }  # fmt: skip
    if known:
        plant["parameter_names"] = {"Fc1": "bearing.c"}
    law = build_fmu(controller(), directory=folder)
    document: dict[str, Any] = {
        "schema": 1, "name": "drive", "plant": plant,
        "controller": {
            "kind": "fmu", "source": str(law), "inputs": {"dq_ref1": "w_ref", "dq1": "w"}, "outputs": {"command1": "u"},
        },
        "loop": {"rate_hz": RATE},
        "identify": {"J": {"parameter": "inertia.J", "minimum": 1e-4}, "d": {"parameter": "bearing.d"}},
        "estimator": {"kind": "clie"},
    }  # fmt: skip
    rng = np.random.default_rng(3)
    for label, seed in (("train", 1), ("validation", 2)):
        time, reference = speed(seed, seconds)
        torque = torque_of(time, reference, friction)[::2]
        torque += NOISE * np.sqrt(np.mean(torque**2)) * rng.normal(size=torque.size)
        write_csv(trajectory(time, {"dq1": reference}), folder / f"{label}_reference.csv")
        write_csv(trajectory(time[::2], {"tau1": torque}), folder / f"{label}.csv")
        document[label] = {"reference": {"file": f"{label}_reference.csv"}, "torque": {"file": f"{label}.csv"}}
    path = folder / "case.yaml"
    path.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
    return path
