"""Torque of a planar arm with one or two joints, written by hand: base columns, and a check of the integrator."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

Array = np.ndarray

INERTIAL = {1: ("ZZ1R", "MX1", "MY1"), 2: ("ZZ1R", "MX1", "MY1", "ZZ2", "MX2", "MY2")}
"""Inertial parameters by number of joints."""


def rigid_torque(
    robot: Mapping[str, float], q: Array, dq: Array, ddq: Array, *, length: float = 0.0, gravity: tuple[float, float]
) -> Array:
    """Torque (N, n) of the links of an arm whose joints turn counter-clockwise.

    With A = L (MX2 cos q2 - MY2 sin q2), B = L (MX2 sin q2 + MY2 cos q2) and gravity (gx, gy) in the plane:

        g2 = gx (MX2 sin q12 + MY2 cos q12) - gy (MX2 cos q12 - MY2 sin q12),  q12 = q1 + q2
        g1 = gx (MX1 sin q1 + MY1 cos q1) - gy (MX1 cos q1 - MY1 sin q1) + g2
        tau1 = (ZZ1R + ZZ2 + 2 A) ddq1 + (ZZ2 + A) ddq2 - B (2 dq1 dq2 + dq2^2) + g1
        tau2 = (ZZ2 + A) ddq1 + ZZ2 ddq2 + B dq1^2 + g2

    Args:
        robot: parameters in kg m2 and kg m; those left out are 0.
        q, dq, ddq: (N, n), rad and its derivatives.
        length: distance of the two axes, m. gravity: in the plane, m/s2.
    """
    gx, gy = gravity
    value = {name: robot.get(name, 0.0) for name in INERTIAL[2]}
    g1 = gx * (value["MX1"] * np.sin(q[:, 0]) + value["MY1"] * np.cos(q[:, 0]))
    g1 = g1 - gy * (value["MX1"] * np.cos(q[:, 0]) - value["MY1"] * np.sin(q[:, 0]))
    if q.shape[1] == 1:
        return (value["ZZ1R"] * ddq[:, 0] + g1)[:, None]
    sine, cosine, both = np.sin(q[:, 1]), np.cos(q[:, 1]), q[:, 0] + q[:, 1]
    along = length * (value["MX2"] * cosine - value["MY2"] * sine)
    across = length * (value["MX2"] * sine + value["MY2"] * cosine)
    g2 = gx * (value["MX2"] * np.sin(both) + value["MY2"] * np.cos(both))
    g2 = g2 - gy * (value["MX2"] * np.cos(both) - value["MY2"] * np.sin(both))
    zz2 = value["ZZ2"]
    one = (value["ZZ1R"] + zz2 + 2 * along) * ddq[:, 0] + (zz2 + along) * ddq[:, 1] + g1 + g2
    one = one - across * (2 * dq[:, 0] * dq[:, 1] + dq[:, 1] ** 2)
    two = (zz2 + along) * ddq[:, 0] + zz2 * ddq[:, 1] + across * dq[:, 0] ** 2 + g2
    return np.column_stack([one, two])


def base_columns(
    q: Array, dq: Array, ddq: Array, *, length: float, gravity: tuple[float, float], smoothing: float = 1e-3
) -> Array:
    """Columns (N, n, p) of all base parameters: inertial ones, viscous and dry friction, rotor of joint 2."""
    count, n = q.shape
    columns = [
        rigid_torque({name: 1.0}, q, dq, ddq, length=length, gravity=gravity)
        for name in INERTIAL[n]
    ]  # fmt: skip
    for j in range(n):
        for values in (dq[:, j], np.tanh(dq[:, j] / smoothing)):
            column = np.zeros((count, n))
            column[:, j] = values
            columns.append(column)
    if n > 1:
        rotor = np.zeros((count, n))
        rotor[:, 1] = ddq[:, 1]
        columns.append(rotor)
    return np.stack(columns, axis=2)


def after_refit(difference: Array, columns: Array, deviation: Array) -> Array:
    """What is left of a torque difference (N, n) after base parameters absorbed what they can, in deviations."""
    scaled = (difference / deviation).reshape(-1)
    matrix = (columns / deviation[None, :, None]).reshape(scaled.size, -1)
    matrix = matrix / np.maximum(np.linalg.norm(matrix, axis=0), 1e-12)
    solution = np.linalg.lstsq(matrix, scaled, rcond=1e-10)[0]
    return (scaled - matrix @ solution).reshape(difference.shape)


def root_mean_square(values: Array) -> Array:
    """RMS of each column."""
    return np.sqrt(np.mean(values**2, axis=0))
