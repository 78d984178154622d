"""The linear least squares problem of one step, with limits and damping."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmu_didim.base.errors import IdentificationError
from fmu_didim.base.tall import ROWS, triangle_by_parts
from fmu_didim.data.signals import Array
from fmu_didim.fit.region import SOLVED, Region

SAME_DIRECTION = 1e-10
"""[1] Singular value of columns of length one, relative to the largest, below which a step leaves a direction
alone."""
UNKNOWN_DIRECTION = 1e-14
"""[1] The same for standard deviations: directions that are barely determined must show their large deviation."""
INSIDE = 1e-3
"""[standard deviations] Values that are nearer than this to those of a machine are those of one."""


@dataclass(frozen=True)
class LinearProblem:
    """The linear least squares problem of a step, min |table (step * scale) - right|, brought to (p, p) by QR.

    Attributes:
        table: (p, p) columns of length one; right: (p,); scale: (p,) lengths of the columns, zero for idle parameters.
    """

    table: Array
    right: Array
    scale: Array

    @staticmethod
    def of(
        jacobian: Array, residual: Array, *, prior: tuple[Array, Array] | None = None, deviation: Array | None = None
    ) -> LinearProblem:
        """From (N, n, p) and (N, n), both weighted, or divided here.

        Args:
            prior: further rows (r, p) with what is left of their targets (r,).
            deviation: (n,) by which table and residual are divided, without copies of them.
        """
        count, outputs = jacobian.shape[2], max(residual.shape[1], 1)
        size = 1.0 if deviation is None else deviation

        def blocks() -> Iterator[Array]:
            for first in range(0, max(len(residual), 1), max(ROWS // outputs, 1)):
                own = slice(first, first + max(ROWS // outputs, 1))
                both = np.concatenate([jacobian[own], residual[own][:, :, None]], axis=2)
                yield (both / np.reshape(size, (-1, 1))).reshape(-1, count + 1)
            if prior is not None:
                yield np.column_stack(prior)

        r = triangle_by_parts(blocks(), count + 1)
        r = np.pad(r, ((0, max(count - len(r), 0)), (0, 0)))  # rows, where there are fewer than columns
        scale = np.linalg.norm(r[:, :count], axis=0)
        q, triangle = np.linalg.qr(r[:, :count] / np.where(scale > 0, scale, 1.0))
        return LinearProblem(triangle, q.T @ r[:, count], scale)

    def deviations(self) -> Array:
        """(p,) standard deviations by (S'S)^-1; those of idle or indistinguishable parameters are
        those that the others would leave them."""
        free = self.scale > 0
        result = np.full(self.scale.size, np.inf)
        inverse = np.linalg.pinv(self.table[:, free], rcond=UNKNOWN_DIRECTION)
        result[free] = np.linalg.norm(inverse, axis=1) / self.scale[free]
        return result

    @property
    def condition(self) -> float:
        """Condition number of the columns of length one."""
        singular = np.linalg.svd(self.table[:, self.scale > 0], compute_uv=False)
        return float(singular[0] / singular[-1]) if singular.size and singular[-1] > 0 else np.inf

    def step(self, values: Array, region: Region, damping: float) -> tuple[Array, float]:
        """The step to the least squares solution in a region, and how much it promises to lower the cost."""
        step = self._free_step(values, region, damping)
        if region.machines and not region.surely_holds(values + step):
            step = self._limited_step(values, step, region, damping)
            if not region.surely_holds(values + step):
                step = self._machine_step(values, step, region, damping)
        return step, self.promised(step)

    def promised(self, step: Array) -> float:
        """How much a step (p,) lowers the cost of the linear problem."""
        return float(self.right @ self.right - np.sum((self.right - self.table @ (step * self.scale)) ** 2))

    def _free_step(self, values: Array, region: Region, damping: float) -> Array:
        """The step with parameters at a limit held there."""
        free = self.scale > 0
        step = np.zeros(free.size)
        for _ in range(free.size):
            step = self._best(free, np.zeros(free.size), damping)
            # At a limit and pushed outwards: held.
            stuck = free & (((values <= region.low) & (step < 0)) | ((values >= region.high) & (step > 0)))
            if not stuck.any():
                break
            free &= ~stuck
        return step

    def _best(self, free: NDArray[np.bool_], step: Array, damping: float) -> Array:
        """The step (p,) whose free parts are the best ones beside those that are given."""
        table = np.vstack([self.table[:, free], np.sqrt(damping) * np.eye(int(free.sum()))])
        right = self.right - self.table[:, ~free] @ (step * self.scale)[~free]
        result = step.copy()
        solution = np.linalg.lstsq(table, np.concatenate([right, np.zeros(int(free.sum()))]), rcond=SAME_DIRECTION)[0]
        result[free] = solution / self.scale[free]
        return result

    def _limited_step(self, values: Array, step: Array, region: Region, damping: float) -> Array:
        """The step with what would go beyond a limit of its own held there, and the others solved for beside it; the
        step that was given where some of those would rather come back."""
        free, found = self.scale > 0, step
        held = np.zeros(free.size, dtype=bool)
        low, high = (limit - values for limit in region.limits)
        while (beyond := free & ~held & ((found < low) | (found > high))).any():
            held |= beyond
            found = self._best(free & ~held, np.where(held, np.clip(found, low, high), 0.0), damping)
        slope = self.table.T @ (self.right - self.table @ (found * self.scale)) - damping * found * self.scale
        inwards = held & (((found == low) & (slope > 0)) | ((found == high) & (slope < 0)))
        return step if inwards.any() else found

    def _machine_step(self, values: Array, step: Array, region: Region, damping: float) -> Array:
        """The step itself where it leads to values that a machine can have, else the best one that does; with what is
        at a limit and would go beyond held there, as in :meth:`_free_step`."""
        free, found = self.scale > 0, step
        for _ in range(free.size):
            try:
                found = self._of_machine(values, step, region, damping, free)
            except IdentificationError:  # what the description knows is not physical: the checks say more
                return step
            stuck = free & ~region.base
            stuck &= ((values <= region.low) & (found < 0)) | ((values >= region.high) & (found > 0))
            if not stuck.any():
                break
            free &= ~stuck
        return found

    def _of_machine(self, values: Array, step: Array, region: Region, damping: float, free: NDArray[np.bool_]) -> Array:
        """The step (p,) to the best values of a machine, of which those that are not free stay."""
        scale, one = np.where(free, self.scale, 1.0), np.eye(free.size)
        rows = [np.where(free, self.table * scale, 0.0), one[~free]]  # what is not free stays, in rows of its own
        rows += [np.sqrt(damping) * np.diag(scale)[free]] if damping > 0 else []
        table = np.vstack(rows)
        right = table @ values
        right[: self.right.size] += self.right
        found = region.least_squares(table, right).values
        apart = float(np.linalg.norm(table @ (found - values - step)))
        if region.limits_hold(values + step) and apart <= max(INSIDE, SOLVED * float(np.linalg.norm(right))):
            return step
        return np.where(free, found - values, 0.0)
