"""Smoothed steps that several effects share."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from fmu_didim.effects.base import UNITS, JointType, Surroundings
from fmu_didim.signals import Variable


def smoothing_velocity(joint_type: JointType) -> Variable:
    """The shape ``v0`` of :func:`direction`; all effects of a joint share it."""
    value = 0.01 if joint_type == "revolute" else 0.001
    return Variable("v0", UNITS[joint_type].velocity, "parameter", value, "smoothing velocity of Coulomb friction")


def direction(at: Surroundings, shapes: Mapping[str, ca.SX]) -> ca.SX:
    """s(dq) = tanh(dq/v0), the smoothed sign of the velocity."""
    return ca.tanh(at.dq / shapes["v0"])


def ramp(x: ca.SX, width: ca.SX) -> ca.SX:
    """max(0, x) with a parabola for |x| < width: zero below, exact above, with a continuous slope."""
    within = ca.fmin(ca.fmax(x + width, 0), 2 * width)
    return within**2 / (4 * width) + ca.fmax(x - width, 0)


def rise(time: ca.SX, at: ca.SX, width: ca.SX) -> ca.SX:
    """A step from 0 to 1 around the instant ``at``, as wide as ``width``: (1 + tanh((t - at)/width)) / 2."""
    return (1 + ca.tanh((time - at) / width)) / 2
