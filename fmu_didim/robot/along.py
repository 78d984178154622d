"""States of effects, time and loads of a robot along a motion that was measured or is wanted, not simulated."""

from __future__ import annotations

import casadi as ca
import numpy as np

from fmu_didim.robot.model import RobotModel
from fmu_didim.signals import Array

RESOLUTION = 1.0
"""Product of substep and fastest rate of the states; RK4 is stable to 2.78."""
MOST_SUBSTEPS = 1024


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


def observed_along(model: RobotModel, time: Array, q: Array, dq: Array, ddq: Array, chi: Array | None = None) -> Array:
    """Values (N, no) of ``model.observed`` along a motion (N, n).

    States start at their start values and are integrated by RK4 with the motion interpolated linearly.

    Args:
        time: (N,) in s; chi: (ns,) parameters from which loads follow; loads are zero without them.
    """
    count, extra = time.size, len(model.extra) - len(model.links)
    result = following_links(model, q, dq, ddq)
    names = [v.name for v in model.extra[:extra]]
    states = [i for i, name in enumerate(names) if name != "clock"]
    if states:
        result[:, :extra] = _integrated(model, time, q, dq)
    if "clock" in names:
        result[:, names.index("clock")] = time
    found = [i for i, v in enumerate(model.observed) if i >= extra and v.name.startswith("load")]
    if chi is not None and found:
        loads = model.transmitted(q.T, dq.T, ddq.T, np.repeat(chi[:, None], count, axis=1)).full().T
        joints = [int(model.observed[i].name.removeprefix("load")) - 1 for i in found]
        result[:, found] = loads[:, joints]
    return result


def _integrated(model: RobotModel, time: Array, q: Array, dq: Array) -> Array:
    n, s, h = model.joint_count, ca.DM(model.shape_values), np.diff(time)
    first = np.array([time[0] if v.name == "clock" else v.start for v in model.extra if v not in model.links])
    e = ca.SX.sym("e", first.size)
    begin, end, length = ca.SX.sym("begin", 2 * n), ca.SX.sym("end", 2 * n), ca.SX.sym("h")
    # The rate at which a state forgets, met along the motion.
    slope = ca.Function("slope", [begin, e], [ca.norm_inf(ca.jacobian(model.rates(begin[:n], begin[n:], e, s), e))])
    motion = np.column_stack([q, dq]).T
    fastest = float(slope(motion, np.repeat(first[:, None], time.size, axis=1)).full().max())
    steps = int(np.clip(np.ceil(fastest * h.max() / RESOLUTION), 1, MOST_SUBSTEPS))

    def rate(state: ca.SX, part: float) -> ca.SX:
        here = begin + part * (end - begin)
        return model.rates(here[:n], here[n:], state, s)

    state = e
    for k in range(steps):
        at, half, until = k / steps, (k + 0.5) / steps, (k + 1) / steps
        k1 = rate(state, at)
        k2 = rate(state + length / steps / 2 * k1, half)
        k3 = rate(state + length / steps / 2 * k2, half)
        k4 = rate(state + length / steps * k3, until)
        state = state + length / steps / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    walk = ca.Function("walk", [e, begin, end, length], [state]).mapaccum(h.size)
    after = walk(first, motion[:, :-1], motion[:, 1:], h[None, :]).full().T
    return np.vstack([first, after])
