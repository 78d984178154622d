"""Limits of the position, speed and acceleration of a motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmu_didim.base.errors import InputError
from fmu_didim.data.signals import Array, Trajectory
from fmu_didim.estimators.starts.reference_start import reference_motion

WITHIN = 0.999
"""[1] Fraction of the limits of a motion that is used."""


@dataclass(frozen=True)
class Limits:
    """Limits (n,) of the position, speed and acceleration of each joint, SI units."""

    low: Array
    high: Array
    speed: Array
    acceleration: Array

    def __post_init__(self) -> None:
        tables = [self.high - self.low, self.speed, self.acceleration]
        if not all(np.isfinite(t).all() and (t > 0).all() for t in tables):
            raise InputError(
                "The limits of a motion leave no room.", where="limits",
                got=f"range {tables[0]}, speed {tables[1]}, acceleration {tables[2]}", valid="finite and > 0",
                next_step="Give the limits of the joints, or a reference in which every joint moves.",
            )  # fmt: skip

    def keeps(self, motion: Trajectory) -> bool:
        """Whether a motion stays within the limits."""
        q, dq, ddq = reference_motion(motion, self.low.size)
        inside = (q >= self.low).all() and (q <= self.high).all()
        return bool(inside and (np.abs(dq) <= self.speed).all() and (np.abs(ddq) <= self.acceleration).all())


def limits_of(
    reference: Trajectory, joints: int, *, position_scale: float = 1.0, speed_scale: float = 1.0,
    acceleration_scale: float = 1.0,
) -> Limits:  # fmt: skip
    """The limits that a reference uses, each scaled; the range about its middle.

    Raises:
        InputError: a joint does not move.
    """
    q, dq, ddq = reference_motion(reference, joints)
    middle, half = (q.max(axis=0) + q.min(axis=0)) / 2, np.ptp(q, axis=0) / 2 * position_scale
    speed, acceleration = np.abs(dq).max(axis=0) * speed_scale, np.abs(ddq).max(axis=0) * acceleration_scale
    return Limits(middle - half, middle + half, speed, acceleration)
