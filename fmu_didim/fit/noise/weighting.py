"""Weights of the outputs, the torques of the joints first: each is divided by the standard deviation of its noise.

A channel beside the torque whose residual has a colour is known from fewer samples than it has: it is divided by its
deviation times an inflation beside that of the torque, so that slow model error in a precise encoder does not decide.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from fmu_didim.base.errors import IdentificationError
from fmu_didim.base.tall import in_blocks, triangle_by_parts
from fmu_didim.data.signals import Array
from fmu_didim.fit.confounding import least_squares_of_shown
from fmu_didim.fit.noise.noise import TINY, Noise
from fmu_didim.fit.statistics import LeastSquares, deviation_of_sums, least_squares
from fmu_didim.model.loop_model import LoopModel

NOISE_FLOOR = 1e-12
"""[1] Fraction of the torque below which a residual is rounding, so that data without noise have weights, too."""


def noise_floor(measured: Array, counts: Array | None = None) -> Array:
    """(m,) deviation below which a residual is rounding, so that noise-free data have weights too.

    Args:
        measured: (M, m); counts: (m,) samples of each output; by default all rows are.
    """
    sums = (measured**2).sum(axis=0)
    least = TINY if sums.any() else NOISE_FLOOR  # of a log without any torque, whose squared weights are numbers
    return np.asarray(NOISE_FLOOR * np.sqrt(sums / (measured.shape[0] if counts is None else counts)) + least)


def whitened(values: Array, deviation: Array) -> Array:
    """(N, n, ...) values divided by (n,) deviations, rows stacked to (N n, ...)."""
    shape = (1, -1) + (1,) * (values.ndim - 2)
    return np.asarray((values / deviation.reshape(shape)).reshape(-1, *values.shape[2:]))


class Weighting(ABC):
    """How the samples of an output count in a fit."""

    @abstractmethod
    def deviation(self, residual: Array, columns: Array) -> Array:
        """(m,) deviations to divide by, for a residual (M, m) left by columns (M, m, p)."""

    @abstractmethod
    def noise(self, deviation: Array) -> Noise:
        """The noise of the data that these deviations (m,) stand for."""


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
    minimum does not depend on where the steps began.

    Attributes:
        model: whose outputs; inflation: (m,) by which noise with a colour is larger than it seems, see above; one.
    """

    model: LoopModel
    inflation: Array | None = None

    def deviation(self, residual: Array, columns: Array) -> Array:
        found = output_deviation(self.model, residual, columns)
        return found if self.inflation is None else found * self.inflation

    def noise(self, deviation: Array) -> Noise:
        if self.inflation is None:
            return Noise(deviation, np.zeros(deviation.size), "residual")
        square = self.inflation**2
        return Noise(deviation / self.inflation, (square - 1) / (square + 1), "residual")


