"""The true sensitivity of the simulated torque, by finite differences of the closed loop."""

from __future__ import annotations

import numpy as np

from fmu_didim.identification.problem import Prediction, Problem, predict_torque
from fmu_didim.signals import Array

RELATIVE_STEP = 1e-5
"""Of the value at which a parameter alone would make up the whole torque, or of its own size where there is
no regressor. Simulations are smooth in the parameters, so the truncation error is of this relative order, the
rounding error 1e-11."""
DELAY_STEP = 1e-3
"""Step in the delay of the loop, in samples."""


def sensitivity(problem: Problem, theta: Array, prediction: Prediction, *, with_delay: bool = False) -> Array:
    """S = d tau_s / d theta, (N, n, p), one simulation a column; a last column for the delay on request.

    Args:
        theta: (p,) parameters; prediction: of the simulation there.
    """
    torque = prediction.torque
    steps = RELATIVE_STEP * parameter_scale(problem, theta, prediction)
    result = []
    for i in range(theta.size):
        moved = theta.copy()
        moved[i] += steps[i]
        result.append((predict_torque(problem, moved)[0] - torque) / (moved[i] - theta[i]))
    if with_delay:
        later = predict_torque(problem.with_delay(problem.delay + DELAY_STEP), theta)[0]
        result.append((later - torque) / DELAY_STEP)
    return np.stack(result, axis=2)


def parameter_scale(problem: Problem, theta: Array, prediction: Prediction) -> Array:
    """(p,) size of each parameter, never zero."""
    if prediction.regressor is not None:
        return np.asarray(np.linalg.norm(prediction.torque) / np.linalg.norm(prediction.regressor, axis=(0, 1)))
    size = np.maximum(np.abs(theta), np.abs(problem.parameters.nominal()))
    return np.where(size > 0, size, 1.0)
