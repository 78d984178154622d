"""The power of the tests of a residual: how likely a misfit of a given size is doubted, and which size is, with 95 %.

A misfit of size a adds a s to the residual r of a joint, s being its signature. What the fit leaves of it, whitened by
the colour of r, has a part B c along functions of the motion and a rest u. Fisher's F of what k functions explain is
then noncentral with

    lambda(a) = a^2 c'c / (sigma^2 + a^2 u'u / nu),

or a^2 c' (sigma^2 I + a^2 B' diag(u^2) B)^-1 c where that is less, because the test allows for noise that is loud where
the functions are large; and a little less, because the test takes the lesser of both. The functions are those that it
would choose for s alone, one or two. Its threshold is that of the verdict with all corrections; the better of both
counts. The step with all functions is not counted on. Joints have noise of their own:

    power(a) = 1 - prod_j (1 - max_k power_jk(a)).

The test compares two colours (:mod:`fmu_didim.checks.motion.dependence`), and a misfit may pass in part for that which
is learnt without the functions. So lambda is at most what the criteria of both give for a s and what r has beside the
functions: from the size that the formulas give on, larger ones are tried until one has the power. That is done in the
joint where the misfit shows most.

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
    LARGEST_GAIN,
    MOTION_CHANCE,
    OWN_PART,
    JointResidual,
    OwnColours,
    Signature,
    Whitened,
    most_one_by_one,
)
from fmu_didim.data.signals import Array
from fmu_didim.fit.noise.noise import TINY

POWER = 0.95
"""[1] Probability with which a misfit of the stated size is doubted."""
SIZES = 61
"""[sizes] That are compared, at equal ratios: 17 % apart, between which the power is interpolated."""
SMALLEST_PART = 1e-4
"""[1] Of the largest size that is stated, from which they begin."""
EXPLAINED = 0.8
"""[1] Of the squares of a misfit, by the functions that are chosen for it, from which its power does not fall with its
size: SCARA, arm, 11 kinds of misfits."""
GROWTH = 1.3
"""[1] Ratio of sizes that are tried until the power holds with the colours that a misfit leads to, too."""
GROWN = 4.0
"""[1] Of the size by the formulas up to which that is tried: beyond, the misfit passes for coloured noise."""
SLACK = 0.05
"""[1] Of the power, by which the colour of one draw of the noise may lower it."""
MULTIPLE = 9.0
"""[1] Of a size at which it is asked whether a misfit passes for the colour of the noise, if no functions explain it:
then no size is stated."""
FAINT = 0.1
"""[1] Of the strength of a misfit in the joint where it shows most, below which another joint adds no power."""
ROUNDING = 1e-10
"""[1] Of the squares of a misfit, up to which what is left of it is rounding: signatures have seven digits. By that the
second function was chosen where the first one is the misfit itself, and sizes changed by up to 7 % with it, or there
was none."""
LESS_OF_TWO = 1 / np.sqrt(2 * np.pi)
"""[1] Of the relative uncertainty of the noise where functions are large, by which the lesser of both tests falls below
the other one: the mean of the positive part of a normal distribution."""
LARGEST_NONCENTRALITY = 3000.0
"""[1] Of Fisher's F up to which its power is known: there it is one with ten samples, too."""
POINTS = 90
"""[points] At which it is computed."""
NONCENTRALITIES = np.concatenate([[0.0], np.geomspace(1.0, LARGEST_NONCENTRALITY, POINTS)])
"""[1] Of Fisher's F, between which its power is interpolated."""


@dataclass(frozen=True)
class Functions:
    """Functions of the motion that a step of the test takes together.

    Attributes:
        places: of them among all; all: functions and misfits, whitened by the colour of the residual.
        ways: to choose so many; freedom: degrees of freedom that the functions leave of the residual.
    """

    places: tuple[int, ...]
    all: Whitened
    ways: int
    freedom: float

    @property
    def count(self) -> int:
        """Number k of the functions."""
        return len(self.places)

    def basis(self) -> Array:
        """(N, k) orthonormal; it is not kept: those of many misfits are as large as the log."""
        return orthonormal(self.all.own(self.places))

    def seen(self, misfit: Array) -> Seen:
        """What they see of a misfit (N,)."""
        noise, basis = self.all.rest, self.basis()
        along = basis.T @ misfit
        rest = misfit - basis @ along
        loudness = (basis * noise[:, None] ** 2).T @ basis  # the covariance by the noise where they are large
        root = np.linalg.cholesky(loudness + TINY * np.eye(self.count) * np.trace(loudness))
        own = np.linalg.solve(root, along)
        loud, axes = np.linalg.eigh(_both_sides(root, (basis * rest[:, None] ** 2).T @ basis))
        combined = basis @ along / max(float(np.linalg.norm(along)), TINY)
        return Seen(
            self, float(along @ along), float(rest @ rest), (axes.T @ own) ** 2, np.maximum(loud, 0.0),
            1 - LESS_OF_TWO * _uncertainty(combined),
        )  # fmt: skip


