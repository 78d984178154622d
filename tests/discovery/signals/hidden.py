"""Data of two models, simulated on a fine grid by other means than the package, with something hidden on a signal."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import yaml
from scipy.signal import lsim

from fmu_didim.data.signals import Array, Variable
from fmu_didim.dynamics.block import Block
from fmu_didim.export import build_fmu
from tests.room import TRUTH, room_fmu, weather

FINE = 20
"""Steps of the simulation between two rows."""
G = 9.81


@dataclass(frozen=True)
class Hidden:
    """Signal -> what is done to it: ``scale``, ``offset``, ``lag``, ``delay``, ``drift`` (over the experiment),
    ``upper``, ``lower``, ``transient`` with ``fades``; and parameters with another value."""

    signals: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    parameters: Mapping[str, float] = field(default_factory=dict)

    def on(self, name: str, time: Array, signal: Array, *, is_held: bool = False) -> Array:
        """A signal (T,) on an even fine grid as it acts, or is shown."""
        asked = dict(self.signals.get(name, {}))
        found, step = signal.copy(), time[1] - time[0]
        if shift := round(asked.get("delay", 0.0) / step):
            found = np.concatenate([np.full(shift, found[0]), found[:-shift]])
        if lag := asked.get("lag"):
            lead = lsim(([1.0], [lag, 1.0]), found - found[0], time - time[0], interp=not is_held)[1]
            found = found[0] + lead
        part = (time - time[0]) / np.ptp(time)
        found = asked.get("scale", 1.0) * found + asked.get("offset", 0.0) + asked.get("drift", 0.0) * part
        found = found + asked.get("transient", 0.0) * np.exp(-(time - time[0]) / asked.get("fades", 1.0))
        return np.clip(found, asked.get("lower", -np.inf), asked.get("upper", np.inf))


NOTHING = Hidden()


def write(path: Path, columns: Mapping[str, Array]) -> None:
    """A CSV file."""
    table = np.column_stack(list(columns.values()))
    np.savetxt(path, table, delimiter=",", header=",".join(columns), comments="", fmt="%.9g")


def case_of(
    folder: Path, name: str, fmu: Path, identify: Any, interpolation: str, known: Mapping[str, float] | None = None
) -> Path:
    """A case of files ``inputs.csv`` and ``measured.csv``, and of those held out where they are."""
    held: dict[str, Any] = {}
    if (folder / "held_inputs.csv").exists():
        held = {"validation": {"inputs": {"file": "held_inputs.csv", "interpolation": interpolation},
                               "measured": "held_measured.csv"}}  # fmt: skip
    given = {k: v for k, v in (known or {}).items() if k not in identify}
    content = {
        "schema": 1, "name": name, "model": {"source": str(fmu), "parameters": given},
        "inputs": {"file": "inputs.csv", "interpolation": interpolation}, "measured": "measured.csv", **held,
        "identify": identify,
    }  # fmt: skip
    path = folder / "case.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    return path


def room(
    folder: Path, hidden: Hidden = NOTHING, *, seed: int = 1, count: int = 400, noise: float = 0.1, held: bool = True,
    identify: Any = ("R1",), colour: float = 0.0,
) -> Path:  # fmt: skip
    """A room between two temperatures, its inputs held from row to row."""
    for k, prefix in enumerate(("", "held_") if held else ("",)):
        rng = np.random.default_rng(100 * seed + k)
        inputs, step = weather(rng, count), 60.0
        fine = np.arange(count * FINE) * step / FINE
        acting = [
            hidden.on(n, fine, np.repeat(c, FINE), is_held=True) for n, c in zip(("Ti1", "Ti2"), inputs.T, strict=True)
        ]
        known = {**TRUTH, **hidden.parameters}
        conductance = 1 / known["R1"] + 1 / known["R2"]
        decay = np.exp(-conductance * step / FINE / known["C"])
        pull = (acting[0] / known["R1"] + acting[1] / known["R2"]) / conductance
        true = [known["T0"]]
        for value in pull[:-1]:
            true.append(decay * true[-1] + (1 - decay) * value)
        shown = hidden.on("T", fine, np.array(true))[::FINE]
        time = fine[::FINE]
        write(folder / f"{prefix}inputs.csv", {"t": time, "Ti1": inputs[:, 0], "Ti2": inputs[:, 1]})
        write(folder / f"{prefix}measured.csv", {"t": time, "T": shown + coloured(rng, count, noise, colour)})
    return case_of(folder, "room", room_fmu(), {name: {"minimum": 0} for name in identify}, "held", {"R2": TRUTH["R2"]})


@cache
def crane_fmu() -> Path:
    """A load on a rope below a trolley that is accelerated: x'' = u, L phi'' = -g sin phi - u cos phi - d L phi'."""
    x, u, p = ca.SX.sym("x", 4), ca.SX.sym("u"), ca.SX.sym("p", 3)
    phi, dphi, _, speed = ca.vertsplit(x)
    length, damping, gravity = ca.vertsplit(p)
    turn = (-gravity * ca.sin(phi) - u * ca.cos(phi)) / length - damping * dphi
    return build_fmu(
        Block(
            "Crane",
            (Variable("u", "m/s2"),),
            (Variable("phi", "rad"), Variable("x", "m")),
            (Variable("a", "rad"), Variable("b", "rad/s"), Variable("c", "m"), Variable("e", "m/s")),
            (Variable("L", "m", start=1.5), Variable("d", "1/s", start=0.1), Variable("g", "m/s2", start=G)),
            ca.Function("update", [x, u, p], [ca.vertcat(dphi, turn, speed, u)]),
            ca.Function("output", [x, u, p], [ca.vertcat(phi, x[2])]),
            ca.Function("start", [u, p], [ca.DM.zeros(4)]),
            rate_bound=ca.Function("rate", [x, p], [ca.sqrt(gravity / length) + damping]),
        )
    )


