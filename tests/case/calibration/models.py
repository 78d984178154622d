"""Models with analytic answers, and cases of them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from fmu_didim.case import Case, load_case
from fmu_didim.data.signals import Array, Trajectory, Variable, trajectory
from fmu_didim.dynamics.block import Block

HERE = __name__


def block(name: str, start: Mapping[str, float], states: int, inputs: str, update: Any, output: Any) -> Block:
    """A block with the parameters of ``start``, whose last ones are where its states start, and outputs by name."""
    p, x, u = ca.SX.sym("p", len(start)), ca.SX.sym("x", states), ca.SX.sym("u", len(inputs))
    named = {key: p[i] for i, key in enumerate(start)}
    shown = output(named, x, u)
    return Block(
        name=name,
        inputs=tuple(Variable(one, "1", "input", 0.0) for one in inputs),
        outputs=tuple(Variable(one, "1", "output", 0.0) for one in shown),
        states=tuple(Variable(f"state{i}", "1", "local", 0.0) for i in range(states)),
        parameters=tuple(Variable(key, "1", "parameter", value) for key, value in start.items()),
        update=ca.Function("update", [x, u, p], [ca.vertcat(*update(named, x, u))]),
        output=ca.Function("output", [x, u, p], [ca.vertcat(*shown.values())]),
        start=ca.Function("start", [u, p], [p[len(start) - states :]]),
        rate_bound=ca.Function("rate", [x, p], [ca.SX(5.0)]),
    )


def growth() -> Block:
    """X = X0 exp(mu t)."""
    return block("growth", {"mu": 0.5, "X0": 0.1}, 1, "", lambda p, x, u: [p["mu"] * x[0]], lambda p, x, u: {"X": x[0]})


def lag() -> Block:
    """T y' = k u - y, and z = g y."""
    return block(
        "lag", {"T": 1.0, "k": 1.0, "g": 1.0, "y0": 0.0}, 1, "u", lambda p, x, u: [(p["k"] * u[0] - x[0]) / p["T"]],
        lambda p, x, u: {"y": x[0], "z": p["g"] * x[0]},
    )  # fmt: skip


def root() -> Block:
    """X' = -sqrt(k) X, which is no number where k < 0."""
    return block(
        "root", {"k": 0.5, "X0": 1.0}, 1, "", lambda p, x, u: [-ca.sqrt(p["k"]) * x[0]], lambda p, x, u: {"X": x[0]}
    )  # fmt: skip


def driven() -> Block:
    """x' = a x + u."""
    return block(
        "driven", {"a": -0.9, "x0": 0.8}, 1, "u", lambda p, x, u: [p["a"] * x[0] + u[0]], lambda p, x, u: {"x": x[0]}
    )


def rough() -> Block:
    """X = X0 exp(-k t) with ripples in k that a solver of its own might leave: slopes over tiny steps are theirs."""
    return block(
        "rough", {"k": 0.5, "X0": 1.0}, 1, "", lambda p, x, u: [-p["k"] * x[0]],
        lambda p, x, u: {"X": x[0] * (1 + 3e-4 * ca.sin(3e5 * p["k"] + 40 * x[0]))},
    )  # fmt: skip


def case_of(name: str, signals: Mapping[str, Trajectory], folder: Path = Path(), **entries: Any) -> Case:
    """The case of one of these models with signals in memory."""
    model = {"source": f"{HERE}:{name}", "kind": "control"}
    return load_case({"schema": 1, "name": name, "model": model, **entries}, folder=folder, signals=dict(signals))


def steps_of_lag(time: Array, steps: Mapping[float, float], *, constant: float, gain: float, start: float) -> Array:
    """y of the lag where u jumps to the values of ``steps`` at their instants."""
    instants = [*steps, np.inf]
    found, here = np.zeros(time.size), start
    for begin, end, value in zip(instants[:-1], instants[1:], steps.values(), strict=True):
        inside = (time >= begin) & (time <= end)
        found[inside] = gain * value + (here - gain * value) * np.exp(-(time[inside] - begin) / constant)
        here = gain * value + (here - gain * value) * np.exp(-(end - begin) / constant)
    return found


def ramp_of_lag(time: Array, slope: float, *, constant: float, gain: float, start: float) -> Array:
    """y of the lag where u = slope t."""
    forced = gain * slope * (time - constant)
    return forced + (start + gain * slope * constant) * np.exp(-time / constant)


def noisy(time: Array, columns: Mapping[str, Array], deviation: float, seed: int) -> Trajectory:
    """These columns with white noise."""
    rng = np.random.default_rng(seed)
    return trajectory(time, {name: values + deviation * rng.normal(size=time.size) for name, values in columns.items()})


def shaft() -> Block:
    """(J1 + J2) w' = u - load - d w + b^3, and the angle w turns on from phi0, which no w shows."""
    start = {"J1": 1.0, "J2": 2.0, "load": 0.0, "d": 0.1, "b": 0.0, "phi0": 1.0, "w0": 0.0}
    return block(
        "shaft", start, 2, "u",
        lambda p, x, u: [x[1], (u[0] - p["load"] - p["d"] * x[1] + p["b"] ** 3) / (p["J1"] + p["J2"])],
        lambda p, x, u: {"w": x[1]},
    )  # fmt: skip
