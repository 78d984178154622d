"""What may be simulated, and what may be returned."""

from __future__ import annotations

import numpy as np

from fmu_didim.prediction.problem import Problem
from fmu_didim.signals import Array

CHECKED_POSITIONS = 200
"""Positions along the reference at which the inertia matrix is checked."""


def mass_matrix_problem(problem: Problem, theta: Array) -> str:
    """Why the plant cannot be simulated with theta along the reference, or an empty string."""
    reference = problem.experiment.reference
    names = [f"q{j}" for j in range(1, problem.joint_count + 1)]
    if not set(names) <= set(reference.names):
        return problem.parameters.inertia_problem(np.zeros((1, problem.joint_count)), theta)
    ticks = np.unique(np.linspace(0, reference.time.size - 1, CHECKED_POSITIONS).astype(np.int64))
    return problem.parameters.inertia_problem(reference.select(names)[ticks], theta)


def physical_problem(problem: Problem, theta: Array, deviation: Array) -> str:
    """Why no machine can have these parameters, or an empty string."""
    return mass_matrix_problem(problem, theta) or problem.parameters.physical_problem(theta, deviation)


def tracking_problem(problem: Problem, simulated: Array) -> str:
    """Whether the simulated torque explains less than nothing of the measured one, or an empty string."""
    measured = problem.measured
    error = np.linalg.norm(measured - simulated) / np.linalg.norm(measured)
    if error > 1.0:
        return f"the simulated torque is farther from the measured one than zero is ({100 * error:.0f} %)"
    return ""
