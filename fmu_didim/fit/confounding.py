"""Parameters that the data cannot separate: nearly collinear columns of the sensitivity.

A direction v (of columns of length one) with a small singular value s is one along which the parameters may move
together and the torque hardly changes. It is confounded if s is below what derivatives are exact to, or if noise lets
two or more parameters move along it by more than their own size and by a good part of the torque, while each of them
alone would be known well.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fmu_didim.base.errors import IdentificationError
from fmu_didim.data.signals import Array
from fmu_didim.fit.statistics import LEADING, LeastSquares

COLLINEAR = 1e-6
"""[1] Singular value, of columns of length one over the square root of their number, below which errors of the
derivatives (1e-6 of a column) decide what is identified."""
UNKNOWN_SIZE = 1.0
"""[1] A parameter is not known at all if its standard deviation is more than this fraction of its value,"""
UNKNOWN_TORQUE = 0.05
"""[1] and moves the torque by more than this fraction of it: small parameters are often not significant."""
STEP_ALONG = 0.01
"""[1] Change of the parameter that moves most along a ridge, in the message that tells of it."""
INFLATION = 10.0
"""[1] Ratio of the standard deviation to that with all others known, from which a parameter is unknown because of
others."""


def shown_directions(columns: Array) -> tuple[Array, Array]:
    """U (r, k) orthonormal and V (p, k) with the pseudoinverse V U' of columns (r, p): without those directions that
    only errors of the derivatives show."""
    length = np.linalg.norm(columns, axis=0)
    scale = np.where(length > 0, length, 1.0)
    q, r = np.linalg.qr(columns / scale)
    left, singular, right = np.linalg.svd(r, full_matrices=False)
    kept = singular > COLLINEAR * np.sqrt(columns.shape[1])
    return q @ left[:, kept], (right[kept].T / singular[kept]) / scale[:, None]


def least_squares_of_shown(columns: Array, target: Array) -> LeastSquares:
    """Least squares of target (r,) on columns (r, p) that may depend on each other: the shortest solution."""
    left, right = shown_directions(columns)
    solution = right @ (left.T @ target)
    return LeastSquares(solution, target - columns @ solution, np.inf, np.einsum("ij,ij->i", left, left))


def confounded(columns: Array, values: Array, names: Sequence[str], *, torque: float) -> tuple[str, ...]:
    """Names of the parameters that cannot be separated; empty if all can.

    Args:
        columns: (r, p) whitened sensitivity; values: (p,) at which it was taken.
        torque: norm of the whitened measured torque.
    """
    length = np.linalg.norm(columns, axis=0)
    if (length == 0).any():
        return tuple(name for name, size in zip(names, length, strict=True) if size == 0)
    _, singular, vectors = np.linalg.svd(np.linalg.qr(columns / length)[1])
    found: set[int] = set()
    for s, v in zip(singular, vectors, strict=True):
        together = np.flatnonzero(np.abs(v) > LEADING * np.abs(v).max())
        if together.size < 2:
            continue
        if s < COLLINEAR * np.sqrt(values.size):
            found |= {int(i) for i in together}
            continue
        # Along v noise moves parameter i by |v_i| / s standard deviations of it alone.
        inflated = np.abs(v) / s
        larger = inflated > UNKNOWN_SIZE * np.abs(values) * length
        unknown = larger & (inflated > UNKNOWN_TORQUE * torque)
        both = [int(i) for i in together if unknown[i] and inflated[i] > INFLATION]
        if len(both) > 1:
            found |= set(both)
    return tuple(names[i] for i in sorted(found))


def refuse_confounded(columns: Array, values: Array, names: Sequence[str], *, torque: float) -> None:
    """Raise IdentificationError with the names of what :func:`confounded` finds."""
    found = confounded(columns, values, names, torque=torque)
    if found:
        raise IdentificationError(
            "The data cannot tell some parameters apart.", got=", ".join(found), where="identify",
            next_step="Leave one of them out (its value is then taken as known), or add an experiment that separates "
            "them, with another payload, gain or motion.",
        )  # fmt: skip


TELL_APART = (
    "Take one of them out of identify: (its value is then taken as known: model: {parameters: ...}), measure a further "
    "output that they change differently, or add an experiment that does"
)


def refuse_ridge(columns: Array, values: Array, names: Sequence[str], *, outputs: float, at: str = "") -> None:
    """Raise IdentificationError where outputs of a model show parameters only together, and how these move.

    Args:
        columns, values: as of :func:`confounded`; outputs: norm of the whitened outputs; at: where, in words.
    """
    found = confounded(columns, values, names, torque=outputs)
    if not found:
        return
    raise IdentificationError(
        "The data cannot tell some parameters apart.", where="identify",
        got=f"{_ridge(columns, values, names, found)}{at}",
        next_step=f"{TELL_APART}, or start nearer to the truth (start:)." if at else f"{TELL_APART}.",
    )  # fmt: skip


def _ridge(columns: Array, values: Array, names: Sequence[str], found: Sequence[str]) -> str:
    """The parameters that are not told apart, and by how much they move together along the weakest direction."""
    length = np.linalg.norm(columns, axis=0)
    if (length == 0).any():
        return ", ".join(found)
    _, _, vectors = np.linalg.svd(np.linalg.qr(columns / length)[1])
    size = np.where(values != 0, np.abs(values), 1.0)
    moves = vectors[-1] / length / size
    moves = moves / np.abs(moves).max()
    moves = moves * np.sign(moves[np.argmax(np.abs(moves) > LEADING)])
    told = [
        f"{name} {100 * STEP_ALONG * move:+.2g} %" for name, move in zip(names, moves, strict=True)
        if abs(move) > LEADING or name in found
    ]  # fmt: skip
    return f"{', '.join(told)} together change the outputs least of all"