@dataclass(frozen=True)
class Seen:
    """What a step of the test sees of a misfit of size one, of which no table is kept.

    Attributes:
        step: its functions; along, rest: squares along them, and of what they leave.
        parts: (k,) squares along the axes of the noise where they are large; loud: (k,) what the misfit adds there.
        lesser: part that the lesser of both tests sees of each of them.
    """

    step: Functions
    along: float
    rest: float
    parts: Array
    loud: Array
    lesser: float

    def noncentrality(self, sizes: Array) -> Array:
        """(K,) of misfits of these sizes (K,)."""
        noise, freedom, square = self.step.all.rest, self.step.freedom, sizes**2
        variance = float(noise @ noise) / freedom
        usual = square * self.along / (variance + square * self.rest / freedom)
        robust = np.sum(square[:, None] * self.parts / (1 + square[:, None] * self.loud), axis=1)
        both = np.minimum(usual, robust * freedom / noise.size)
        return np.asarray(both * self.lesser)


def _both_sides(root: Array, square: Array) -> Array:
    """R^-1 A R^-T of a lower triangle R and a symmetric A, (k, k) each."""
    found = np.linalg.solve(root, np.linalg.solve(root, square).T)
    return np.asarray(0.5 * (found + found.T))


def _uncertainty(combined: Array) -> float:
    """Relative standard deviation of the variance of white noise where a function (N,) of length one is large."""
    return min(float(np.sqrt(2 * np.sum(combined**2 * combined**2))), 1.0)


@dataclass(frozen=True)
class JointTest:
    """The test of a joint as it was made, and misfits of size one in it.

    Attributes:
        level: of the p value below which it doubts; one: what it looks at.
        signatures: (N,) of each misfit.
        functions: those of the motion that the test chooses from, as places among all; first: place of the first
            misfit behind them.
        all: functions and misfits, whitened by the colour of the residual.
    """

    level: float
    one: JointResidual
    signatures: Sequence[Signature]
    functions: tuple[int, ...]
    first: int
    all: Whitened

    @classmethod
    def of(cls, one: JointResidual, signatures: Sequence[Signature], joints: int) -> JointTest | None:
        """With the signatures (N,) at the joint; None where it was not tested."""
        if one.room < 1:
            return None
        found, first = one.tested.with_signatures(signatures).whitened, len(one.tested.places)
        functions = np.flatnonzero(found.power[:first])
        return cls(MOTION_CHANCE / joints, one, signatures, tuple(functions.tolist()), first, found)

    def trial(self, misfit: int, size: float, enough: float = np.inf) -> float:
        """Probability of a doubt by a misfit, by its place, of this size, with the colours that it leads to; where a
        step of the test has as much as is ``enough``, the others, each of which has a colour to learn, are left out,
        and where it sees no more than another one has, or with any colour as much as it can, no further colour is."""
        seen = self.seen(misfit)
        if not seen:
            return 0.0
        functions = self._functions(seen[-1].step.places)
        residual = self._rest(functions) + size * self.signatures[misfit]
        tested = OwnColours.of(residual, self.one.left.used).with_functions(functions)
        found, samples = 0.0, tested.columns.logs.samples
        for one in reversed(seen):
            if found >= enough:
                break
            step, powers = one.step, self._powers(one.step)
            most = float(one.noncentrality(np.array([size]))[0])
            if np.interp(most, NONCENTRALITIES, powers) <= found:
                continue
            asked = min(most, _least_of(powers, enough))
            own = tested.beside(range(step.count), tested.alone.criterion - samples * np.log1p(asked / step.freedom))
            gain = max(tested.alone.criterion - own.criterion, 0.0)
            likely = step.freedom * np.expm1(min(gain / samples, LARGEST_GAIN))
            found = max(found, float(np.interp(min(float(likely), most), NONCENTRALITIES, powers)))
        return found

    def _functions(self, places: Sequence[int]) -> Array:
        """(N, k) functions, as they are."""
        return self.all.columns.rows_of(self.all.places(places))

    def _rest(self, functions: Array) -> Array:
        """(N,) what the sensitivities and functions (N, k) leave of the residual."""
        basis = self.one.basis
        further = orthonormal(rest_of(functions, basis))
        return rest_of(rest_of(self.one.residual, basis), further)

    def strength(self, misfit: int) -> float:
        """Squares of a misfit, by its place, over those of the residual."""
        at = self.first + misfit
        return float(self.all.products[at, at]) / max(float(self.all.rest @ self.all.rest), TINY)

    def explained(self, misfit: int) -> float:
        """Part of the squares of a misfit, by its place, that the functions chosen for it explain."""
        seen = self.seen(misfit)
        return seen[-1].along / max(seen[-1].along + seen[-1].rest, TINY) if seen else 0.0

    def misfit(self, place: int) -> Array:
        """(M,) what they leave of a misfit."""
        return self.all.own([self.first + place])[:, 0]

    def power(self, misfit: int, sizes: Array) -> Array:
        """(K,) probability of a doubt by a misfit, by its place, of these sizes (K,)."""
        found = np.zeros(sizes.size)
        for one in self.seen(misfit):
            found = np.maximum(found, np.interp(one.noncentrality(sizes), NONCENTRALITIES, self._powers(one.step)))
        return found

    def seen(self, misfit: int) -> list[Seen]:
        """What the steps of the test see of a misfit, by its place, for all sizes."""
        if misfit not in self._seen:
            signature, steps = self.misfit(misfit), self.steps(misfit)
            self._seen[misfit] = [step.seen(signature) for step in steps]
        return self._seen[misfit]

    def steps(self, misfit: int) -> list[Functions]:
        """The steps of the test that a misfit, by its place, alone would lead to: with the function that explains most,
        and with it and the one that then explains most, if anything is left."""
        places, products, at = list(self.functions), self.all.products, self.first + misfit
        found = most_one_by_one(products[np.ix_(places, places)], products[places, at], OWN_PART**2)
        chosen = [place for place, squares in found if squares > ROUNDING * products[at, at]]
        return [self._together([places[k] for k in chosen[: count + 1]]) for count in range(len(chosen))]

    def _together(self, chosen: Sequence[int]) -> Functions:
        """Some functions, by their places among all."""
        freedom = self.all.rest.size - self.one.basis.shape[1] - len(chosen)
        return Functions(tuple(chosen), self.all, comb(len(self.functions), len(chosen)), max(freedom, 1))

    def _powers(self, step: Functions) -> Array:
        """Power at ``NONCENTRALITIES``; the level of the test is divided by its steps, that with all functions among
        them."""
        key, steps = (step.count, step.ways), min(FUNCTIONS, len(self.functions)) + 1
        if key not in self._known:
            bound = float(f_isf(self.level / (steps * step.ways), step.count, step.freedom))
            self._known[key] = f_power(bound, step.count, step.freedom, NONCENTRALITIES)
        return self._known[key]

    @cached_property
    def _known(self) -> dict[tuple[int, int], Array]:
        return {}

    @cached_property
    def _seen(self) -> dict[int, list[Seen]]:
        return {}


