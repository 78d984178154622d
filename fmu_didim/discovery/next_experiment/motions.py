"""Straight moves of all joints with smooth speed within limits, one after another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmu_didim.data.signals import Array, Trajectory, trajectory
from fmu_didim.discovery.excitation.limits import WITHIN, Limits

QUINTIC_SPEED, QUINTIC_ACCELERATION = 1.875, 10 / np.sqrt(3)
"""Largest derivatives of 10 s^3 - 15 s^4 + 6 s^5."""
BLEND_ACCELERATION = 1.5
"""Largest slope of the smooth step 3 s^2 - 2 s^3."""


@dataclass(frozen=True)
class Space:
    """The frame of candidates.

    Attributes:
        step: control period, s; lengths: (n,) small amplitude that matters, as of presliding; NaN if unknown.
    """

    limits: Limits
    duration_s: float
    step: float
    lengths: Array


@dataclass(frozen=True)
class Leg:
    """A straight move of all joints to ``target`` (n,) and a rest.

    Attributes:
        move_s, dwell_s: durations of move and rest; blend_s: 0 for a quintic polynomial, else of the smooth changes of
            speed at both ends of a move at constant speed.
    """

    target: Array
    move_s: float
    dwell_s: float = 0.0
    blend_s: float = 0.0


def straight(
    space: Space, position: Array, target: Array, pace: float, *, dwell_s: float = 0.0, ramp: bool = False
) -> Leg:
    """The quickest move within the limits at the fraction ``pace`` of the speed."""
    way, speed = np.abs(target - position), WITHIN * pace * space.limits.speed
    acceleration = WITHIN * space.limits.acceleration
    if not ramp:
        move = max(
            float((QUINTIC_SPEED * way / speed).max()), float(np.sqrt(QUINTIC_ACCELERATION * way / acceleration).max())
        )
        return Leg(target, max(move, space.step), dwell_s)
    cruise = max(float((way / speed).max()), float(np.sqrt(BLEND_ACCELERATION * way / acceleration).max()), space.step)
    blend = min(max(float((BLEND_ACCELERATION * way / acceleration).max()) / cruise, 2 * space.step), cruise)
    return Leg(target, cruise + blend, dwell_s, blend)


def sampled(start: Array, legs: list[Leg], space: Space) -> Trajectory:
    """Legs one after another at the control rate, then rest for the remaining time."""
    time = np.arange(round(space.duration_s / space.step) + 1) * space.step
    q = np.tile(legs[-1].target if legs else start, (time.size, 1))
    dq, ddq = np.zeros_like(q), np.zeros_like(q)
    position, begin = start, 0.0
    for leg in legs:
        end = begin + leg.move_s + leg.dwell_s
        inside = (time >= begin - 1e-9) & (time < end - 1e-9)
        s, first, second = _profile(np.clip(time[inside] - begin, 0.0, leg.move_s), leg)
        way = leg.target - position
        q[inside] = position + s[:, None] * way
        dq[inside], ddq[inside] = first[:, None] * way, second[:, None] * way
        position, begin = leg.target, end
    parts: dict[str, Array] = {"q": q, "dq": dq, "ddq": ddq}
    return trajectory(
        np.asarray(time, dtype=float), {f"{k}{j + 1}": v[:, j] for j in range(start.size) for k, v in parts.items()}
    )


def _profile(t: Array, leg: Leg) -> tuple[Array, Array, Array]:
    """Position along the way from 0 to 1, and its two derivatives."""
    if leg.blend_s == 0:
        s, length = t / leg.move_s, leg.move_s
        first, second = 30 * s**2 * (1 - s) ** 2, 60 * s * (1 - s) * (1 - 2 * s)
        return s**3 * (10 - 15 * s + 6 * s**2), first / length, second / length**2
    cruise, b = leg.move_s - leg.blend_s, leg.blend_s
    # The speed rises by a smooth step, holds, and falls as it rose.
    x, y = np.clip(t / b, 0, 1), np.clip((leg.move_s - t) / b, 0, 1)
    up, down = x**2 * (3 - 2 * x), y**2 * (3 - 2 * y)
    place = b * (x**3 - x**4 / 2) + np.clip(t - b, 0, None) - (np.clip(1 - y, 0, 1) * b - b * (0.5 - y**3 + y**4 / 2))
    slope = 6 * (x * (1 - x) - y * (1 - y)) / b
    return place / cruise, np.minimum(up, down) / cruise, slope / cruise
