"""Fourier series that begin and end at rest, drawn at random or given by free coefficients, within limits.

    q(t) = q0 + sum_k a_k (cos(k w t) - c) + b_k sin(k w t),   sum_k k b_k = 0,   sum_k k^2 a_k = 0

so that velocity and acceleration are zero at t = 0 and after each period; c = 1 where the motion begins at a given
position q0, else 0.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fmu_didim.base.errors import InputError
from fmu_didim.data.excitation import Fourier, FourierJoint
from fmu_didim.data.signals import Array
from fmu_didim.discovery.excitation.limits import WITHIN, Limits

GRID = 20
"""[1] Instants of a period for each harmonic, at which limits are asked for: between them a series of H harmonics
exceeds its largest value there by a factor of at most 1 / cos(pi / 20), 1.3 % (Ehlich and Zeller 1964)."""
FINE = 400
"""[1] The same where a motion is made as large as its limits allow: WITHIN covers what lies between."""
NOTHING = 1e-12
"""[SI] Size by which is divided where there is none."""


@dataclass(frozen=True)
class Bounds:
    """What a motion must keep.

    Attributes:
        limits: of position, velocity and acceleration; torque: (n,) largest size, N.m or N; infinite without a limit.
        start: (n,) position at which it begins and ends, rad or m; None: anywhere.
    """

    limits: Limits
    torque: Array
    start: Array | None = None

    def __post_init__(self) -> None:
        if self.start is None:
            return
        outside = [
            f"joint {j + 1} at {s:g}, range {low:g} to {high:g}"
            for j, (s, low, high) in enumerate(zip(self.start, self.limits.low, self.limits.high, strict=True))
            if not low < s < high
        ]
        if outside:
            raise InputError(
                "The motion would begin outside the limits.", where="limits.start", got="; ".join(outside),
                valid="between the limits of the position", next_step="Move the start, or widen the range.",
            )  # fmt: skip

    def tightened(self, low: Array, high: Array, speed: Array, torque: Array) -> Bounds:
        """The bounds that a reference must keep so that the loop keeps these, of which these (n,) extremes and sizes
        were simulated: as much less as they were beyond."""
        own = self.limits
        limits = replace(
            own,
            low=own.low + np.maximum(own.low - low, 0.0),
            high=own.high - np.maximum(high - own.high, 0.0),
            speed=own.speed * np.minimum(1.0, own.speed / np.maximum(speed, NOTHING)),
        )
        size = self.torque * np.minimum(1.0, self.torque / np.maximum(torque, NOTHING))
        return Bounds(limits, np.where(np.isfinite(self.torque), size, np.inf), self.start)


@dataclass(frozen=True)
class Basis:
    """Fourier series of n joints as linear functions of free coefficients Z (d, n).

    Attributes:
        fundamental_hz, harmonics, periods: of the motion; joints: n; start: (n,) position at its ends, or None.
    """

    fundamental_hz: float
    harmonics: int
    periods: int
    joints: int
    start: Array | None = None

    def __post_init__(self) -> None:
        if self.harmonics < 2:
            raise InputError(
                "A motion that begins and ends at rest needs two harmonics.", where="harmonics", got=self.harmonics,
                valid="2 or more", next_step="Five are usual.",
            )  # fmt: skip

    @property
    def duration_s(self) -> float:
        """Length of the motion, s."""
        return self.periods / self.fundamental_hz

    @cached_property
    def free(self) -> tuple[Array, Array]:
        """(H, H-1) cosine and sine coefficients of motions at rest at t = 0, orthonormal."""
        k = np.arange(1.0, self.harmonics + 1)
        cosine, sine = (np.linalg.svd(row[None])[2][1:].T for row in (k**2, k))
        return cosine, sine

    def tables(self, time: Array) -> tuple[Array, Array, Array]:
        """(N, d) derivatives of q, dq and ddq at instants (N,) by the coefficients of a joint; the offset comes first,
        where no start is given."""
        cosine, sine = self.free
        k = np.arange(1.0, self.harmonics + 1) * 2 * np.pi * self.fundamental_hz
        c, s = np.cos(np.outer(time, k)), np.sin(np.outer(time, k))
        found = []
        for order, (of_a, of_b) in enumerate(((c, s), (-k * s, k * c), (-(k**2) * c, -(k**2) * s))):
            if self.start is not None and order == 0:
                of_a = of_a - 1.0
            offset = [] if self.start is not None else [np.full((time.size, 1), float(order == 0))]
            found.append(np.hstack([*offset, of_a @ cosine, of_b @ sine]))
        return found[0], found[1], found[2]

    def constant(self) -> Array:
        """(n,) position beside that of the coefficients."""
        return np.zeros(self.joints) if self.start is None else self.start

    def grid(self, density: int = GRID) -> Array:
        """Instants of one period, s, so many a harmonic: by default those at which limits are asked for."""
        count = density * self.harmonics
        return np.arange(count) / (count * self.fundamental_hz)

    def fourier(self, z: Array) -> Fourier:
        """The excitation with coefficients (d, n)."""
        cosine, sine = self.free
        inner = z if self.start is not None else z[1:]
        a, b = cosine @ inner[: self.harmonics - 1], sine @ inner[self.harmonics - 1 :]
        offset = z[0] if self.start is None else self.start - a.sum(axis=0)
        joints = tuple(
            FourierJoint(offset=float(offset[j]), cosine=tuple(a[:, j].tolist()), sine=tuple(b[:, j].tolist()))
            for j in range(self.joints)
        )
        return Fourier(fundamental_hz=self.fundamental_hz, duration_s=self.duration_s, joints=joints)

    def drawn(self, rng: np.random.Generator, limits: Limits) -> Array:
        """(d, n) random coefficients, smaller for higher harmonics, each joint as large as its limits allow and its
        range anywhere inside."""
        k = np.arange(1, self.harmonics + 1)
        cosine, sine = rng.normal(size=(2, self.joints, self.harmonics)) / k
        centre = rng.uniform(0.0, 1.0, size=self.joints)
        return self.scaled(self.projected(cosine, sine), limits, centre)

    def projected(self, cosine: Array, sine: Array) -> Array:
        """(2H-2, n) free coefficients of the series at rest that is nearest to coefficients (n, H)."""
        of_cosine, of_sine = self.free
        return np.vstack([of_cosine.T @ cosine.T, of_sine.T @ sine.T])

    def scaled(self, inner: Array, limits: Limits, centre: Array) -> Array:
        """(d, n) coefficients without offset (2H-2, n) made as large as the limits allow; ``centre``: (n,) from 0 to 1,
        where in the room that is left."""
        skip = 0 if self.start is not None else 1
        q, dq, ddq = (table[:, skip:] @ inner for table in self.tables(self.grid(FINE)))
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
