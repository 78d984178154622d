"""First-order change of the torque by an effect outside the torque balance, along a given motion.

Effects in the torque balance have columns; of the others only some show without a simulation of the closed loop: those
whose first-order change follows from the torque of their joint alone. The design of the next experiment compares them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from fmu_didim.data.signals import Array

STEEP = 0.01
"""Fraction of its RMS over which the torque of a joint changes its sign smoothly."""
PLAY = 0.05
"""Fraction of its RMS over which the load of a gear is handed from one flank to the other."""
TINY = 1e-12


@dataclass(frozen=True)
class JointTorque:
    """The torque of one joint along a motion, at equally spaced instants.

    Attributes:
        logged: (K,) torque that the log shows, N.m or N; load: (K,) torque that the joint transmits to its links.
        step: s between two instants.
    """

    logged: Array
    load: Array
    step: float


@dataclass(frozen=True)
class FirstOrder:
    """The change by one unit of the parameter of an effect.

    Attributes:
        changes: what changes: the torque in the log, or the position of the link against its motor.
        column: the torque of the joint -> (K,) that change.
    """

    changes: Literal["torque", "link position"]
    column: Callable[[JointTorque], Array]


def torque_rate(at: JointTorque) -> Array:
    """d torque / dt: the drive that lags by one second has to ask for it in advance."""
    return np.asarray(np.gradient(at.logged, at.step))


def torque_sign(at: JointTorque) -> Array:
    """The smoothed sign of the torque."""
    return np.asarray(np.tanh(at.logged / (STEEP * _rms(at.logged))))


def play(at: JointTorque) -> Array:
    """Half a unit against the load: the position of a link in a gear whose gap is one."""
    return np.asarray(-0.5 * np.tanh(at.load / (PLAY * _rms(at.load))))


def _rms(values: Array) -> float:
    return max(float(np.sqrt(np.mean(values**2))), TINY)