def crane(
    folder: Path, hidden: Hidden = NOTHING, *, seed: int = 1, count: int = 250, noise: float = 0.003,
    held: bool = True, identify: Any = ("L", "d"), colour: float = 0.0,
) -> Path:  # fmt: skip
    """A crane whose input goes straight from row to row."""
    for k, prefix in enumerate(("", "held_") if held else ("",)):
        rng = np.random.default_rng(100 * seed + k)
        step = 0.05
        time = np.arange(count) * step
        edges = np.sort(rng.uniform(0, time[-1], 14))
        driven = 0.6 * np.where(np.searchsorted(edges, time) % 2, 1.0, -1.0) + 0.2 * np.sin(2 * np.pi * time / 7.3)
        driven -= driven.mean()
        fine = np.arange((count - 1) * FINE + 1) * step / FINE
        acting = hidden.on("u", fine, np.interp(fine, time, driven))
        slope = partial(_slope, length=2.0, damping=0.2, gravity=hidden.parameters.get("g", G))
        h, state, states = step / FINE, np.array([0.0, 0.0, 0.0, 0.0]), []

        for i in range(fine.size):
            states.append(state)
            if i + 1 < fine.size:  # the midpoint rule
                half = state + h / 2 * slope(state, acting[i])
                state = state + h * slope(half, (acting[i] + acting[i + 1]) / 2)
        table = np.array(states)
        phi, x = (hidden.on(n, fine, table[:, j])[::FINE] for n, j in (("phi", 0), ("x", 2)))
        write(folder / f"{prefix}inputs.csv", {"t": time, "u": driven})
        write(folder / f"{prefix}measured.csv", {
            "t": time, "phi": phi + coloured(rng, count, noise, colour), "x": x + coloured(rng, count, noise, colour),
        })  # fmt: skip
    return case_of(folder, "crane", crane_fmu(), {name: {"minimum": 0} for name in identify}, "linear")


def _slope(state: Array, u: float, *, length: float, damping: float, gravity: float) -> Array:
    turn = (-gravity * np.sin(state[0]) - u * np.cos(state[0])) / length - damping * state[1]
    return np.array([state[1], turn, state[3], u])


def coloured(rng: np.random.Generator, count: int, deviation: float, colour: float) -> Array:
    """(count,) noise of this deviation with this correlation of neighbours."""
    drawn, found = rng.normal(0, 1, count), np.empty(count)
    found[0] = drawn[0]
    for k in range(1, count):
        found[k] = colour * found[k - 1] + np.sqrt(1 - colour**2) * drawn[k]
    return deviation * found
