"""The ellipsoid of even density that has the mass, the centre and the inertia of a link.

With the principal moments I_1, I_2, I_3 about the centre of mass and the semi-axes r_1, r_2, r_3 along them

    I_1 = m (r_2^2 + r_3^2) / 5   and so on, so that   r_1^2 = 5 (I_2 + I_3 - I_1) / (2 m)

which is positive for a body, whose moments fulfil the triangle inequality. Source: Wensing, Kim, Slotine, Linear Matrix
Inequalities for Physically Consistent Inertial Parameter Identification, IEEE RA-L 3 (2018), II.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fmu_didim.data.signals import Array
from fmu_didim.dynamics.robot.body import body_of

NO_EXTENT = 1e-9
"""[1] Of the sum of the principal moments, by which a body that is flat or thin may miss the inequality: rounding."""


@dataclass(frozen=True)
class Ellipsoid:
    """In the frame of a link.

    Attributes:
        mass: kg; centre: (3,) m, of mass; axes: (3, 3) the principal axes in its columns; radii: (3,) m, along them.
    """

    mass: float
    centre: Array
    axes: Array
    radii: Array


def ellipsoid_of(parameters: Mapping[str, float]) -> Ellipsoid | str:
    """That of the inertial parameters of a link, or why there is none."""
    body = body_of(parameters)
    if not body.mass:
        return "its mass is not given"
    if not body.mass > 0:
        return f"its mass is {body.mass:.4g} kg"
    moments, axes = np.linalg.eigh(body.at_centre)
    squares = 5 * (moments.sum() - 2 * moments) / (2 * body.mass)
    slack = 5 * NO_EXTENT * np.abs(moments).sum() / body.mass
    if not moments.any():
        return "its inertia is not given, or all of its mass is in one point"
    if (squares < -slack).any():
        text = ", ".join(f"{moment:.4g}" for moment in moments)
        return f"no body has its principal moments of inertia {text} kg.m2: one is larger than the others together"
    return Ellipsoid(body.mass, body.centre, np.asarray(axes), np.sqrt(np.maximum(squares, 0.0)))