@dataclass(frozen=True)
class OutputTriangles:
    """A linear least squares problem brought to a triangle an output by QR: all that its weights need, whatever they
    are.

    Attributes:
        triangles: [columns, target] of each output, (min(M, p + 1), p + 1).
        samples: (m,) of each; partial: whether columns may depend on each other, because a prior tells apart what they
            do not.
    """

    triangles: tuple[Array, ...]
    samples: Array
    partial: bool = False

    @staticmethod
    def of(columns: Array, target: Array, counts: Array | None = None, *, partial: bool = False) -> OutputTriangles:
        """From columns (M, m, p) and a target (M, m); each output has (m,) ``counts`` samples, by default M."""
        finite = all(np.isfinite(block).all() for table in (columns, target) for block in in_blocks(table))
        if not finite:
            raise IdentificationError(
                "The least squares problem holds values that are not finite.",
                next_step="Check the data for gaps and values out of range: fmu-didim check CASE.",
            )  # fmt: skip
        triangles = (
            triangle_by_parts(map(np.column_stack, zip(in_blocks(columns[:, j]), in_blocks(target[:, j]), strict=True)),
                              columns.shape[2] + 1)
            for j in range(target.shape[1])
        )  # fmt: skip
        samples = np.full(target.shape[1], float(target.shape[0])) if counts is None else counts
        return OutputTriangles(tuple(triangles), samples, partial)

    def squares(self, solution: Array) -> Array:
        """(n,) sums of the squares of what a solution (p,) leaves of the target at each joint."""
        return np.array([np.sum((t[:, -1] - t[:, :-1] @ solution) ** 2) for t in self.triangles])

    def solved(self, deviation: Array, names: tuple[str, ...]) -> tuple[Array, Array]:
        """Solution (p,) with the joints divided by deviations (n,), and the sums (n,) of the leverages of their rows.

        Raises:
            IdentificationError: as of :func:`~fmu_didim.fit.statistics.least_squares`.
        """
        rows = np.vstack([t / d for t, d in zip(self.triangles, deviation, strict=True)])
        if self.partial:
            found = least_squares_of_shown(rows[:, :-1], rows[:, -1])
        else:
            found = least_squares(rows[:, :-1], rows[:, -1], names=names)
        first = np.cumsum([0, *(t.shape[0] for t in self.triangles[:-1])])
        return found.solution, np.add.reduceat(found.leverage, first)

    def free_squares(self, squares: Array, floor: Array, names: tuple[str, ...]) -> Array:
        """(m,) sums of squares that are left where the columns explain all that they can, from those (m,) that are left
        now."""
        for _ in range(2):  # the first time by weights that ignore what the columns explain
            squares = self.squares(self.solved(self.deviation(squares, floor, names), names)[0])
        return squares

    def deviation(self, squares: Array, floor: Array, names: tuple[str, ...]) -> Array:
        """(n,) estimated deviations, at least ``floor``, where the residual has these sums of squares (n,)."""
        first = deviation_of_sums(squares, self.samples, floor=floor)
        return deviation_of_sums(squares, self.samples - self.solved(first, names)[1], floor=floor)


def output_deviation(model: LoopModel, residual: Array, columns: Array) -> Array:
    """(m,) deviations to weight with, from a residual (M, m) left by columns (M, m, p).

    What a prior takes from the fit is no noise: beside one, the residual is what the columns cannot explain at all.
    """
    stated = model.stated_deviations
    if not np.isnan(stated).any():
        return stated
    counts, names = model.output_counts, model.names[: columns.shape[2]]
    floor = noise_floor(model.measured_outputs, counts)
    squares, n, partial = (residual**2).sum(axis=0), model.joint_count, model.prior is not None
    if partial:
        triangles = OutputTriangles.of(columns, residual, counts, partial=True)
        squares = triangles.free_squares(squares, floor, names)
    if model.joint_weights == "equal" and n == counts.size:
        return np.full(n, max(float(np.sqrt(squares.sum() / counts.sum())), float(floor.max())))
    triangles = OutputTriangles.of(columns, residual, counts, partial=partial)
    found = triangles.deviation(squares, floor, names)
    if model.joint_weights == "equal":
        found[:n] = max(float(np.sqrt(squares[:n].sum() / counts[:n].sum())), float(floor[:n].max()))
    return np.where(np.isnan(stated), found, stated)


def weighted_solution(model: LoopModel, columns: Array, target: Array) -> tuple[LeastSquares, Array]:
    """Least squares of target (N, n) on columns (N, n, p), those of the first p free parameters, joints weighted, and
    of a prior; and the deviations (n,) used.

    With estimated weights a first, unweighted solution gives the noise of each joint.
    """
    names, deviation = model.names[: columns.shape[2]], np.ones(target.shape[1])
    if model.torque_deviation is not None:
        deviation = model.torque_deviation
    elif model.prior is not None or (model.joint_weights == "estimated" and target.shape[1] > 1):
        triangles = OutputTriangles.of(columns, target, partial=model.prior is not None)
        floor = noise_floor(model.measured)
        # Twice: the first residual comes from weights that ignore the noise.
        for _ in range(2):
            first, _ = triangles.solved(deviation, names)
            deviation = triangles.deviation(triangles.squares(first), floor, names)
        if model.joint_weights == "equal":
            deviation = np.full(deviation.size, float(np.sqrt(np.mean(deviation**2))))
    right = whitened(target, deviation)
    if model.prior is not None:
        right = np.concatenate([right, model.prior.target])
    return least_squares(model.beside_prior(whitened(columns, deviation)), right, names=names), deviation
