"""First values of free gains of drives, from runs with and without a load of known mass.

With the logged torque u and the gains g the inverse model is linear in both,

    W theta - g u = -W_L chi_L

whose right side is what is known of the load: without it all would be zero, and any multiple a solution. Least squares
of this takes the noise of u for that of a column, which draws g to zero: it tells the signs. From there

    u = (W theta + W_L chi_L) / g

is fitted, in which u is what is measured. Source: Gautier, Briot, "Global identification of joint drive gains and
dynamic parameters of robots", Journal of Dynamic Systems, Measurement, and Control 136(5), 2014.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fmu_didim.base.errors import IdentificationError
from fmu_didim.data.signals import Array
from fmu_didim.fit.noise.noise import TINY
from fmu_didim.model.loop_model import LoopModel

ROUNDS = 3
"""[fits] Least squares with the joints weighted alike, then by what they leave."""
SURE = 30.0
"""[1] By how much surer than stated what is known of the load is taken: the shrinking by noise shall not be its."""
UNSEEN = 1e-6
"""[1] Of the largest, singular value below which a direction is none: the gains are then not determined."""
LARGEST = 7.0
"""[1] Logarithm of the largest factor by which a gain moves in a round."""
SIGNIFICANT = 3.0
"""[standard deviations] Below zero, from which a gain is surely negative."""


def free_gains(model: LoopModel) -> dict[int, int]:
    """Joint, from 0 -> place among the free parameters of the gain of its drive, where that is free."""
    return model.free_parameters.gains_of_drives(model.joint_count)


def with_first_gains(model: LoopModel, columns: Array, target: Array, measured: Array) -> LoopModel:
    """The model whose free gains start where columns (N, n, p) of a motion have them; as it is where none is free or no
    load of known mass is carried.

    Args:
        target: (N, n) measured torque (N, n) without what is known.

    Raises:
        IdentificationError: a gain is surely negative.
    """
    gains, of_prior = free_gains(model), _known_load(model)
    if not gains or not (of_prior[1].any() or any(load.known for load in model.loads.values())):
        return model
    problem = _Bilinear.of(columns, measured - target, measured, of_prior, sorted(gains))
    signs, sigma = problem.linear()
    if signs is None or sigma is None:
        return model  # the fit refuses it, and says what is not told apart
    if (bad := np.flatnonzero(signs < -SIGNIFICANT * sigma)).size:
        k = int(bad[0])
        raise IdentificationError(
            "With what is known of the load, the gain of a drive is negative.", where=f"joint {problem.free[k] + 1}",
            got=f"{signs[k]:.3g} \u00b1 {sigma[k]:.2g}", valid="above 0",
            next_step="Check the sign of its current (sign: -1 of its column) and of its position, and whether the run "
            "with load: is the loaded one.",
        )  # fmt: skip
    start = {gains[j]: float(g) for j, g in zip(problem.free, problem.solved(np.maximum(signs, sigma)), strict=True)}
    return model.with_free(
        replace(k, value=start[i], scale=start[i]) if i in start else k for i, k in enumerate(model.free_parameters)
    )  # fmt: skip


@dataclass(frozen=True)
class _Bilinear:
    """The problem  g u = W theta + k  of a motion, brought to a triangle a joint by QR.

    Attributes:
        triangles: of [W, k, u] of each joint; samples: of each; prior: rows (r, p) and target (r,) of the load.
        free: joints, from 0, whose gain is free.
    """

    triangles: tuple[Array, ...]
    samples: int
    prior: tuple[Array, Array]
    free: tuple[int, ...]

    @classmethod
    def of(
        cls, columns: Array, known: Array, measured: Array, prior: tuple[Array, Array], free: Sequence[int]
    ) -> _Bilinear:
        """From W (N, n, p), k and u (N, n)."""
        both = np.concatenate([columns, known[:, :, None], measured[:, :, None]], axis=2)
        triangles = tuple(np.asarray(np.linalg.qr(both[:, j], mode="r")) for j in range(both.shape[1]))
        return cls(triangles, measured.shape[0], prior, tuple(free))

    def linear(self) -> tuple[Array, Array] | tuple[None, None]:
        """Gains (f,) by least squares with their standard deviations, too small by the noise of u but of the right
        sign; None where they are not determined."""
        count = self.triangles[0].shape[1] - 2
        deviation = np.array([np.linalg.norm(t[:, -1]) for t in self.triangles]) / np.sqrt(self.samples) + TINY
        for _ in range(ROUNDS):
            rows, right = [], []
            for j, (t, s) in enumerate(zip(self.triangles, deviation, strict=True)):
                own = np.zeros((len(t), len(self.free)))
                if j in self.free:
                    own[:, self.free.index(j)] = -t[:, -1]
                rows.append(np.hstack([t[:, :count], own]) / s)
                right.append((-t[:, -2] + (0.0 if j in self.free else t[:, -1])) / s)
            table = np.vstack([*rows, np.pad(self.prior[0], ((0, 0), (0, count + len(self.free) - self._width)))])
            target = np.concatenate([*right, self.prior[1]])
            length = np.linalg.norm(table, axis=0) + TINY
            solution, _, rank, _ = np.linalg.lstsq(table / length, target, rcond=UNSEEN)
            left = np.split((target - table / length @ solution)[: sum(map(len, rows))], len(rows))
            deviation = deviation * np.sqrt([np.sum(one**2) / self.samples for one in left]) + TINY
        if rank < table.shape[1]:
            return None, None
        spread = np.sqrt(np.diag(np.linalg.inv((table / length).T @ (table / length)))) / length
        return (solution / length)[count:], spread[count:]

    @property
    def _width(self) -> int:
        return int(self.prior[0].shape[1])

    def solved(self, start: Array) -> Array:
        """Gains (f,) by the least squares of what is measured, u = (W theta + k) / g, with the theta that is best for
        them; the joints are weighted by what they leave."""
        from scipy.optimize import least_squares  # slow to import

        found = np.log(start)
        deviation = np.ones(len(self.triangles))
        for _ in range(ROUNDS):
            left = self._left(found, deviation)
            parts = np.split(left[: sum(map(len, self.triangles))], np.cumsum([len(t) for t in self.triangles])[:-1])
            deviation = deviation * np.sqrt([np.sum(one**2) / self.samples for one in parts]) + TINY
            found = least_squares(self._left, found, args=(deviation,), bounds=(found - LARGEST, found + LARGEST)).x
        return np.asarray(np.exp(found))

    def _left(self, logarithms: Array, deviation: Array) -> Array:
        """What is left of u and of the prior with the best theta, divided by deviations (n,)."""
        count = self.triangles[0].shape[1] - 2
        gain = np.ones(len(self.triangles))
        gain[list(self.free)] = np.exp(logarithms)
        rows = [t[:, :count] / (g * s) for t, g, s in zip(self.triangles, gain, deviation, strict=True)]
        right = [(t[:, -1] - t[:, -2] / g) / s for t, g, s in zip(self.triangles, gain, deviation, strict=True)]
        table = np.vstack([*rows, np.pad(self.prior[0], ((0, 0), (0, count - self._width)))])
        target = np.concatenate([*right, self.prior[1]])
        length = np.linalg.norm(table, axis=0) + TINY
        return np.asarray(target - table / length @ np.linalg.lstsq(table / length, target, rcond=UNSEEN)[0])


def _known_load(model: LoopModel) -> tuple[Array, Array]:
    """Rows (r, p) and target (r,) of what a prior says of loads."""
    if model.prior is None:
        return np.zeros((0, 0)), np.zeros(0)
    rows = model.prior.padded(model.linear_count)
    loads = [i for i, k in enumerate(model.free_parameters) if k.is_load]
    of_loads = rows[:, loads].any(axis=1)
    return SURE * rows[of_loads], SURE * model.prior.target[of_loads]
