"""Cases of a wave y = sin(2 pi f t) with noise: along its frequency the misfit has a minimum at each whole number of
periods more or less."""

from __future__ import annotations

from functools import cache
from typing import Any

import casadi as ca
import numpy as np

from fmu_didim.case import Case, load_case
from fmu_didim.data.signals import Variable, trajectory
from fmu_didim.dynamics.block import Block

PERIODS = 5.0
"""[s] Of the record, and its periods: the true frequency is 1 Hz."""
NOISE = 0.1
"""[m] Standard deviation of the noise."""


@cache
def wave() -> Block:
    """The equations of the wave, with a parameter that does nothing."""
    x, u, p = ca.SX.sym("x", 2), ca.SX.sym("u", 0), ca.SX.sym("p", 2)
    w = 2 * np.pi * p[0]
    return Block(
        "wave", (), (Variable("y", "m", "output"),),
        (Variable("s", "m", "local"), Variable("c", "m", "local")),
        (Variable("f", "Hz", "parameter", 1.0), Variable("idle", "1", "parameter", 1.0)),
        ca.Function("update", [x, u, p], [ca.vertcat(w * x[1], -w * x[0])]),
        ca.Function("output", [x, u, p], [x[0]]),
        ca.Function("start", [u, p], [ca.DM([0.0, 1.0])]),
        ca.Function("rate", [x, p], [w]),
    )  # fmt: skip


def wave_case(seed: int = 0, *, samples: int = 51, noise: float = NOISE, **entries: Any) -> Case:
    """The case with one draw of noise; ``entries`` beside or in the place of those that it has."""
    t = np.linspace(0.0, PERIODS, samples)
    y = np.sin(2 * np.pi * t) + noise * np.random.default_rng(seed).normal(size=t.size)
    content = {
        "schema": 1, "name": "wave", "model": {"kind": "control", "source": f"{__name__}:wave"}, "measured": "wave.csv",
        "identify": {"f": {"start": 0.75, "minimum": 0.6, "maximum": 1.4}}, **entries,
    }  # fmt: skip
    return load_case(content, signals={"wave.csv": trajectory(t, {"y": y})})
