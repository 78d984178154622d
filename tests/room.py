"""A room between two temperatures as a model that is calibrated: an FMU, its data, and ways in which both may be wrong.

    C dT/dt = (Ti1 - T)/R1 + (Ti2 - T)/R2,      Q = (Ti1 - T)/R1,      T(0) = T0

With inputs that are held over a step h the exact temperature is T' = a T + (1 - a) q/g, g = 1/R1 + 1/R2,
q = Ti1/R1 + Ti2/R2, a = exp(-g h/C).
"""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from fmu_didim.data.signals import Array, Variable
from fmu_didim.dynamics.block import Block
from fmu_didim.export import build_fmu

STEP = 60.0
"""[s] Between two rows."""
SUN = 6000.0
"""[s] Length of a day of the sun: near the period of the second neighbour, which follows much of it."""
OF_ROBOTS = "torque joint gain reference controller drive motion encoder robot gravity plant machine loop friction"
"""Words that mean nothing where there is a model alone."""
TRUTH = {"R1": 0.1, "R2": 0.25, "C": 2000.0, "T0": 20.0}


@cache
def room_fmu() -> Path:
    """The FMU of the room, with R1 = R2 = 0.2 and the true C and T0."""
    x, u, p = ca.SX.sym("x"), ca.SX.sym("u", 2), ca.SX.sym("p", 4)
    first, second, capacity, start = (p[i] for i in range(4))
    flow = (u[0] - x) / first
    block = Block(
        "Room",
        (Variable("Ti1", "degC"), Variable("Ti2", "degC")),
        (Variable("T", "degC"), Variable("Q", "W")),
        (Variable("x", "degC"),),
        (
            Variable("R1", "K/W", start=0.2), Variable("R2", "K/W", start=0.2), Variable("C", "J/K", start=2000.0),
            Variable("T0", "degC", start=20.0),
        ),
        ca.Function("update", [x, u, p], [(flow + (u[1] - x) / second) / capacity]),
        ca.Function("output", [x, u, p], [ca.vertcat(x, flow)]),
        ca.Function("start", [u, p], [start]),
        rate_bound=ca.Function("rate", [x, p], [(1 / first + 1 / second) / capacity]),
    )  # fmt: skip
    return build_fmu(block)


def weather(rng: np.random.Generator, count: int) -> Array:
    """(count, 2) temperatures of the neighbours."""
    time = STEP * np.arange(count)
    outside = 5 + 8 * np.sin(2 * np.pi * time / 20000) + np.cumsum(rng.normal(0, 0.2, count))
    return np.column_stack([outside, 22 + 2 * np.sign(np.sin(2 * np.pi * time / 7000))])


def temperature(inputs: Array, *, third: tuple[float, float] | None = None, **values: float) -> Array:
    """(N,) exact temperature; ``third``: resistance to a third neighbour, and its temperature."""
    known = {**TRUTH, **values}
    resistances = [known["R1"], known["R2"], *([third[0]] if third else [])]
    sources = [*inputs.T, *([np.full(len(inputs), third[1])] if third else [])]
    conductance = sum(1 / r for r in resistances)
    pull = sum(s / r for s, r in zip(sources, resistances, strict=True)) / conductance
    decay = np.exp(-conductance * STEP / known["C"])
    found = [known["T0"]]
    for value in pull[:-1]:
        found.append(decay * found[-1] + (1 - decay) * value)
    return np.array(found)


def write_room(
    folder: Path, *, seed: int = 1, noise: float = 0.1, count: int = 500, offset: float = 0.0, delay: int = 0,
    drift: float = 0.0, outlier: float = 0.0, flow: int = 0, hold: int = 1, sun: float = 0.0, memory: float = 0.0,
    name: str = "", **truth: Any,
) -> None:  # fmt: skip
    """Write ``weather.csv`` and ``room.csv``, and with ``flow`` every so many rows of Q into ``flow.csv``.

    Args:
        offset, drift: of the sensor; outlier: of one sample; delay: rows by which the first input acts later.
        hold: rows for which both inputs stay.
        sun: power in W at noon of a sun that is not recorded, and shines on the room half of each ``SUN`` seconds.
        memory: correlation of the noise of one row with that of the next.
        name: in front of the names of the files.
    """
    rng = np.random.default_rng(seed)
    time, inputs = STEP * np.arange(count), weather(rng, count)[np.arange(count) // hold * hold]
    acting = inputs.copy()
    if delay:
        acting[:, 0] = np.concatenate([np.full(delay, inputs[0, 0]), inputs[:-delay, 0]])
    shining = sun * np.maximum(np.sin(2 * np.pi * time / SUN), 0)
    true = temperature(acting + {**TRUTH, **truth}["R1"] * np.outer(shining, [1, 0]), **truth)
    errors = rng.normal(0, noise, count)
    for k in range(1, count):
        errors[k] = memory * errors[k - 1] + np.sqrt(1 - memory**2) * errors[k]
    measured = true + offset + drift * time / time[-1] + errors
    measured[count // 2] += outlier
    _write(folder / f"{name}weather.csv", "t,Ti1,Ti2", np.column_stack([time, inputs]))
    _write(folder / f"{name}room.csv", "t,T", np.column_stack([time, measured]))
    if flow:
        heat = (acting[:, 0] - true) / {**TRUTH, **truth}["R1"] + rng.normal(0, 1.0, count)
        _write(folder / f"{name}flow.csv", "t,Q", np.column_stack([time, heat])[::flow])


def _write(path: Path, head: str, table: Array) -> None:
    np.savetxt(path, table, delimiter=",", header=head, comments="", fmt="%.9f")


def room_case(folder: Path, **changes: Any) -> Path:
    """A case of the room in a folder; ``changes``: other entries."""
    import yaml

    content = {
        "schema": 1, "name": "room", "model": str(room_fmu()),
        "inputs": {"file": "weather.csv", "interpolation": "held"}, "measured": "room.csv",
        "identify": {"R1": {"minimum": 0}, "R2": {"minimum": 0}},
    } | changes  # fmt: skip
    path = folder / "case.yaml"
    path.write_text(yaml.safe_dump({k: v for k, v in content.items() if v is not None}, sort_keys=False))
    return path


def forbidden(text: str) -> list[str]:
    """The words of robots in a text."""
    return re.findall(rf"\b(?:{'|'.join(OF_ROBOTS.split())})s?\b", text, re.IGNORECASE)
