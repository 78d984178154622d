"""Cases of a first-order rise y = K (1 - exp(-t / T)): where the record is short beside T, only K / T is known well, K
and T are bounded below alone; where it is long, both are known."""

from __future__ import annotations

from functools import cache
from typing import Any

import casadi as ca
import numpy as np

from fmu_didim.case import Case, load_case
from fmu_didim.data.signals import Variable, trajectory
from fmu_didim.dynamics.block import Block

K, T = 2.0, 1.0
"""[V], [s] Of the truth."""


@cache
def rise() -> Block:
    """The equations of the rise."""
    x, u, p = ca.SX.sym("x"), ca.SX.sym("u", 0), ca.SX.sym("p", 2)
    return Block(
        "rise", (), (Variable("y", "V", "output"),), (Variable("v", "V", "local"),),
        (Variable("K", "V", "parameter", K), Variable("T", "s", "parameter", T)),
        ca.Function("update", [x, u, p], [(p[0] - x) / p[1]]),
        ca.Function("output", [x, u, p], [x]),
        ca.Function("start", [u, p], [ca.DM([0.0])]),
        ca.Function("rate", [x, p], [1 / p[1]]),
    )  # fmt: skip


def rise_case(duration: float, *, noise: float = 0.05, seed: int = 0, samples: int = 41, **entries: Any) -> Case:
    """The case with a record of this duration, s, and one draw of noise."""
    t = np.linspace(0.0, duration, samples)
    y = K * (1 - np.exp(-t / T)) + noise * np.random.default_rng(seed).normal(size=t.size)
    content = {
        "schema": 1, "name": "rise", "model": {"kind": "control", "source": f"{__name__}:rise"},
        "measured": {"file": "rise.csv", "columns": {"y": {"std": noise}}}, "identify": {"K": {}, "T": {}}, **entries,
    }  # fmt: skip
    return load_case(content, signals={"rise.csv": trajectory(t, {"y": y})})
