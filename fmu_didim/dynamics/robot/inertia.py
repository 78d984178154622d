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
        n = mass.shape[0]
        below = [(i, j) for j in range(n) for i in range(j, n)]  # M is symmetric, and most parameters are not in all
        derivatives = jacobian(ca.vertcat(*(mass[i, j] for i, j in below)), chi)
        rows, parameters = (np.array(places) for places in derivatives.sparsity().get_triplet())
        order = np.argsort(rows, kind="stable")  # what makes up an element lies side by side
        own, self._begins = np.unique(rows[order], return_index=True)
        self._elements, self._places = np.array(below)[own].T, np.array(below)[rows[order]].T
        self._parameters, self._shape = parameters[order], (n, n, int(chi.numel()))
        nonzeros = derivatives.nonzeros()
        columns = ca.vertcat(*(nonzeros[int(k)] for k in order))
        self._columns = Vectorised(ca.Function("inertia_columns", [q], [columns]))
        self._kept: dict[bytes, Array] = {}

    def at(self, q: Array) -> Array:
        """(N, n, n, ns): of all elements of M at positions (N, n)."""
        (i, j), result = self._places, np.zeros((q.shape[0], *self._shape))
        result[:, i, j, self._parameters] = result[:, j, i, self._parameters] = self._nonzero(q)
        return result

    def mass(self, q: Array, chi: Array) -> Array:
        """(N, n, n): M at positions (N, n), with standard parameters (ns,)."""
        (i, j), result = self._elements, np.zeros((q.shape[0], *self._shape[:2]))
        parts = self._nonzero(q) * chi[self._parameters]
        result[:, i, j] = result[:, j, i] = np.add.reduceat(parts, self._begins, axis=1)
        return result

    def _nonzero(self, q: Array) -> Array:
        """(N, m) derivatives that are not zero everywhere."""
        key = q.tobytes()
        found = self._kept.get(key)
        if found is None:
            found = self._kept[key] = self._columns(q.shape[0], [q.T])
            while len(self._kept) > KEPT:
                del self._kept[next(iter(self._kept))]
        return found


def all_positive(mass: Array, least: float) -> bool:
    """Whether the smallest eigenvalues of D^-1/2 M D^-1/2, D = diag|M|, of symmetric matrices (N, n, n) are all above a
    bound: by their Cholesky factors, in a fraction of the time of eigenvalues."""
    diagonal = np.einsum("kii->ki", mass)
    if not (np.isfinite(mass).all() and (diagonal > 0).all()):
        return False
    scale = 1.0 / np.sqrt(diagonal)
    try:
        np.linalg.cholesky(mass * scale[:, :, None] * scale[:, None, :] - least * np.eye(mass.shape[1]))
    except np.linalg.LinAlgError:
        return False
    return True


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
