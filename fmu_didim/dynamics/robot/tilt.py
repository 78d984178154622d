"""Gravity in the frame of the base."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca
import numpy as np

from fmu_didim.data.signals import Array
from fmu_didim.dynamics.robot.description import RobotDescription


def gravity_vector(robot: RobotDescription, shapes: Mapping[str, ca.SX]) -> ca.SX:
    """g (3,) in m/s2: that of the description, or R(h_x, tilt_x) R(h_y, tilt_y) g where the base is tilted.

    Args:
        shapes: by name with the joint number (``tilt_x_1``).
    """
    g = ca.SX(robot.gravity)
    if "tilt_x_1" not in shapes:
        return g
    first, second = horizontal_axes(np.array(robot.gravity))
    return _turned(_turned(g, second, shapes["tilt_y_1"]), first, shapes["tilt_x_1"])


def horizontal_axes(gravity: Array) -> tuple[Array, Array]:
    """The two horizontal axes (3,) about which a base tilts; x and y where gravity acts along z.

    The first is the axis of the base that is closest to horizontal, laid into the horizontal plane; for an arm that
    moves in a vertical plane it is perpendicular to that plane.
    """
    size = float(np.linalg.norm(gravity))
    if size == 0:
        return np.eye(3)[0], np.eye(3)[1]
    down = gravity / size
    axis = np.eye(3)[int(np.argmin(np.round(np.abs(down), 9)))]
    first = axis - (axis @ down) * down
    first /= np.linalg.norm(first)
    second = np.cross(first, down)
    return first, second * np.sign(second[int(np.argmax(np.abs(second)))])


def _turned(vector: ca.SX, axis: Array, angle: ca.SX) -> ca.SX:
    """``vector`` turned about an axis of unit length by Rodrigues' formula."""
    a = ca.DM(axis)
    return vector * ca.cos(angle) + ca.cross(a, vector) * ca.sin(angle) + a * ca.dot(a, vector) * (1 - ca.cos(angle))
