"""Shared by several effects: smoothed steps, usual values, and the experiment that shows friction by speed."""

from __future__ import annotations

import math

import casadi as ca

from fmu_didim.dynamics.effects.joint import Parameter, Search, Surroundings, Values

CONSTANT_SPEEDS = (
    "Constant speeds on a logarithmic scale in both directions, the fastest more than five times the slowest."
)
USUAL_LOSS = (0.0, 0.3)
"""[1] Loss of a gear: planetary and harmonic drives lose 5 to 30 % at a rated load."""
GROWING = (0.0, math.inf)
"""Coefficients of what grows with the speed, beside viscous friction: drag that falls is the form of something else."""
smoothing_velocity = Parameter("v0", "velocity", "smoothing velocity of Coulomb friction", (0.01, 0.001))
"""The shape of :func:`direction`; all effects of a joint share it."""
instants = Search(0.0, 60.0, 121, logarithmic=False)
"""Instants of a run, s, at which something may begin or end."""


def direction(at: Surroundings, shapes: Values) -> ca.SX:
    """s(dq) = tanh(dq/v0), the smoothed sign of the velocity."""
    return ca.tanh(at.dq / shapes["v0"])


def ramp(x: ca.SX, width: ca.SX) -> ca.SX:
    """max(0, x) with a parabola for |x| < width: zero below, exact above, with a continuous slope."""
    within = ca.fmin(ca.fmax(x + width, 0), 2 * width)
    return within**2 / (4 * width) + ca.fmax(x - width, 0)


def rise(time: ca.SX, at: ca.SX, width: ca.SX) -> ca.SX:
    """A step from 0 to 1 around the instant ``at``, as wide as ``width``: (1 + tanh((t - at)/width)) / 2."""
    return (1 + ca.tanh((time - at) / width)) / 2
