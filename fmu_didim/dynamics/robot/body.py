"""Poses of frames, what a link weighs in one of them, and numbers as text."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from decimal import Decimal

import numpy as np

from fmu_didim.data.signals import Array

ORDER = (("XX", "XY", "XZ"), ("XY", "YY", "YZ"), ("XZ", "YZ", "ZZ"))
"""Names of the entries of an inertia matrix."""
MOMENTS = ("MX", "MY", "MZ")
ROUNDED = 12
"""[decimals] Of lengths and angles that are computed, in m and rad."""
ROUNDING = 1e-12
"""[1] Of the size of what a link weighs, below which an entry is what rounded sines leave of zero: the angles of files
have about so many digits, and no torque shows it."""

QUARTER = math.pi / 2
DIGITS_OF_ANGLE = 2
"""[decimals] With which an angle counts as a rounded multiple of pi/2: 1.6 may be what it says, 1.57 hardly."""


@dataclass(frozen=True)
class Body:
    """Mass in kg, first moments (3,) in kg.m and inertia (3, 3) in kg.m2 about the origin, in one frame."""

    mass: float = 0.0
    moments: Array = field(default_factory=lambda: np.zeros(3))
    inertia: Array = field(default_factory=lambda: np.zeros((3, 3)))

    def __add__(self, other: Body) -> Body:
        return Body(self.mass + other.mass, self.moments + other.moments, self.inertia + other.inertia)

    def seen_from(self, pose: Array) -> Body:
        """In the frame that has this pose (4, 4) in the present one."""
        turn, origin, m = pose[:3, :3], pose[:3, 3], self.mass
        # About the new origin: J - (2 c.o - m o.o) I + (c o' + o c') - m o o'
        c, o = self.moments, origin
        across = np.outer(c, o) + np.outer(o, c) - m * np.outer(o, o)
        moved = self.inertia - (2 * c @ o - m * o @ o) * np.eye(3) + across
        return Body(m, turn.T @ (c - m * o), turn.T @ moved @ turn)

    @property
    def without_rounding(self) -> Body:
        """The same, zero where there is nothing but rounding."""
        across = float(np.trace(self.inertia))
        # An entry of a tensor is at most its trace, a first moment c at most sqrt(m tr J): |c|^2 / m <= tr J / 2.
        along = math.sqrt(max(self.mass * across, 0.0))
        return Body(self.mass, _beyond(self.moments, along), _beyond(self.inertia, across))

    @property
    def centre(self) -> Array:
        """(3,) m, of mass."""
        return np.asarray(self.moments / self.mass)

    @property
    def at_centre(self) -> Array:
        """(3, 3) inertia about the centre of mass."""
        c = self.centre
        moved = self.inertia - self.mass * (c @ c * np.eye(3) - np.outer(c, c))
        return _beyond(moved, float(np.trace(self.inertia)))


def _beyond(values: Array, size: float) -> Array:
    """The values, zero where they are rounding of something of a size."""
    return np.where(np.abs(values) <= ROUNDING * abs(size), 0.0, values)


def inverse(pose: Array) -> Array:
    """(4, 4) of the reverse of a pose."""
    result = np.eye(4)
    result[:3, :3], result[:3, 3] = pose[:3, :3].T, -pose[:3, :3].T @ pose[:3, 3]
    return result


def turn(axis: int, angle: float) -> Array:
    """(3, 3) rotation about an axis, 0 to 2."""
    result, (i, j) = np.eye(3), [(1, 2), (2, 0), (0, 1)][axis]
    result[[i, j], [i, j]] = math.cos(angle)
    result[i, j], result[j, i] = -math.sin(angle), math.sin(angle)
    return result


def parameters_of(body: Body) -> dict[str, float]:
    """The inertial parameters of a link in its frame, those that are not zero."""
    body = body.without_rounding
    values = dict(zip(MOMENTS, body.moments, strict=True))
    values |= {ORDER[i][j]: body.inertia[i, j] for i in range(3) for j in range(i, 3)}
    return {name: float(value) for name, value in (*values.items(), ("M", body.mass)) if value}


def body_of(parameters: Mapping[str, float]) -> Body:
    """The link with these inertial parameters in its frame."""
    moments = np.array([parameters.get(name, 0.0) for name in MOMENTS])
    inertia = np.array([[parameters.get(name, 0.0) for name in row] for row in ORDER])
    return Body(parameters.get("M", 0.0), moments, inertia)


def rounded(value: float) -> float:
    """A length or an angle without what is left of products, and without a negative zero."""
    return round(float(value), ROUNDED) + 0.0


def nearest_right_angle(value: float) -> float:
    """The multiple of pi/2 that is nearest to an angle in rad."""
    return round(value / QUARTER) * QUARTER


def right_angle(value: float) -> float:
    """An angle in rad with the digits of a multiple of pi/2, rounded or cut off (1.57, -1.5708, 3.1415), as exactly
    that multiple; any other one as it is.

    No machine is built 4e-6 rad off a right angle on purpose, and parameters that act alike where axes cross at one
    seem to act each in its own way where they do not: no data tell them apart.
    """
    decimals = -int(Decimal(repr(float(value))).normalize().as_tuple().exponent)
    exact = nearest_right_angle(value)
    if exact == 0 or decimals < DIGITS_OF_ANGLE:
        return value
    cut = math.trunc(exact * 10.0**decimals) / 10.0**decimals
    return exact if value in (round(exact, decimals), cut) else value


def text_of(*values: float) -> str:
    """Numbers of an attribute, with all their digits."""
    return " ".join(repr(float(value) + 0.0) for value in values)
