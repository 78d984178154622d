"""Two masses and a clutch between them that begins to press while the first one is driven by a sine.

    J1 dw1/dt = A sin(2 pi f t) - c,    J2 dw2/dt = c - d w2,    c = F tanh((w1 - w2)/v) (1 + tanh((t - T)/W))/2

f and T are what is identified, as of the coupled clutches that other tools calibrate.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp

from fmu_didim.data.signals import Array, Variable
from fmu_didim.dynamics.block import Block

J1, J2, DRIVE, DAMPING, PRESS, SLIP, WIDTH, SPEED = 1.0, 0.6, 10.0, 0.2, 8.0, 0.5, 0.05, 10.0
"""Inertias, amplitude of the drive, damping, torque of the clutch, slip and time over which it builds up, and how fast
the first mass turns at the start; in SI units."""
TRUTH = {"freqHz": 0.22, "T2": 0.45}
NOISE = 0.05
"""[rad/s] Standard deviation of both speeds."""
TIME = np.linspace(0.0, 1.5, 151)


@cache
def clutch() -> Block:
    """The equations, starting from other values than the true ones; the last state is the time."""
    x, u, p = ca.SX.sym("x", 3), ca.SX.sym("u", 0), ca.SX.sym("p", 2)
    first, second = _slopes(x, p, ca.sin, ca.tanh)
    return Block(
        "clutch", (),
        (Variable("w1", "rad/s", "output"), Variable("w2", "rad/s", "output")),
        (Variable("speed1", "rad/s"), Variable("speed2", "rad/s"), Variable("clock", "s")),
        (Variable("T2", "s", "parameter", 0.4), Variable("freqHz", "Hz", "parameter", 0.2)),
        ca.Function("update", [x, u, p], [ca.vertcat(first, second, 1.0)]),
        ca.Function("output", [x, u, p], [x[:2]]),
        ca.Function("start", [u, p], [ca.DM([SPEED, 0.0, 0.0])]),
        rate_bound=ca.Function("rate", [x, p], [ca.SX(PRESS / SLIP * (1 / J1 + 1 / J2))]),
    )  # fmt: skip


def _slopes(x: Any, p: Any, sin: Callable[[Any], Any], tanh: Callable[[Any], Any]) -> tuple[Any, Any]:
    press = PRESS * tanh((x[0] - x[1]) / SLIP) * (1 + tanh((x[2] - p[0]) / WIDTH)) / 2
    return (DRIVE * sin(2 * np.pi * p[1] * x[2]) - press) / J1, (press - DAMPING * x[1]) / J2


def speeds(freq_hz: float, t2: float) -> Array:
    """(N, 2) speeds, by SciPy."""

    def slope(_: float, x: Array) -> list[float]:
        return [*_slopes(x, (t2, freq_hz), np.sin, np.tanh), 1.0]

    options = {"method": "LSODA", "rtol": 1e-10, "atol": 1e-12, "max_step": 0.01}
    found = solve_ivp(slope, (0, TIME[-1]), [SPEED, 0.0, 0.0], t_eval=TIME, **options)
    return np.asarray(found.y[:2].T)
