"""Parameters from the reference trajectory alone: the motion is taken for the one that was wanted."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from fmu_didim.prediction.problem import Problem, sampled_regressor
from fmu_didim.signals import Array, Trajectory
from fmu_didim.statistics import least_squares


def from_reference(problem: Problem) -> Array:
    """Least squares of the measured torque on the regressor of the reference motion.

    Needs no initial values at all: a controller that tracks well makes q = q_ref nearly true.
    """
    reference, ticks = problem.experiment.reference, problem.experiment.operator.ticks
    whole = reference_motion(reference, problem.joint_count, np.arange(reference.time.size))
    q, dq, ddq = (values[ticks] for values in whole)

    def rows(observed: Array) -> tuple[Array, Array]:
        return sampled_regressor(problem, q, dq, ddq, observed[ticks])

    columns, known = rows(observed_on(problem, reference.time, whole, problem.measured, rows))
    count = problem.parameters.count
    target = (problem.measured - known).reshape(-1)
    return least_squares(columns.reshape(-1, count), target, names=problem.parameters.names).solution


def observed_on(
    problem: Problem,
    time: Array,
    motion: tuple[Array, Array, Array],
    torque: Array,
    rows: Callable[[Array], tuple[Array, Array]],
) -> Array:
    """What the regressor depends on beyond a motion that was not simulated, (K, no).

    Loads follow from a least squares fit without the effects that depend on them.

    Args:
        time: (K,) in s; motion: q, dq, ddq, (K, n) each.
        torque: (N, n) measured; rows: regressor (N, n, p) and known torque (N, n) at its samples for observed (K, no).
    """
    parameters = problem.parameters
    observed = parameters.observed_along(time, *motion)
    if not parameters.observes_load:
        return observed
    columns, known = rows(observed)
    flat = columns.reshape(-1, parameters.count)
    # Without loads the columns of those effects are zero.
    kept = np.flatnonzero(np.abs(flat).max(axis=0))
    theta = np.zeros(parameters.count)
    names = tuple(parameters.names[i] for i in kept)
    theta[kept] = least_squares(flat[:, kept], (torque - known).reshape(-1), names=names).solution
    return parameters.observed_along(time, *motion, theta)


def reference_motion(reference: Trajectory, joint_count: int, ticks: NDArray[np.int64]) -> tuple[Array, Array, Array]:
    """q, dq, ddq of the reference at the ticks, (K, n) each; derivatives by cubic spline where not given."""
    joints = range(1, joint_count + 1)
    q = reference.select([f"q{j}" for j in joints])
    given = set(reference.names)
    has_velocity = all(f"dq{j}" in given for j in joints)
    dq = (
        reference.select([f"dq{j}" for j in joints])
        if has_velocity
        else CubicSpline(reference.time, q)(reference.time, 1)
    )
    if all(f"ddq{j}" in given for j in joints):
        ddq = reference.select([f"ddq{j}" for j in joints])
    else:
        ddq = CubicSpline(reference.time, dq)(reference.time, 1)
    return q[ticks], np.asarray(dq)[ticks], np.asarray(ddq)[ticks]
