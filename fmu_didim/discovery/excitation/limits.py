"""Limits of the position, speed, acceleration and torque of a motion."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fmu_didim.base.errors import InputError
from fmu_didim.data.signals import Array, Trajectory
from fmu_didim.estimators.starts.reference_start import reference_motion

WITHIN = 0.999
"""[1] Fraction of the limits of a motion that is used."""
NOTHING = 1e-12
"""[SI] Size by which is divided where there is none."""


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


@dataclass(frozen=True)
class Bounds:
    """What a motion must keep.

    Attributes:
        limits: of position, velocity and acceleration; torque: (n,) largest size, N.m or N; infinite without a limit.
        start: (n,) position at which it begins and ends, rad or m; None: anywhere.
        clearance: (C,) least of each check of the space that is looked at, m; None: none is.
    """

    limits: Limits
    torque: Array
    start: Array | None = None
    clearance: Array | None = None

    def __post_init__(self) -> None:
        if self.start is None:
            return
        outside = [
            f"joint {j + 1} at {s:g}, range {low:g} to {high:g}"
            for j, (s, low, high) in enumerate(zip(self.start, self.limits.low, self.limits.high, strict=True))
            if not low < s < high
        ]
        if outside:
            raise InputError(
                "The motion would begin outside the limits.", where="limits.start", got="; ".join(outside),
                valid="between the limits of the position", next_step="Move the start, or widen the range.",
            )  # fmt: skip

    def tightened(self, low: Array, high: Array, speed: Array, torque: Array) -> Bounds:
        """The bounds that a reference must keep so that the loop keeps these, of which these (n,) extremes and sizes
        were simulated: as much less as they were beyond."""
        own = self.limits
        limits = replace(
            own,
            low=own.low + np.maximum(own.low - low, 0.0),
            high=own.high - np.maximum(high - own.high, 0.0),
            speed=own.speed * np.minimum(1.0, own.speed / np.maximum(speed, NOTHING)),
        )
        size = self.torque * np.minimum(1.0, self.torque / np.maximum(torque, NOTHING))
        return replace(self, limits=limits, torque=np.where(np.isfinite(self.torque), size, np.inf))


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
