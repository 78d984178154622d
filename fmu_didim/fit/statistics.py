"""Least squares and its statistics.

The DIDIM paper's formulas (eqs. 5 to 9) with two slips corrected: the variance of the noise is the
*squared* norm of the residual over the degrees of freedom (eq. 7), and a relative standard deviation is
taken of |chi| (eq. 9). With W the regressor and S = d tau_s / d chi the true sensitivity of the closed
loop, both divided by the standard deviation of the noise:

    paper (eq. 8)   C = (W'W)^-1
    DIDIM           C = (W'S)^-1 (W'W) (S'W)^-1      its fixed point solves W'(y - tau_s(chi)) = 0
    Gauss-Newton    C = (S'S)^-1                     the Cramer-Rao bound for normal noise

The last two are Phi' Phi of the influence Phi of the noise on the estimate: Phi' = (W'S)^-1 W' and (S'S)^-1 S'. Noise
with a colour goes between (:mod:`fmu_didim.fit.uncertainty`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmu_didim.base.distributions import t_ppf, t_sf
from fmu_didim.base.errors import IdentificationError
from fmu_didim.base.tall import in_blocks, triangle_beside, triangle_by_parts, with_rows
from fmu_didim.data.signals import Array
from fmu_didim.model.loop import Loop

CONDITION_LIMIT = 1e12
"""[1] Condition number, of columns of length one, beyond which rounding decides what a solution is."""
LEADING = 0.1
"""[1] Fraction of the largest component of a direction from which a parameter takes part in it."""
CONFIDENCE = 0.95
"""[1] Probability of the intervals of parameters and of held-out ratios."""


@dataclass(frozen=True)
class LeastSquares:
    """Solution of min |b - A x|.

    Attributes:
        solution: (p,); residual: (r,).
        condition_number: of A with columns scaled to length one.
        leverage: (r,) diagonal of the projection on the columns of A.
    """

    solution: Array
    residual: Array
    condition_number: float
    leverage: Array


def least_squares(matrix: Array, target: Array, *, names: tuple[str, ...] = ()) -> LeastSquares:
    """Solve min |target - matrix x| by QR of the column-scaled matrix.

    Args:
        matrix: (r, p), r > p; target: (r,).
        names: of the columns, for the error message.

    Raises:
        IdentificationError: too few rows, not finite, or columns that depend on each other.
    """
    rows, count = matrix.shape
    if rows <= count:
        raise IdentificationError(
            "There are not more samples than parameters.", got=f"{rows} samples, {count} parameters",
            next_step="Record longer, at a higher rate, or identify fewer parameters.",
        )  # fmt: skip
    norms = np.linalg.norm(matrix, axis=0)
    if not (np.isfinite(norms).all() and np.isfinite(target).all()):
        raise IdentificationError(
            "The least squares problem holds values that are not finite.",
            next_step="Check log and reference for gaps and values out of range: fmu-didim check CASE.",
        )  # fmt: skip
    if (norms == 0).any():
        unexcited = [names[i] if names else str(i) for i in np.flatnonzero(norms == 0)]
        raise IdentificationError(
            "The motion does not excite some parameters.", got=", ".join(unexcited),
            next_step="Remove them from the identified parameters, or use another trajectory.",
        )  # fmt: skip
    r, right, _ = triangle_beside(matrix, target)
    r = r / norms
    singular = np.linalg.svd(r, compute_uv=False)
    condition = float(singular[0] / singular[-1]) if singular[-1] > 0 else np.inf
    if condition > CONDITION_LIMIT:
        direction = np.abs(np.linalg.svd(r)[2][-1])
        found = [names[i] if names else str(i) for i in np.flatnonzero(direction > LEADING * direction.max())]
        raise IdentificationError(
            "The data cannot tell some parameters apart.", got=", ".join(found),
            next_step="Leave one of them out (its value is then taken as known), use a richer trajectory, or identify "
            "fewer parameters.",
        )  # fmt: skip
    solution, basis = np.linalg.solve(r, right) / norms, np.linalg.inv(r) / norms[:, None]
    leverage = np.concatenate([np.sum((block @ basis) ** 2, axis=1) for block in in_blocks(matrix)])
    return LeastSquares(solution, target - matrix @ solution, condition, leverage)


def noise_deviation(residual: Array, leverage: Array, *, floor: Array) -> Array:
    """Standard deviation of the noise of each joint, (n,): sqrt(|rho_j|^2 / (N - trace of its leverages)).

    Args:
        residual, leverage: (N, n).
        floor: (n,) smallest value, so that noise-free data have weights too.
    """
    return deviation_of_sums((residual**2).sum(axis=0), residual.shape[0] - leverage.sum(axis=0), floor=floor)


def deviation_of_sums(squares: Array, freedom: Array, *, floor: Array) -> Array:
    """The same from sums of squares and degrees of freedom, both (n,)."""
    return np.asarray(np.maximum(np.sqrt(squares / np.maximum(freedom, 1.0)), floor))


def influence_of_instruments(w: Array, s: Array) -> Array:
    """(r, p) W (S'W)^-1 of the whitened regressor and sensitivity: how the noise of each row moves the estimate."""
    sizes = np.linalg.norm(s, axis=0)
    return np.asarray(np.linalg.solve((w / sizes).T @ (s / sizes), (w / sizes).T).T / sizes)


def influence_efficient(s: Array) -> Array:
    """(r, p) S (S'S)^-1 of a whitened sensitivity: the same of least squares.

    Directions that only rounding shows move by as much as if they were shown at the limit of that: far more than is
    known of any parameter that takes part in them, while the others keep what is known of them.
    """
    norms = np.linalg.norm(s, axis=0)
    triangle = triangle_by_parts(in_blocks(s), norms.size) / norms
    if _is_singular(triangle):
        orthonormal, triangle = np.linalg.qr(s / norms)
        return np.asarray(orthonormal @ _inverse(triangle).T / norms)
    first = np.linalg.inv(triangle) / norms[:, None]
    second = np.linalg.inv(triangle_by_parts((block @ first for block in in_blocks(s)), norms.size))
    inverse = first @ second  # twice, so that the columns of S times it are orthonormal to rounding
    found = np.empty(s.shape)
    for own, block in with_rows(found, in_blocks(s)):
        np.matmul((block @ first) @ second, inverse.T, out=own)
    return found


def covariance_white(a: Array) -> Array:
    """(A'A)^-1 of a whitened matrix (r, p): by the sensitivity S the Cramer-Rao bound, by the regressor W eq. 8."""
    norms = np.linalg.norm(a, axis=0)
    r = triangle_by_parts(in_blocks(a), norms.size) / norms
    inverse = (_inverse(r) if _is_singular(r) else np.linalg.inv(r)) / norms[:, None]
    return np.asarray(inverse @ inverse.T)


def _is_singular(triangle: Array) -> bool:
    """Whether a triangle (p, p) of columns of length one has directions that only rounding shows."""
    if len(triangle) < triangle.shape[1] or not np.isfinite(triangle).all():
        return False  # which its inverse tells
    singular = np.linalg.svd(triangle, compute_uv=False)
    return bool(singular[-1] * CONDITION_LIMIT < singular[0])


def _inverse(triangle: Array) -> Array:
    """R^-1 (p, p) with singular values of R at the limit of what rounding shows, at least."""
    left, singular, right = np.linalg.svd(triangle)
    return np.asarray((right.T / np.maximum(singular, singular[0] / CONDITION_LIMIT)) @ left.T)


def relative_deviation_percent(value: Array, deviation: Array) -> Array:
    """100 sigma / |chi| (eq. 9, corrected); infinite where chi is zero."""
    size = np.abs(value)
    return np.asarray(np.divide(100.0 * deviation, size, out=np.full_like(size, np.inf), where=size > 0))


def confidence_interval(value: Array, deviation: Array, freedom: float, level: float = CONFIDENCE) -> Array:
    """(p, 2) interval by Student's t with ``freedom`` degrees of freedom."""
    half = t_ppf(0.5 + level / 2, max(freedom, 1.0)) * deviation
    return np.column_stack([value - half, value + half])


def bounded_interval(value: float, deviation: float, freedom: float, limit: float, level: float = CONFIDENCE) -> float:
    """The other end of the interval of a parameter that is known to lie above a limit, below which the data alone have
    its value: where Student's t with ``freedom`` degrees of freedom, cut off at the limit, has the probability
    ``level``."""
    freedom = max(freedom, 1.0)
    above = t_sf((limit - value) / deviation, freedom)
    return float(value - deviation * t_ppf((1 - level) * above, freedom))


def correlation(covariance: Array) -> Array:
    """(p, p) correlation coefficients."""
    scale = np.sqrt(np.diag(covariance))
    return np.asarray(covariance / np.outer(scale, scale))


def error_percent(loop: Loop, measured: Array, simulated: Array) -> tuple[float, Array]:
    """The relative error of what the log of a loop shows (N, n), in total and of each column (n,)."""
    return (relative_error_percent if loop.shows_torque else output_error_percent)(measured, simulated)


def output_error_percent(measured: Array, simulated: Array) -> tuple[float, Array]:
    """100 |y - y_s| / |y - mean(y)|, of what outputs move, wherever their zeros are: of each (n,), 0 where both are the
    same and infinite where an output rests; in total the root mean square of those that move."""
    moved = measured - measured.mean(axis=0)
    each = relative_error_percent(moved, simulated - measured.mean(axis=0))[1]
    moving = each[np.isfinite(each)]
    return float(np.sqrt(np.mean(moving**2))) if moving.size else np.inf, each


def relative_error_percent(measured: Array, simulated: Array) -> tuple[float, Array]:
    """100 |y - y_s| / |y|: in total, and of each joint (n,); 0 where both are zero."""
    error = np.linalg.norm(measured - simulated, axis=0)
    size = np.where(error > 0, np.linalg.norm(measured, axis=0), 1.0)
    with np.errstate(divide="ignore"):
        per_joint = 100 * error / size
        total = np.divide(100 * np.linalg.norm(measured - simulated), np.linalg.norm(measured))
    return float(total), per_joint
