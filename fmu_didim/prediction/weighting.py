"""Weights of the joints: each is divided by the standard deviation of its torque noise."""

from __future__ import annotations

import numpy as np

from fmu_didim.prediction.problem import Problem
from fmu_didim.signals import Array
from fmu_didim.statistics import LeastSquares, least_squares, noise_deviation


def noise_floor(measured: Array) -> Array:
    """(n,) deviation below which a residual is rounding, so that noise-free data have weights too."""
    return np.asarray(1e-12 * np.sqrt((measured**2).mean(axis=0)) + 1e-300)


def whitened(values: Array, deviation: Array) -> Array:
    """(N, n, ...) values divided by (n,) deviations, rows stacked to (N n, ...)."""
    shape = (1, -1) + (1,) * (values.ndim - 2)
    return np.asarray((values / deviation.reshape(shape)).reshape(-1, *values.shape[2:]))


def joint_deviation(problem: Problem, residual: Array, columns: Array) -> Array:
    """(n,) deviations to weight with, from a residual (N, n) left by columns (N, n, p)."""
    measured = problem.measured
    if problem.torque_deviation is not None:
        return problem.torque_deviation
    if problem.joint_weights == "equal":
        return np.full(measured.shape[1], max(float(np.sqrt((residual**2).mean())), float(noise_floor(measured).max())))
    deviation = noise_deviation(residual, np.zeros_like(residual), floor=noise_floor(measured))
    scaled = whitened(columns, deviation)
    leverage = least_squares(scaled, np.zeros(scaled.shape[0])).leverage.reshape(residual.shape)
    return noise_deviation(residual, leverage, floor=noise_floor(measured))


def weighted_solution(problem: Problem, columns: Array, target: Array) -> tuple[LeastSquares, Array]:
    """Least squares of target (N, n) on columns (N, n, p), joints weighted; and the deviations (n,) used.

    With estimated weights a first, unweighted solution gives the noise of each joint.
    """
    names = problem.parameters.names
    deviation = np.ones(target.shape[1])
    if problem.torque_deviation is not None:
        deviation = problem.torque_deviation
    elif problem.joint_weights == "estimated" and target.shape[1] > 1:
        # Twice: the first residual comes from weights that ignore the noise.
        for _ in range(2):
            first = least_squares(whitened(columns, deviation), whitened(target, deviation), names=names)
            residual = target - columns @ first.solution
            deviation = joint_deviation(problem, residual, columns)
    return least_squares(whitened(columns, deviation), whitened(target, deviation), names=names), deviation
