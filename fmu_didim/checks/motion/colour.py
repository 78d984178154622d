"""The colour of the noise in the logs of a joint, learnt beside what a fit and functions of the motion explain.

What the residual holds of the motion is no noise: it is projected out before the colour is learnt, and what that takes
from noise of this colour is added again (:mod:`fmu_didim.fit.noise.residual_noise`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from fmu_didim.cosim import Indices
from fmu_didim.data.signals import Array
from fmu_didim.fit.noise.residual_noise import JointNoise, Log, LogsOfOneRate
from fmu_didim.fit.uncertainty import Stretch

ROUNDS = 1
"""[rounds] Of colour and what the projection takes from it, from white noise on; one is enough from a colour that is
nearly right."""


@dataclass(frozen=True)
class LogNoise:
    """The noise of a joint in its logs.

    Attributes:
        logs: rows and places of each log in tables of all of them, and its rate.
        noises: rate in Hz -> the noise of its logs; white where nothing has been learnt.
    """

    logs: tuple[Stretch, ...]
    noises: Mapping[float, JointNoise] = field(default_factory=dict)

    def learnt(self, rest: Array, basis: Array) -> LogNoise:
        """The noise by what is left (M,) of a residual beside columns with an orthonormal basis (M, r)."""
        found = {}
        for rate in {log.rate_hz for log in self.logs}:
            group = LogsOfOneRate(rate, tuple(_log(log, rest, basis) for log in self.logs if log.rate_hz == rate))
            before = self.noises.get(rate)
            noises = group.white() if before is None else [before]
            for _ in range(ROUNDS if before is None else 1):
                noises = group.refitted(noises, [True], group.shares(noises)[0])
            found[rate] = noises[0]
        return LogNoise(self.logs, found)

    def whitened(self, table: Array) -> Array:
        """The columns (M, m) whitened by the autoregressions of the noise; rows whose past is missing are left out."""
        return np.concatenate([self._whitened(table[log.rows], log) for log in self.logs])

    def _whitened(self, table: Array, log: Stretch) -> Array:
        noise = self.noises.get(log.rate_hz)
        return table if noise is None else filtered(table, noise.coefficients, log.places)


def _log(stretch: Stretch, rest: Array, basis: Array) -> Log:
    columns = basis[stretch.rows, None]
    return Log.of(stretch.places, rest[stretch.rows, None], columns, columns)


def filtered(table: Array, coefficients: Array, places: Indices) -> Array:
    """The columns (N, m) of a log with samples at these places of its grid, whitened by an autoregression; rows whose
    past is missing are left out."""
    order = coefficients.size
    if not order:
        return table
    if places[-1] + 1 > places.size:
        on_grid = np.full((places[-1] + 1, table.shape[1]), np.nan)
        on_grid[places] = table
        table = on_grid
    left = table[order:].copy()
    for k, a in enumerate(coefficients, start=1):
        left -= a * table[order - k : table.shape[0] - k]
    return np.asarray(left[np.isfinite(left).all(axis=1)])


def orthonormal(columns: Array, beside: Array | None = None) -> Array:
    """(N, r) basis of columns (N, m) that are independent, beside a basis (N, q) that the result begins with."""
    if beside is None:
        return np.asarray(np.linalg.qr(columns)[0])
    for _ in range(2):  # the second time for what rounding leaves
        columns = columns - beside @ (beside.T @ columns)
    return np.column_stack([beside, np.linalg.qr(columns)[0]])


def rest_of(columns: Array, basis: Array) -> Array:
    """What an orthonormal basis (N, r) leaves of columns (N,) or (N, m)."""
    return np.asarray(columns - basis @ (basis.T @ columns))
