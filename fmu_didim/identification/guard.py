"""What may be simulated, and what may be returned."""

from __future__ import annotations

import numpy as np

from fmu_didim.identification.problem import Problem
from fmu_didim.identification.start import reference_motion
from fmu_didim.signals import Array

FRICTION = ("Fv", "Fc")
SIGNIFICANCE = 4.0
"""A friction parameter this many standard deviations below zero is non-physical, not merely uncertain."""


def mass_matrix_problem(problem: Problem, theta: Array) -> str:
    """Why M(q) cannot be used along the reference, or an empty string."""
    if not np.isfinite(theta).all():
        return "a parameter is not a finite number"
    ticks = np.unique(np.linspace(0, problem.experiment.reference.time.size - 1, 200).astype(np.int64))
    q = reference_motion(problem.experiment.reference, problem.joint_count, ticks)[0]
    smallest = problem.model.minimum_inertia(q, problem.base.expand(theta))
    if smallest <= 1e-9:
        return f"the inertia matrix is not positive definite (smallest scaled eigenvalue {smallest:.3g})"
    return ""


def friction_problem(problem: Problem, theta: Array, deviation: Array) -> str:
    """Which friction parameters are negative beyond doubt, or an empty string."""
    found = []
    for i, standard in enumerate(problem.base.standard):
        if standard.rstrip("0123456789") in FRICTION and theta[i] < -SIGNIFICANCE * deviation[i] - 1e-12:
            found.append(f"{problem.base.names[i]} = {theta[i]:.4g} ± {deviation[i]:.2g}")
    return f"friction is negative: {', '.join(found)}" if found else ""


def physical_problem(problem: Problem, theta: Array, deviation: Array) -> str:
    """Why no machine can have these base parameters, or an empty string."""
    return mass_matrix_problem(problem, theta) or friction_problem(problem, theta, deviation)


def tracking_problem(problem: Problem, simulated: Array) -> str:
    """Whether the simulated torque explains less than nothing of the measured one, or an empty string."""
    measured = problem.measured
    error = np.linalg.norm(measured - simulated) / np.linalg.norm(measured)
    if error > 1.0:
        return f"the simulated torque is farther from the measured one than zero is ({100 * error:.0f} %)"
    return ""
