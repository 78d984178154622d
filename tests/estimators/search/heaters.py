"""Cases of a heated body, T' = (k u - T) / tau + offset, whose gain k does nothing while the heater is off."""

from __future__ import annotations

from functools import cache
from typing import Any

import casadi as ca
import numpy as np

from fmu_didim.case import Case, load_case
from fmu_didim.data.signals import Variable, trajectory
from fmu_didim.dynamics.block import Block

TRUTH = {"k": 2.0, "tau": 5.0, "leak": 1e-6}
"""``leak`` is so small a part that it does nothing between its bounds."""


@cache
def heater() -> Block:
    """The equations of the body."""
    x, u, p = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("p", 3)
    return Block(
        "heater", (Variable("u", "W", "input"),), (Variable("T", "K", "output"),), (Variable("x", "K", "local"),),
        (Variable("k", "K/W", "parameter", 2.0), Variable("tau", "s", "parameter", 5.0),
         Variable("leak", "1", "parameter", 1e-6)),
        ca.Function("update", [x, u, p], [(p[0] * u - x) / p[1] - p[2] * x]),
        ca.Function("output", [x, u, p], [x]),
        ca.Function("start", [u, p], [ca.DM([1.0])]),
        ca.Function("rate", [x, p], [1 / p[1]]),
    )  # fmt: skip


def heater_case(power: np.ndarray, *, noise: float = 0.02, **entries: Any) -> Case:
    """The case with this power at 0, 0.5, ... s."""
    t = 0.5 * np.arange(power.size)
    states = [1.0]
    for u in power[:-1]:  # held inputs
        end = TRUTH["k"] * u
        states.append(end + (states[-1] - end) * float(np.exp(-0.5 / TRUTH["tau"])))
    y = np.array(states) + noise * np.random.default_rng(0).normal(size=t.size)
    content = {
        "schema": 1, "name": "heater", "model": {"kind": "control", "source": f"{__name__}:heater"},
        "inputs": {"file": "power.csv", "interpolation": "held"}, "measured": "body.csv",
        "identify": {"k": {"minimum": 0.5, "maximum": 8.0}, "tau": {"minimum": 1.0, "maximum": 20.0}}, **entries,
    }  # fmt: skip
    return load_case(content, signals={"power.csv": trajectory(t, {"u": power}), "body.csv": trajectory(t, {"T": y})})
