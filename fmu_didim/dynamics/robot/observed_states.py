"""States of effects, time and loads of a robot along a motion that was measured or is wanted, not simulated."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

import casadi as ca
import numpy as np

from fmu_didim.base.symbolic import jacobian
from fmu_didim.data.signals import Array
from fmu_didim.dynamics.robot.model import RobotModel

NO_STARTS: Mapping[str, float] = MappingProxyType({})
LARGEST_EXPONENT = 50.0
"""Largest growth of a state within a tick that is computed, as a power of e; larger ones would overflow."""


def following_links(model: RobotModel, q: Array, dq: Array, ddq: Array) -> Array:
    """(N, no) values of ``model.observed`` along a motion (N, n) of which only the links' own motion is looked at.

    Gears are taken as stiff, so that links follow their motors; all else is zero.
    """
    result = np.zeros((q.shape[0], len(model.observed)))
    for i, variable in enumerate(model.observed):
        kind, _, joint = variable.name.partition("_link")
        if joint:
            result[:, i] = {"q": q, "dq": dq, "ddq": ddq}[kind][:, int(joint) - 1]
    return result


def observed_along(
    model: RobotModel, time: Array, q: Array, dq: Array, ddq: Array, chi: Array | None = None, *,
    starts: Mapping[str, float] = NO_STARTS,
) -> Array:  # fmt: skip
    """Values (N, no) of ``model.observed`` along a motion (N, n).

    States start at their start values, see :func:`states_along`.

    Args:
        time: (N,) in s; chi: (ns,) parameters from which loads follow; loads are zero without them.
        starts: of measured states, by the names of the plant's parameters.
    """
    extra = len(model.extra) - len(model.links)
    result = following_links(model, q, dq, ddq)
    names = [v.name for v in model.extra[:extra]]
    if extra:
        n, s = model.joint_count, ca.DM(model.shape_values)
        start = np.array([
            time[0] if v.name == "clock" else starts.get(model.given.get(i, ""), v.start)
            for i, v in enumerate(model.extra[:extra])
        ])  # fmt: skip
        moved = np.column_stack([q, dq])
        result[:, :extra] = states_along(lambda z, x: model.rates(x[:n], x[n:], z, s), start, time, moved)
    if "clock" in names:
        result[:, names.index("clock")] = time
    found = [i for i, v in enumerate(model.observed) if i >= extra and v.name.startswith("load")]
    if chi is not None and found:
        loads = model.at_points("transmitted", q.T, dq.T, ddq.T, chi)
        joints = [int(model.observed[i].name.removeprefix("load")) - 1 for i in found]
        result[:, found] = loads[:, joints]
    return result


def states_along(rates: Callable[[ca.SX, ca.SX], ca.SX], start: Array, time: Array, motion: Array) -> Array:
    """States (K, nz) of effects along a motion, which is held at the middle of each tick:

        z(t + h) = z + h phi(h d) f,  f = rates(z, motion),  d = diag(df/dz),  phi(x) = (e^x - 1)/x

    Exact, and stable for any tick, where the rate of a state is affine in that state alone, as of a bristle; of first
    order where states drive each other.

    Args:
        rates: (z, row of the motion) -> dz/dt, (nz,); start: (nz,) states at the first instant.
        time: (K,) in s; motion: (K, m) what the rates depend on.

    Source: Hochbruck and Ostermann, Acta Numerica 19 (2010): the exponential Rosenbrock-Euler method.
    """
    z, held, h = ca.SX.sym("z", start.size), ca.SX.sym("held", motion.shape[1]), ca.SX.sym("h")
    rate = rates(z, held)
    x = ca.fmin(h * ca.diag(jacobian(rate, z)), LARGEST_EXPONENT)
    growth = ca.if_else(x == 0, 1, ca.expm1(x) / x)
    step = ca.Function("walk", [z, held, h], [ca.densify(z + h * growth * rate)])
    walk = step.mapaccum("walks", time.size - 1, {"base": 4})  # built in a fifth of the time of what is the default
    states = np.zeros((time.size, start.size))
    states[0] = start
    buffer, run = walk.buffer()  # on numpy's own memory: matrices of CasADi take longer to fill than to compute
    given = [
        np.ascontiguousarray(table, dtype=float) for table in (start, (motion[1:] + motion[:-1]) / 2, np.diff(time))
    ]
    for i, table in enumerate(given):
        buffer.set_arg(i, table.data)
    buffer.set_res(0, states[1:].data)
    run()
    return states
