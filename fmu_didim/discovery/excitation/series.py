"""Fourier series that begin and end at rest, drawn at random or given by free coefficients, within limits.

    q(t) = q0 + sum_k a_k (cos(k w t) - c) + b_k sin(k w t),   sum_k k b_k = 0,   sum_k k^2 a_k = 0

so that velocity and acceleration are zero at t = 0 and after each period; c = 1 where the motion begins at a given
position q0, else 0.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from fmu_didim.base.errors import InputError
from fmu_didim.data.excitation import Fourier, FourierJoint
from fmu_didim.data.signals import Array
from fmu_didim.discovery.excitation.basis import GRID, Basis

HARMONICS = 5
"""[1] Of the motion: usual, and smooth."""


@dataclass(frozen=True)
class Series(Basis):
    """Fourier series.

    Attributes:
        harmonics: H.
    """

    harmonics: int = field(default=HARMONICS, kw_only=True)

    def __post_init__(self) -> None:
        if self.harmonics < 2:
            raise InputError(
                "A motion that begins and ends at rest needs two harmonics.", where="harmonics", got=self.harmonics,
                valid="2 or more", next_step="Five are usual.",
            )  # fmt: skip

    @property
    def inner_count(self) -> int:
        return 2 * (self.harmonics - 1)

    @property
    def fastest(self) -> tuple[str, float]:
        return "The highest harmonic", self.harmonics * self.fundamental_hz

    @property
    def room(self) -> float:
        return float(np.cos(np.pi / GRID))

    @cached_property
    def free(self) -> tuple[Array, Array]:
        """(H, H-1) cosine and sine coefficients of motions at rest at t = 0, orthonormal."""
        k = np.arange(1.0, self.harmonics + 1)
        cosine, sine = (np.linalg.svd(row[None])[2][1:].T for row in (k**2, k))
        return cosine, sine

    def inner(self, time: Array) -> tuple[Array, Array, Array]:
        cosine, sine = self.free
        k = np.arange(1.0, self.harmonics + 1) * 2 * np.pi * self.fundamental_hz
        c, s = np.cos(np.outer(time, k)), np.sin(np.outer(time, k))
        found = []
        for order, (of_a, of_b) in enumerate(((c, s), (-k * s, k * c), (-(k**2) * c, -(k**2) * s))):
            if self.start is not None and order == 0:
                of_a = of_a - 1.0
            found.append(np.hstack([of_a @ cosine, of_b @ sine]))
        return found[0], found[1], found[2]

    def grid(self, density: int = GRID) -> Array:
        count = density * self.harmonics
        return np.arange(count) / (count * self.fundamental_hz)

    def excitation(self, z: Array) -> Fourier:
        cosine, sine = self.free
        inner = z if self.start is not None else z[1:]
        a, b = cosine @ inner[: self.harmonics - 1], sine @ inner[self.harmonics - 1 :]
        offset = z[0] if self.start is None else self.start - a.sum(axis=0)
        joints = tuple(
            FourierJoint(offset=float(offset[j]), cosine=tuple(a[:, j].tolist()), sine=tuple(b[:, j].tolist()))
            for j in range(self.joints)
        )
        return Fourier(fundamental_hz=self.fundamental_hz, duration_s=self.duration_s, joints=joints)

    def drawn_inner(self, rng: np.random.Generator) -> Array:
        k = np.arange(1, self.harmonics + 1)  # smaller for higher harmonics
        cosine, sine = rng.normal(size=(2, self.joints, self.harmonics)) / k
        return self.projected(cosine, sine)

    def projected(self, cosine: Array, sine: Array) -> Array:
        """(2H-2, n) free coefficients of the series at rest that is nearest to coefficients (n, H)."""
        of_cosine, of_sine = self.free
        return np.vstack([of_cosine.T @ cosine.T, of_sine.T @ sine.T])
