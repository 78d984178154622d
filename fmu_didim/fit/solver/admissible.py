"""Checks of values before they are simulated, and before they are returned."""

from __future__ import annotations

import numpy as np

from fmu_didim.data.signals import Array
from fmu_didim.fit.region import positions_along
from fmu_didim.model.free_parameter import DELAY
from fmu_didim.model.loop_model import LoopModel

CHECKED_POSITIONS = 200
"""[positions] Along the reference, at which the inertia matrix is checked."""
FARTHEST = 1.0
"""[1] Relative error of the torque beyond which a model is worse than zero torque."""


def mass_matrix_problem(model: LoopModel, values: Array) -> str:
    """Why the plant cannot be simulated with values (p,) along the references, or an empty string."""
    together: dict[bytes, tuple[Array, list[Array]]] = {}  # experiments in which the robot is the same
    for label in model.experiments:
        theta = model.theta(values, label)
        together.setdefault(theta.tobytes(), (theta, []))[1].append(positions_along(model, label, CHECKED_POSITIONS))
    reasons = (model.parameters.inertia_problem(np.concatenate(q), theta) for theta, q in together.values())
    return next(filter(None, reasons), "")


def physical_problem(model: LoopModel, values: Array, deviation: Array) -> str:
    """Why these values ± deviation, (p,) each, are physically impossible; an empty string if they are possible."""
    count = model.parameters.count
    at_limit = [
        f"{parameter.name} = {value:.4g}"
        for parameter, value in zip(model.free_parameters, values, strict=True)
        if value in (parameter.lowest, parameter.highest) and parameter.owner != DELAY  # none at all is an answer
    ]
    return (
        mass_matrix_problem(model, values)
        or model.parameters.physical_problem(values[:count], deviation[:count])
        or (f"at a limit given in the case: {', '.join(at_limit)}" if at_limit else "")
    )


def tracking_problem(measured: Array, simulated: Array) -> str:
    """Why the simulated torque is worse than zero torque, or an empty string."""
    error = np.linalg.norm(measured - simulated) / np.linalg.norm(measured)
    if error > FARTHEST:
        return f"the simulated torque is farther from the measured one than zero is ({100 * error:.0f} %)"
    return ""
