"""Inertia matrices along positions: linear in the standard parameters, positive definite or not."""

from __future__ import annotations

import casadi as ca
import numpy as np

from fmu_didim.base.symbolic import jacobian
from fmu_didim.data.signals import Array
from fmu_didim.dynamics.robot.vectorised import Vectorised

KEPT = 8
"""[sets of positions] Whose columns are kept: those of the checks and of the limits of a few experiments."""


class InertiaColumns:
    """dM/dchi along positions; the last few results are kept, as an identification needs the same positions again.

    Args:
        q, chi: symbols of positions and standard parameters; mass: M (n, n) in these.
    """

    def __init__(self, q: ca.SX, chi: ca.SX, mass: ca.SX) -> None:
        self._count = int(chi.numel())
        self._columns = Vectorised(ca.Function("inertia_columns", [q], [ca.densify(jacobian(ca.vec(mass), chi))]))
        self._kept: dict[bytes, Array] = {}

    def at(self, q: Array) -> Array:
        """(N n n, ns): of all elements of M at positions (N, n)."""
        key = q.tobytes()
        if key in self._kept:
            return self._kept[key]
        columns = self._columns(q.shape[0], [q.T]).reshape(q.shape[0], self._count, -1).transpose(0, 2, 1)
        result = np.ascontiguousarray(columns.reshape(-1, self._count))
        self._kept[key] = result
        while len(self._kept) > KEPT:
            del self._kept[next(iter(self._kept))]
        return result


def scaled_eigenvalues(mass: Array) -> Array:
    """(N,) smallest eigenvalues of D^-1/2 M D^-1/2, D = diag|M|, of symmetric matrices (N, n, n); the least
    diagonal element where one is not positive, and -1 where not all is finite."""
    diagonal = np.einsum("kii->ki", mass)
    finite = np.isfinite(mass).all(axis=(1, 2))
    positive = finite & (diagonal > 0).all(axis=1)
    result = np.where(finite, np.minimum(diagonal.min(axis=1), 0.0), -1.0)
    scale = 1.0 / np.sqrt(diagonal[positive])
    scaled = mass[positive] * scale[:, :, None] * scale[:, None, :]
    result[positive] = np.linalg.eigvalsh(scaled)[:, 0]
    return result
