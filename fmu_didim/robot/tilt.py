"""Gravity in the frame of the base."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from fmu_didim.robot.description import RobotDescription


def gravity_vector(robot: RobotDescription, shapes: Mapping[str, ca.SX]) -> ca.SX:
    """g (3,) in m/s2: that of the description, or Rx(tilt_x) Ry(tilt_y) g where the base is tilted.

    Args:
        shapes: by name with the joint number (``tilt_x_1``).
    """
    g = ca.SX(robot.gravity)
    if "tilt_x_1" not in shapes:
        return g
    cx, sx = ca.cos(shapes["tilt_x_1"]), ca.sin(shapes["tilt_x_1"])
    cy, sy = ca.cos(shapes["tilt_y_1"]), ca.sin(shapes["tilt_y_1"])
    about_y = ca.vertcat(cy * g[0] + sy * g[2], g[1], cy * g[2] - sy * g[0])
    return ca.vertcat(about_y[0], cx * about_y[1] - sx * about_y[2], sx * about_y[1] + cx * about_y[2])
