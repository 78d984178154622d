"""Weights of the joints: each is divided by the standard deviation of its torque noise."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from fmu_didim.base.errors import IdentificationError
from fmu_didim.data.signals import Array
from fmu_didim.fit.noise.noise import TINY, Noise
from fmu_didim.fit.statistics import LeastSquares, deviation_of_sums, least_squares
from fmu_didim.model.loop_model import LoopModel

NOISE_FLOOR = 1e-12
"""[1] Fraction of the torque below which a residual is rounding, so that data without noise have weights, too."""


def noise_floor(measured: Array) -> Array:
    """(n,) deviation below which a residual is rounding, so that noise-free data have weights too."""
    return np.asarray(NOISE_FLOOR * np.sqrt((measured**2).mean(axis=0)) + TINY)


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


@dataclass(frozen=True)
class JointTriangles:
    """A linear least squares problem brought to a triangle a joint by QR: all that its weights need, whatever they are.

    Attributes:
        triangles: [columns, target] of each joint, (min(N, p + 1), p + 1).
        samples: N.
    """

    triangles: tuple[Array, ...]
    samples: int

    @staticmethod
    def of(columns: Array, target: Array) -> JointTriangles:
        """From columns (N, n, p) and a target (N, n)."""
        both = np.concatenate([columns, target[:, :, None]], axis=2)
        if not np.isfinite(both).all():
            raise IdentificationError("The least squares problem holds values that are not finite.")
        triangles = (np.asarray(np.linalg.qr(both[:, j], mode="r")) for j in range(both.shape[1]))
        return JointTriangles(tuple(triangles), both.shape[0])

    def squares(self, solution: Array) -> Array:
        """(n,) sums of the squares of what a solution (p,) leaves of the target at each joint."""
        return np.array([np.sum((t[:, -1] - t[:, :-1] @ solution) ** 2) for t in self.triangles])

    def solved(self, deviation: Array, names: tuple[str, ...]) -> tuple[Array, Array]:
        """Solution (p,) with the joints divided by deviations (n,), and the sums (n,) of the leverages of their rows.

        Raises:
            IdentificationError: as of :func:`~fmu_didim.fit.statistics.least_squares`.
        """
        rows = np.vstack([t / d for t, d in zip(self.triangles, deviation, strict=True)])
        found = least_squares(rows[:, :-1], rows[:, -1], names=names)
        first = np.cumsum([0, *(t.shape[0] for t in self.triangles[:-1])])
        return found.solution, np.add.reduceat(found.leverage, first)

    def deviation(self, squares: Array, floor: Array, names: tuple[str, ...]) -> Array:
        """(n,) estimated deviations, at least ``floor``, where the residual has these sums of squares (n,)."""
        first = deviation_of_sums(squares, np.full(squares.size, float(self.samples)), floor=floor)
        return deviation_of_sums(squares, self.samples - self.solved(first, names)[1], floor=floor)


def joint_deviation(model: LoopModel, residual: Array, columns: Array) -> Array:
    """(n,) deviations to weight with, from a residual (N, n) left by columns (N, n, p)."""
    if model.torque_deviation is not None:
        return model.torque_deviation
    floor = noise_floor(model.measured)
    if model.joint_weights == "equal":
        whole = float(np.sqrt((residual**2).mean()))
        return np.full(residual.shape[1], max(whole, float(floor.max())))
    names = model.names[: columns.shape[2]]
    return JointTriangles.of(columns, residual).deviation((residual**2).sum(axis=0), floor, names)


def weighted_solution(model: LoopModel, columns: Array, target: Array) -> tuple[LeastSquares, Array]:
    """Least squares of target (N, n) on columns (N, n, p), those of the first p free parameters, joints weighted; and
    the deviations (n,) used.

    With estimated weights a first, unweighted solution gives the noise of each joint.
    """
    names, deviation = model.names[: columns.shape[2]], np.ones(target.shape[1])
    if model.torque_deviation is not None:
        deviation = model.torque_deviation
    elif model.joint_weights == "estimated" and target.shape[1] > 1:
        triangles, floor = JointTriangles.of(columns, target), noise_floor(model.measured)
        # Twice: the first residual comes from weights that ignore the noise.
        for _ in range(2):
            first, _ = triangles.solved(deviation, names)
            deviation = triangles.deviation(triangles.squares(first), floor, names)
    return least_squares(whitened(columns, deviation), whitened(target, deviation), names=names), deviation
