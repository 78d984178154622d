"""Causes that would explain a difference between the torque of a plant and of the robot description."""

from __future__ import annotations

import numpy as np

from fmu_didim.data.signals import Array
from fmu_didim.dynamics.robot import RobotModel
from fmu_didim.fit.base_projection import DEPENDENT
from fmu_didim.model.parameters import Parameters, RobotParameters

EXPLAINED = 0.05
"""[1] A cause is named if it leaves less than this fraction of the difference."""
SHOWN_GRAVITY = 1e-6
"""[1] Components of gravity below this fraction of the largest are shown as zero: rounding."""


def unlike_torque(
    parameters: Parameters, theta: Array, motion: tuple[Array, Array, Array], observed: Array, difference: Array
) -> list[str]:
    """Single causes that explain a difference of the torque: gravity, or one parameter that is not identified.

    Args:
        theta: (p,) values; motion: q, dq, ddq (K, n); observed: (K, no); difference: plant minus description, (K, n).
    """
    if not isinstance(parameters, RobotParameters):
        return []
    chi = parameters.base.expand(theta)
    found = []
    gravity = _gravity_columns(parameters.model, chi, motion[0])
    change, left = _fit(gravity, difference)
    if left < EXPLAINED:
        own = np.array(parameters.model.description.gravity)
        total = own + change
        shown = np.abs(total) > SHOWN_GRAVITY * np.abs(total).max()
        values = ", ".join(f"{v + 0.0:.4g}" for v in np.where(shown, total, 0.0))  # not -0
        found.append(f"gravity: ({values}) m/s2 in the plant would explain the torque")
    rows = parameters.model.regressor_rows(*motion, observed=observed)
    for i in (i for i in parameters.model.active if i not in parameters.base.index):
        change, left = _fit(rows[:, :, [i]], difference)
        if left < EXPLAINED:
            name = parameters.base.standard_names[i]
            found.append(f"{name}: {chi[i] + change[0]:.4g} instead of {chi[i]:.4g} would explain the torque")
    return found


def _fit(columns: Array, difference: Array) -> tuple[Array, float]:
    """Least squares of the difference, and the fraction of it that is left."""
    flat, target = columns.reshape(-1, columns.shape[2]), difference.reshape(-1)
    if not np.abs(flat).any():
        return np.zeros(columns.shape[2]), 1.0
    solution: Array = np.linalg.lstsq(flat, target, rcond=DEPENDENT)[0].astype(float)
    return solution, float(np.linalg.norm(target - flat @ solution) / np.linalg.norm(target))


def _gravity_columns(model: RobotModel, chi: Array, q: Array) -> Array:
    """Torque at rest of unit gravity along each axis, (K, n, 3)."""

    def at_rest(gravity: tuple[float, float, float]) -> Array:
        turned = model.like(model.description.model_copy(update={"gravity": gravity}))
        still = np.zeros_like(q)
        return np.asarray(turned.regressor_rows(q, still, still) @ chi)

    none = at_rest((0.0, 0.0, 0.0))
    axes = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    return np.stack([at_rest(axis) - none for axis in axes], axis=2)
