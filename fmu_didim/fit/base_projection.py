"""Projection of a change of the torque on the columns of a base model, and the rest of it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np
from scipy import linalg

from fmu_didim.data.signals import Array
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.noise.noise import effective_fraction

HALF_OF_RESIDUAL = 0.5
"""[1] Fraction of its residual that a joint is weighted with at least in a projection: repeatable model error is no
precision."""
DEPENDENT = 1e-9
"""[1] Singular value, relative to the largest one, of columns of length one that depend on others: rounding of the
sensitivities lies above it, that of the arithmetic below."""
BLOCK = 32
"""[tables] Projected together: the basis of a TX40, 2.5 MB, is then read once for all of them, and they still fit a
cache."""

UNWEIGHTED = np.ones(1)


@dataclass(frozen=True)
class BaseProjection:
    """Orthonormal basis of the weighted columns of a base model, such as its regressor or its sensitivities.

    Attributes:
        weight: (n,) of each joint; basis: (N n, r).
    """

    weight: Array
    basis: Array

    @classmethod
    def of(
        cls, columns: Array, weight: Array = UNWEIGHTED, *, tolerance: float = DEPENDENT, idle: float = 0.0
    ) -> BaseProjection:
        """The projection by columns (N, n, p), or (N, p) of a single joint.

        Args:
            tolerance: singular value, relative to the largest one, of columns of length one that depend on others.
            idle: length of a column, relative to the longest one, below which it is rounding.
        """
        count = columns.shape[-1]
        table = (columns.reshape(columns.shape[0], -1, count) * weight[:, None]).reshape(-1, count)
        size = np.linalg.norm(table, axis=0)
        kept = size > idle * size.max(initial=0.0)
        if not kept.any():  # which LAPACK takes in newer versions of SciPy alone
            return cls(weight, np.zeros((len(table), 0)))
        return cls(weight, linalg.orth(table[:, kept] / size[kept], rcond=tolerance))

    @classmethod
    def of_fit(cls, fit: Fit) -> BaseProjection:
        """The projection by the sensitivities of a fit."""
        # The residual's own colour, so that repeatable model error does not count as so many independent samples.
        blocks = [residual for _, residual in fit.model.experiments.blocks(fit.residual)]
        rms = np.concatenate([np.sqrt(np.mean(residual**2, axis=0)) for residual in blocks])
        fraction = np.concatenate([effective_fraction(residual) for residual in blocks])
        return cls.of(fit.jacobian, np.sqrt(fraction) / np.maximum(fit.noise.deviation, rms * HALF_OF_RESIDUAL))

    def weighted(self, values: Array) -> Array:
        """(N n,) or (N n, m) of values (N, n) or (N, n, m)."""
        weight = self.weight.reshape(-1, *(1,) * (values.ndim - 2))
        return np.asarray((values * weight).reshape(-1, *values.shape[2:]))

    def rest_of(self, weighted: Array) -> Array:
        """The part of weighted values, (N n,) or (N n, m), that the base cannot explain."""
        return np.asarray(weighted - self.basis @ (self.basis.T @ weighted))

    def rests_of(self, tables: Iterable[Array]) -> Iterator[tuple[Array, Array]]:
        """For many (N, n, m) one after the other: their weighted values (N n, m), and what is left of these.

        Several are multiplied together, which is several times faster than one by one.
        """
        waiting = iter(tables)
        while block := [self.weighted(table) for table in islice(waiting, BLOCK)]:
            ends = np.cumsum([table.shape[1] for table in block])
            yield from zip(block, np.split(self.rest_of(np.concatenate(block, axis=1)), ends[:-1], axis=1), strict=True)
