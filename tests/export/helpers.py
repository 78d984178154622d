"""Blocks that the tests of the export share, and what their equations give."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from fmu_didim.data.signals import Variable
from fmu_didim.dynamics.block import Block

PERIOD = 0.005
PARAMETERS = {"J": 0.1, "Fv": 0.2, "Fc": 0.3, "k": 2.0, "q_start": 0.5, "dq_start": -0.2}


def pendulum(kind: Any = ca.SX) -> Block:
    """J ddq = tau - Fv dq - Fc tanh(dq / 0.05) - k sin q."""
    x, u, p = kind.sym("x", 2), kind.sym("u"), kind.sym("p", 6)
    inertia, viscous, coulomb, stiffness = p[0], p[1], p[2], p[3]
    ddq = (u - viscous * x[1] - coulomb * ca.tanh(x[1] / 0.05) - stiffness * ca.sin(x[0])) / inertia
    rate = (viscous + coulomb / 0.05) / inertia + ca.sqrt(stiffness / inertia)
    units = ("kg.m2", "N.m.s/rad", "N.m", "N.m", "rad", "rad/s")
    return Block(
        name="pendulum",
        inputs=(Variable("tau", "N.m", "input"),),
        outputs=(Variable("q", "rad"), Variable("dq", "rad/s"), Variable("ddq", "rad/s2")),
        states=(Variable("angle", "rad", "local"), Variable("speed", "rad/s", "local")),
        parameters=tuple(
            Variable(name, unit, "parameter", start)
            for (name, start), unit in zip(PARAMETERS.items(), units, strict=True)
        ),
        update=ca.Function("pendulum_update", [x, u, p], [ca.vertcat(x[1], ddq)]),
        output=ca.Function("pendulum_output", [x, u, p], [ca.vertcat(x, ddq)]),
        start=ca.Function("pendulum_start", [u, p], [p[4:6]]),
        rate_bound=ca.Function("pendulum_rate", [x, p], [rate]),
        fixed=frozenset({"q_start", "dq_start"}),
    )


def controller() -> Block:
    """u = Kp e - Kd (q - q_previous) / T, with e = r - q; the first difference is zero."""
    x, u, p = ca.SX.sym("x"), ca.SX.sym("u", 2), ca.SX.sym("p", 2)
    law = p[0] * (u[0] - u[1]) - p[1] * (u[1] - x) / PERIOD
    return Block(
        name="controller",
        inputs=(Variable("r", "rad", "input"), Variable("q", "rad", "input")),
        outputs=(Variable("u", "N.m"),),
        states=(Variable("q_previous", "rad", "local"),),
        parameters=(Variable("Kp", "N.m/rad", "parameter", 10.0), Variable("Kd", "N.m.s/rad", "parameter", 0.5)),
        update=ca.Function("update", [x, u, p], [u[1]]),
        output=ca.Function("output", [x, u, p], [law]),
        start=ca.Function("start", [u, p], [u[1]]),
        sample_time=PERIOD,
    )


def gain() -> Block:
    """y = K u: no state at all."""
    x, u, p = ca.SX.sym("x", 0), ca.SX.sym("u"), ca.SX.sym("p")
    return Block(
        name="gain",
        inputs=(Variable("u", "", "input"),),
        outputs=(Variable("y"),),
        states=(),
        parameters=(Variable("K", "", "parameter", 3.0),),
        update=ca.Function("update", [x, u, p], [ca.SX(0, 1)]),
        output=ca.Function("output", [x, u, p], [p * u]),
        start=ca.Function("start", [u, p], [ca.SX(0, 1)]),
    )


class Sampled:
    """The controller's law in plain Python."""

    def __init__(self, q: float) -> None:
        self.previous = q

    def output(self, r: float, q: float) -> float:
        return 10.0 * (r - q) - 0.5 * (q - self.previous) / PERIOD


def torque(time: float) -> float:
    return float(2.0 * np.sin(3.0 * time) + 0.5)


def measured(time: float) -> float:
    return float(np.cos(40.0 * time))