def _least_of(powers: Array, enough: float) -> float:
    """The least of ``NONCENTRALITIES`` that has as much power (K,) as is enough; infinite where none has."""
    (there,) = np.nonzero(powers >= enough)
    return float(NONCENTRALITIES[there[0]]) if there.size else np.inf


def smallest_size(tests: Sequence[JointTest], misfit: int, largest: float) -> float | None:
    """The smallest size of a misfit, by its place, from which on all sizes up to the largest are doubted with the power
    ``POWER``; None if there is none.

    A misfit that no functions explain may pass for the colour of the noise, the more the larger it is: then none is
    stated. That is asked of the joint where it shows most.
    """
    strengths = [test.strength(misfit) for test in tests]
    tests = [test for test, strength in zip(tests, strengths, strict=True) if strength >= FAINT * max(strengths)]
    sizes = np.geomspace(SMALLEST_PART * largest, largest, SIZES)
    powers = [test.power(misfit, sizes) for test in tests]
    first = _reached(sizes, 1 - np.prod([1 - power for power in powers], axis=0))
    if first is None:
        return None
    best = int(np.argmax([np.interp(first, sizes, power) for power in powers]))

    def with_colours(size: float, enough: float = np.inf) -> float:
        others = [np.interp(size, sizes, power) for j, power in enumerate(powers) if j != best]
        missed = float(np.prod([1 - power for power in others]))
        own = 1 - (1 - enough) / missed if missed > 0 else 0.0
        return 1 - missed * (1 - tests[best].trial(misfit, size, own))

    size, before = first, None
    power = with_colours(size, POWER)
    while power < POWER:
        before, size = (size, power), GROWTH * size
        if size > min(GROWN * first, largest):
            return None
        power = with_colours(size)
    if before is not None:
        part = (POWER - before[1]) / (power - before[1])
        size = before[0] * (size / before[0]) ** part
    beyond = MULTIPLE * size
    if (
        tests[best].explained(misfit) < EXPLAINED
        and beyond <= largest
        and with_colours(beyond, POWER - SLACK) < POWER - SLACK
    ):
        return None
    return size


def _reached(sizes: Array, power: Array) -> float | None:
    """The size from which on ``POWER`` is reached by all (K,); None if the last one does not."""
    seen = power >= POWER
    if not seen[-1]:
        return None
    if seen.all():
        return float(sizes[0])
    first = int(np.flatnonzero(~seen)[-1])
    between = slice(first, first + 2)
    return float(np.exp(np.interp(POWER, power[between], np.log(sizes[between]))))
