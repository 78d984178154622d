"""Motions that are linear in free coefficients and begin and end at rest: what a design asks of a family of them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from fmu_didim.data.excitation import Fourier, PointToPoint
from fmu_didim.data.signals import Array
from fmu_didim.discovery.excitation.limits import NOTHING, WITHIN, Limits

GRID = 20
"""[1] Instants of a period for each harmonic, or of a move, at which limits are asked for: between them a series of H
harmonics exceeds its largest value there by a factor of at most 1 / cos(pi / 20), 1.3 % (Ehlich and Zeller 1964)."""
FINE = 400
"""[1] The same where a motion is made as large as its limits allow: WITHIN covers what lies between."""


@dataclass(frozen=True)
class Basis(ABC):
    """Periodic motions of n joints as linear functions of free coefficients Z (d, n), at rest at t = 0 and after each
    period. The first row of Z is the position of the motion, where no start is given.

    Attributes:
        fundamental_hz, periods: of the motion; joints: n; start: (n,) position at its ends, or None.
    """

    fundamental_hz: float
    periods: int
    joints: int
    start: Array | None = None

    @property
    def duration_s(self) -> float:
        """Length of the motion, s."""
        return self.periods / self.fundamental_hz

    @property
    @abstractmethod
    def inner_count(self) -> int:
        """Coefficients of a joint beside its position."""

    @property
    @abstractmethod
    def fastest(self) -> tuple[str, float]:
        """What of the motion is fastest, in words, and its frequency in Hz."""

    @property
    @abstractmethod
    def room(self) -> float:
        """[1] Part of the limits that is used at the instants of the grid."""

    @abstractmethod
    def inner(self, time: Array) -> tuple[Array, Array, Array]:
        """(N, inner_count) derivatives of q, dq and ddq at instants (N,) by the coefficients beside the position."""

    @abstractmethod
    def grid(self, density: int = GRID) -> Array:
        """Instants of one period, s, the more the denser: by default those at which limits are asked for."""

    @abstractmethod
    def excitation(self, z: Array) -> Fourier | PointToPoint:
        """The motion with coefficients (d, n)."""

    @abstractmethod
    def drawn_inner(self, rng: np.random.Generator) -> Array:
        """(inner_count, n) random coefficients beside the position, of any size."""

    @property
    def count(self) -> int:
        """d."""
        return self.inner_count + self._skip

    @property
    def _skip(self) -> int:
        return 0 if self.start is not None else 1

    def tables(self, time: Array) -> tuple[Array, Array, Array]:
        """(N, d) derivatives of q, dq and ddq at instants (N,) by the coefficients of a joint."""
        inner = self.inner(time)
        if self.start is not None:
            return inner
        q, dq, ddq = (
            np.hstack([np.full((time.size, 1), float(order == 0)), table]) for order, table in enumerate(inner)
        )
        return q, dq, ddq

    def constant(self) -> Array:
        """(n,) position beside that of the coefficients."""
        return np.zeros(self.joints) if self.start is None else self.start

    def drawn(self, rng: np.random.Generator, limits: Limits) -> Array:
        """(d, n) random coefficients, each joint as large as its limits allow and its range anywhere inside."""
        inner = self.drawn_inner(rng)
        return self.scaled(inner, limits, rng.uniform(0.0, 1.0, size=self.joints))

    def smaller(self, z: Array, factor: float) -> Array:
        """The motion of coefficients (d, n), smaller by a factor about its position or start."""
        return np.vstack([z[: self._skip], factor * z[self._skip :]])

    def scaled(self, inner: Array, limits: Limits, centre: Array) -> Array:
        """(d, n) coefficients without position (d or d - 1, n) made as large as the limits allow; ``centre``: (n,) from
        0 to 1, where in the room that is left."""
        q, dq, ddq = (table @ inner for table in self.inner(self.grid(FINE)))
        speed = (limits.speed / np.abs(dq).max(axis=0), limits.acceleration / np.abs(ddq).max(axis=0))
        if self.start is not None:
            up, down = np.maximum(q.max(axis=0), NOTHING), np.maximum(-q.min(axis=0), NOTHING)
            room = np.minimum((limits.high - self.start) / up, (self.start - limits.low) / down)
        else:
            room = (limits.high - limits.low) / np.ptp(q, axis=0)
        factor = WITHIN * np.minimum.reduce([room, *speed])
        if self.start is not None:
            return np.asarray(factor * inner)
        low, high = limits.low - factor * q.min(axis=0), limits.high - factor * q.max(axis=0)
        return np.vstack([low + (high - low) * centre, factor * inner])
