"""What a fitted model can absorb of a change of the torque, and what is left of it."""

from __future__ import annotations

import numpy as np

from fmu_didim.prediction.least_squares import Fit
from fmu_didim.prediction.noise import Noise, effective_fraction
from fmu_didim.signals import Array


class Basis:
    """Orthonormal basis of the weighted sensitivities of a model, and its weighted residual."""

    def __init__(self, fit: Fit, noise: Noise) -> None:
        # The residual's own colour, so that repeatable model error does not count as so many independent samples.
        self.weight = np.sqrt(effective_fraction(fit.residual)) / np.maximum(
            noise.deviation, np.sqrt(np.mean(fit.residual**2, axis=0)) * 0.5
        )
        table = (fit.jacobian * self.weight[:, None]).reshape(-1, fit.jacobian.shape[2])
        scale = np.linalg.norm(table, axis=0)
        q, r = np.linalg.qr(table[:, scale > 0] / scale[scale > 0])
        self.q = q[:, np.abs(np.diag(r)) > 1e-10]
        self.residual = self.project((fit.residual * self.weight).ravel())
        self.count = float(np.sum(effective_fraction(fit.residual)) * fit.residual.shape[0])

    def project(self, table: Array) -> Array:
        """The part of the columns that the model cannot absorb."""
        return np.asarray(table - self.q @ (self.q.T @ table))

    def weighted(self, columns: Array) -> Array:
        """(N, n, m) columns weighted and flattened, (N n, m)."""
        return np.asarray((columns * self.weight[:, None]).reshape(-1, columns.shape[2]))
