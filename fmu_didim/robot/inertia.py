"""Inertia matrices along positions: linear in the standard parameters, positive definite or not."""

from __future__ import annotations

import casadi as ca
import numpy as np

from fmu_didim.robot.vectorised import Vectorised
from fmu_didim.signals import Array


class InertiaColumns:
    """dM/dchi along positions; those of the last positions are kept, as an identification asks for the same ones.

    Args:
        q, chi: symbols of positions and standard parameters; mass: M (n, n) in these.
    """

    def __init__(self, q: ca.SX, chi: ca.SX, mass: ca.SX) -> None:
        self._count = int(chi.numel())
        self._columns = Vectorised(ca.Function("inertia_columns", [q], [ca.densify(ca.jacobian(ca.vec(mass), chi))]))
        self._last: tuple[bytes, Array] | None = None

    def at(self, q: Array) -> Array:
        """(N n n, ns): of all elements of M at positions (N, n)."""
        key, last = q.tobytes(), self._last
        if last is not None and last[0] == key:
            return last[1]
        columns = self._columns(q.shape[0], [q.T]).reshape(q.shape[0], self._count, -1).transpose(0, 2, 1)
        result = np.ascontiguousarray(columns.reshape(-1, self._count))
        self._last = key, result
        return result


def smallest_eigenvalue(elements: Array, count: int, n: int) -> float:
    """Smallest eigenvalue of D^-1/2 M D^-1/2, D = diag|M|, of ``count`` symmetric matrices; <= 0 where a diagonal
    element is.

    Args:
        elements: (count n n,) of the matrices, one after the other.
    """
    mass = elements.reshape(count, n, n)
    diagonal = np.einsum("kii->ki", mass)
    if not np.isfinite(mass).all() or (diagonal <= 0).any():
        return float(min(0.0, diagonal.min())) if np.isfinite(mass).all() else -1.0
    scale = 1.0 / np.sqrt(diagonal)
    return float(np.linalg.eigvalsh(mass * scale[:, :, None] * scale[:, None, :]).min())
