"""Weights of the joints: each is divided by the standard deviation of its torque noise."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from fmu_didim.prediction import thresholds as limits
from fmu_didim.prediction.loop_model import LoopModel
from fmu_didim.prediction.noise import TINY, Noise
from fmu_didim.signals import Array
from fmu_didim.statistics import LeastSquares, least_squares, noise_deviation


def noise_floor(measured: Array) -> Array:
    """(n,) deviation below which a residual is rounding, so that noise-free data have weights too."""
    return np.asarray(limits.NOISE_FLOOR * np.sqrt((measured**2).mean(axis=0)) + TINY)


def whitened(values: Array, deviation: Array) -> Array:
    """(N, n, ...) values divided by (n,) deviations, rows stacked to (N n, ...)."""
    shape = (1, -1) + (1,) * (values.ndim - 2)
    return np.asarray((values / deviation.reshape(shape)).reshape(-1, *values.shape[2:]))


class Weighting(ABC):
    """How the samples of a joint count in a fit."""

    @abstractmethod
    def deviation(self, residual: Array, columns: Array) -> Array:
        """(n,) deviations to divide by, for a residual (N, n) left by columns (N, n, p)."""

    @abstractmethod
    def noise(self, deviation: Array) -> Noise:
        """The noise of the data that these deviations (n,) stand for."""


@dataclass(frozen=True)
class KnownNoise(Weighting):
    """The noise is known: sigma / sqrt(f) with the part f of the samples that count as independent."""

    known: Noise

    def deviation(self, residual: Array, columns: Array) -> Array:
        return np.asarray(1 / self.known.weight)

    def noise(self, deviation: Array) -> Noise:
        return self.known


@dataclass(frozen=True)
class NoiseOfResidual(Weighting):
    """The deviations that a model states, or that the residual of the fit shows: anew at every step, so that the
    minimum does not depend on where the steps began."""

    model: LoopModel

    def deviation(self, residual: Array, columns: Array) -> Array:
        return joint_deviation(self.model, residual, columns)

    def noise(self, deviation: Array) -> Noise:
        return Noise(deviation, np.zeros(deviation.size), "residual")


def joint_deviation(model: LoopModel, residual: Array, columns: Array) -> Array:
    """(n,) deviations to weight with, from a residual (N, n) left by columns (N, n, p)."""
    if model.torque_deviation is not None:
        return model.torque_deviation
    floor = noise_floor(model.measured)
    if model.joint_weights == "equal":
        return np.full(residual.shape[1], max(float(np.sqrt((residual**2).mean())), float(floor.max())))
    deviation = noise_deviation(residual, np.zeros_like(residual), floor=floor)
    scaled = whitened(columns, deviation)
    names = model.names[: columns.shape[2]]
    leverage = least_squares(scaled, np.zeros(scaled.shape[0]), names=names).leverage.reshape(residual.shape)
    return noise_deviation(residual, leverage, floor=floor)


def weighted_solution(
    model: LoopModel, columns: Array, target: Array, names: tuple[str, ...]
) -> tuple[LeastSquares, Array]:
    """Least squares of target (N, n) on columns (N, n, p), joints weighted; and the deviations (n,) used.

    With estimated weights a first, unweighted solution gives the noise of each joint.

    Args:
        names: (p,) of the columns, for error messages.
    """
    deviation = np.ones(target.shape[1])
    if model.torque_deviation is not None:
        deviation = model.torque_deviation
    elif model.joint_weights == "estimated" and target.shape[1] > 1:
        # Twice: the first residual comes from weights that ignore the noise.
        for _ in range(2):
            first = least_squares(whitened(columns, deviation), whitened(target, deviation), names=names)
            residual = target - columns @ first.solution
            deviation = joint_deviation(model, residual, columns)
    return least_squares(whitened(columns, deviation), whitened(target, deviation), names=names), deviation
