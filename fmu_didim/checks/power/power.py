"""The power of the tests of a residual: how likely a misfit of a given size is doubted, and which size is, with 80 %.

A misfit of size a adds a s to the residual r of a joint, s being its signature. What the fit leaves of it, whitened as
the test whitens (:mod:`fmu_didim.checks.motion.dependence`), has a part B c along functions of the motion and a
rest u. Fisher's F of what k functions explain is then noncentral with

    lambda(a) = a^2 c'c / (sigma^2 + a^2 u'u / nu),

or a^2 c' (sigma^2 I + a^2 B' diag(u^2) B)^-1 c where that is less, because the test allows for noise that is loud where
the functions are large. The functions are those that the test would choose for s alone, one or two. Its threshold is
that of the verdict with all corrections; the better of both steps counts. The step with all functions is not counted
on: the noise that it is judged by has the colour of the misfit. Joints have noise of their own:

    power(a) = 1 - prod_j (1 - max_k power_jk(a)).

Source: S. M. Kay, Fundamentals of Statistical Signal Processing, vol. 2, 1998, chapter 7.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import comb

import numpy as np

from fmu_didim.base.distributions import f_isf, f_power
from fmu_didim.checks.motion.colour import orthonormal, rest_of
from fmu_didim.checks.motion.dependence import (
    FUNCTIONS,
    MOTION_CHANCE,
    OWN_PART,
    SAMPLES_A_FUNCTION,
    JointResidual,
    independent,
)
from fmu_didim.data.signals import Array
from fmu_didim.fit.noise.noise import TINY

POWER = 0.8
"""[1] Probability with which a misfit of the stated size is doubted."""
SIZES = 121
"""[sizes] That are compared, at equal ratios: 8 % apart, between which the power is interpolated."""
SMALLEST_PART = 1e-4
"""[1] Of the largest size that is stated, from which they begin."""
NONCENTRALITIES = np.concatenate([[0.0], np.geomspace(1.0, 3000.0, 90)])
"""[1] Of Fisher's F, between which its power is interpolated."""


@dataclass(frozen=True)
class Functions:
    """Functions of the motion that a step of the test takes together.

    Attributes:
        basis: (N, k) orthonormal; ways: to choose so many.
        noise: (N,) residual; freedom: degrees of freedom that the functions leave of it.
    """

    basis: Array
    ways: int
    noise: Array
    freedom: float

    @property
    def count(self) -> int:
        """Number k of the functions."""
        return int(self.basis.shape[1])

    @cached_property
    def _root(self) -> Array:
        """(k, k) Cholesky factor of the covariance of what the functions explain, by the noise where they are large."""
        square = (self.basis * self.noise[:, None] ** 2).T @ self.basis
        return np.asarray(np.linalg.cholesky(square + TINY * np.eye(self.count) * np.trace(square)))

    def noncentrality(self, misfit: Array, sizes: Array) -> Array:
        """(K,) of misfits (N,) of these sizes (K,)."""
        square, along = sizes**2, self.basis.T @ misfit
        rest = misfit - self.basis @ along
        variance = float(self.noise @ self.noise) / self.freedom
        usual = square * float(along @ along) / (variance + square * float(rest @ rest) / self.freedom)
        moved = np.linalg.solve(self._root, (self.basis * rest[:, None]).T)
        loud, axes = np.linalg.eigh(moved @ moved.T)
        parts = (axes.T @ np.linalg.solve(self._root, along)) ** 2
        robust = np.sum(square[:, None] * parts / (1 + square[:, None] * np.maximum(loud, 0.0)), axis=1)
        return np.asarray(np.minimum(usual, robust * self.freedom / self.noise.size))


