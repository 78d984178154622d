"""The true sensitivity of the simulated torque, by finite differences of the closed loop."""

from __future__ import annotations

import numpy as np

from fmu_didim.identification.problem import Problem, predict_torque
from fmu_didim.signals import Array

RELATIVE_STEP = 1e-5
"""Of the value at which a parameter alone would make up the whole torque. Simulations are smooth in the
parameters, so the truncation error is of this relative order, the rounding error 1e-11."""
DELAY_STEP = 1e-3
"""Step in the delay of the loop, in samples."""


def sensitivity(problem: Problem, theta: Array, torque: Array, columns: Array, *, with_delay: bool = False) -> Array:
    """S = d tau_s / d theta, (N, n, b), one simulation a column; a last column for the delay on request.

    Args:
        theta: (b,) parameters; torque: (N, n) torque simulated there.
        columns: (N, n, b) regressor there, from which the step of each parameter follows.
    """
    size = np.linalg.norm(torque)
    result = []
    for i in range(theta.size):
        step = RELATIVE_STEP * size / np.linalg.norm(columns[:, :, i])
        moved = theta.copy()
        moved[i] += step
        result.append((predict_torque(problem, moved)[0] - torque) / (moved[i] - theta[i]))
    if with_delay:
        later = predict_torque(problem.with_delay(problem.delay + DELAY_STEP), theta)[0]
        result.append((later - torque) / DELAY_STEP)
    return np.stack(result, axis=2)