@dataclass(frozen=True)
class JointTest:
    """The test of a joint as it was made, with what the sensitivities leave of the residual (N,), of the functions
    (N, m) and of misfits of size one (N, s), all whitened by its noise.

    Attributes:
        level: of the p value below which it doubts.
        used: how many columns the sensitivities are.
    """

    level: float
    residual: Array
    functions: Array
    misfits: Array
    used: int

    @classmethod
    def of(cls, one: JointResidual, signatures: Array, joints: int) -> JointTest | None:
        """With the signatures (N, s) at the joint; None where it was not tested."""
        used = independent(one.nuisance)
        room = int((one.residual.size - used.shape[1]) / SAMPLES_A_FUNCTION)
        if room < 1:
            return None
        motion, basis = one.motion[:, :room], orthonormal(used)
        noise = one.noise.learnt(rest_of(one.residual, basis), basis)
        table = noise.whitened(np.column_stack([used, one.residual, motion, signatures]))
        count = used.shape[1]
        left = rest_of(table[:, count:], orthonormal(table[:, :count]))
        own, m = left[:, 1 : 1 + motion.shape[1]], motion.shape[1]
        kept = np.linalg.norm(own, axis=0) > OWN_PART * np.linalg.norm(table[:, count + 1 : count + 1 + m], axis=0)
        return cls(MOTION_CHANCE / joints, left[:, 0], own[:, kept], left[:, 1 + m :], count)

    def power(self, misfit: int, sizes: Array) -> Array:
        """(K,) probability of a doubt by a misfit, by its place, of these sizes (K,)."""
        signature = self.misfits[:, misfit]
        steps, found = self.steps(misfit), np.zeros(sizes.size)
        for step in steps:
            lambdas = step.noncentrality(signature, sizes)
            found = np.maximum(found, np.interp(lambdas, NONCENTRALITIES, self._powers(step, len(steps) + 1)))
        return found

    def steps(self, misfit: int) -> list[Functions]:
        """The steps of the test that a misfit, by its place, alone would lead to: with the function that explains most,
        and with it and the one that then explains most."""
        count = self.functions.shape[1]
        table, product = self._products
        product, own, found, chosen = product[:, misfit], np.diag(table).copy(), list[Functions](), list[int]()
        for _ in range(min(FUNCTIONS, count)):
            free = own > OWN_PART**2 * np.diag(self._products[0])
            best = int(np.argmax(np.divide(product**2, own, out=np.zeros(count), where=free)))
            chosen.append(best)
            found.append(self._together(tuple(chosen)))
            beside = table[:, best] / own[best]
            product, table = product - beside * product[best], table - np.outer(beside, table[best])
            own = np.diag(table).copy()
        return found

    @cached_property
    def _products(self) -> tuple[Array, Array]:
        """(m, m) products of the functions with each other, and (m, s) with the misfits."""
        return self.functions.T @ self.functions, self.functions.T @ self.misfits

    def _together(self, chosen: tuple[int, ...]) -> Functions:
        """Some functions; the same ones serve many misfits."""
        if chosen not in self._chosen:
            ways = comb(self.functions.shape[1], len(chosen))
            freedom = max(self.residual.size - self.used - len(chosen), 1)
            self._chosen[chosen] = Functions(orthonormal(self.functions[:, chosen]), ways, self.residual, freedom)
        return self._chosen[chosen]

    def _powers(self, step: Functions, steps: int) -> Array:
        """Power at ``NONCENTRALITIES``; ``steps``: of the test, by which its level is divided."""
        key = (step.count, step.ways)
        if key not in self._known:
            bound = float(f_isf(self.level / (steps * step.ways), step.count, step.freedom))
            self._known[key] = f_power(bound, step.count, step.freedom, NONCENTRALITIES)
        return self._known[key]

    @cached_property
    def _known(self) -> dict[tuple[int, int], Array]:
        return {}

    @cached_property
    def _chosen(self) -> dict[tuple[int, ...], Functions]:
        return {}


def smallest_size(tests: Sequence[JointTest], misfit: int, largest: float) -> float | None:
    """The smallest size of a misfit, by its place, from which on all sizes up to the largest are doubted with the power
    ``POWER``; None if there is none."""
    sizes = np.geomspace(SMALLEST_PART * largest, largest, SIZES)
    missed = np.prod([1 - test.power(misfit, sizes) for test in tests], axis=0)
    seen = 1 - missed >= POWER
    if not seen[-1]:
        return None
    first = int(np.flatnonzero(~seen)[-1]) + 1 if not seen.all() else 0
    if first == 0:
        return float(sizes[0])
    return float(np.exp(np.interp(POWER, 1 - missed[first - 1 : first + 1], np.log(sizes[first - 1 : first + 1]))))
