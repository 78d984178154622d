"""Essential parameters: those without which a model explains the data worse than noise does.

A set D of parameters is not needed where zero is a value that the data do not exclude, for all of them together:

    F = v_D' C_DD^-1 v_D / |D|  <=  the 95 % quantile of F(|D|, nu)

with the values v (p,) and covariance C (p, p) of the full model, by the colour of its residual, and nu degrees of
freedom. The others move, and are known better, as if D was known to be zero:

    v_K := v_K - C_KD C_DD^-1 v_D,      C_KK := C_KK - C_KD C_DD^-1 C_DK

so that of two parameters that hide each other one stays. The one with the largest relative standard deviation goes
first; it goes where it is not significant by itself beside those that have gone, and the whole set is not either.

Sources: C. M. Pham, M. Gautier, "Essential parameters of robots", CDC 1991; G. A. F. Seber, A. J. Lee, "Linear
Regression Analysis", 2003, chapter 4 (test of a linear hypothesis).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from fmu_didim.base.distributions import f_ppf, f_sf
from fmu_didim.data.signals import Array
from fmu_didim.fit.gap import Ratio
from fmu_didim.fit.statistics import CONFIDENCE
from fmu_didim.model.loop_model import LoopModel

WORSE = 1.05
"""[1] Ratio of the held-out residuals of a reduced and the full model, up to which the reduced one serves as well: less
than two motions of one machine differ by."""


@dataclass(frozen=True)
class Elimination:
    """Which parameters are not needed.

    Attributes:
        left_out: places, in the order in which they go.
        values: (p,) of all others, zero for those; covariance: (p, p).
        f: of all that go, together; limit: its 95 % quantile; p_value: probability of a larger one, were all zero.
        needed: place of each that the data do not need, but the model -> why.
    """

    left_out: tuple[int, ...]
    values: Array
    covariance: Array
    f: float
    limit: float
    p_value: float
    needed: Mapping[int, str]


@dataclass(frozen=True)
class Essential:
    """The reduced model of an estimate.

    Attributes:
        left_out: names of the parameters that it does without, in the order in which they went.
        f, limit, p_value: of them together, as of :class:`Elimination`; NaN where none went.
        needed: name of each that the data do not need, but the model -> why.
        put_back: names of those that went by the F-test and came back; because: why.
        model: with the values that it has by itself; None where nothing is left out.
        covariance: (k, k) of its values, as if what is left out was zero.
        error_percent: of its fitted torque, beside that of the full model ``full_percent``.
        held_out: ratio of its held-out residual to that of the full model, over all joints, and of each; empty without
            held-out data.
    """

    left_out: tuple[str, ...] = ()
    f: float = np.nan
    limit: float = np.nan
    p_value: float = np.nan
    needed: Mapping[str, str] = field(default_factory=dict)
    put_back: tuple[str, ...] = ()
    because: str = ""
    model: LoopModel | None = None
    covariance: Array | None = None
    error_percent: float = np.nan
    full_percent: float = np.nan
    held_out: tuple[Ratio, ...] = ()


def as_if_zero(values: Array, covariance: Array, places: Sequence[int]) -> tuple[Array, Array]:
    """Values (p,) and covariance (p, p) of all parameters where those at these places are known to be zero."""
    zero = list(places)
    found, rest = values.copy(), covariance.copy()
    if zero:
        gain = _divided(covariance[np.ix_(zero, zero)], covariance[zero]).T
        found, rest = values - gain @ values[zero], covariance - gain @ covariance[zero]
    found[zero], rest[zero], rest[:, zero] = 0.0, 0.0, 0.0
    return found, 0.5 * (rest + rest.T)


def f_of_zero(values: Array, covariance: Array, places: Sequence[int]) -> float:
    """F of the hypothesis that the parameters at these places are zero, all of them."""
    zero = list(places)
    return float(values[zero] @ _divided(covariance[np.ix_(zero, zero)], values[zero]) / len(zero))


def eliminated(
    values: Array, covariance: Array, freedom: float, candidates: Sequence[int], problem: Callable[[Array], str]
) -> Elimination:
    """The parameters that are not needed.

    Args:
        values: (p,); covariance: (p, p); freedom: degrees of freedom of the residual.
        candidates: places of those that may be left out.
        problem: why a model cannot have values (p,), or an empty string.
    """
    out, needed, left = list[int](), dict[int, str](), list(candidates)
    now, known = values, covariance
    while left:
        square = {i: now[i] ** 2 / known[i, i] if known[i, i] > 0 else np.inf for i in left}
        least = min(left, key=square.__getitem__)
        further = [*out, least]
        alone, together = f_ppf(CONFIDENCE, 1, freedom), f_ppf(CONFIDENCE, len(further), freedom)
        if square[least] > alone or f_of_zero(values, covariance, further) > together:
            break
        left.remove(least)
        following = as_if_zero(values, covariance, further)
        if why := problem(following[0]):
            needed[least] = why
            continue
        out, (now, known) = further, following
    return without(values, covariance, freedom, out, needed)


def without(
    values: Array, covariance: Array, freedom: float, places: Sequence[int], needed: Mapping[int, str]
) -> Elimination:
    """What is left without the parameters at these places; ``needed``: as of :class:`Elimination`."""
    less, known = as_if_zero(values, covariance, places)
    if not places:
        return Elimination((), less, known, np.nan, np.nan, np.nan, needed)
    f, count = f_of_zero(values, covariance, places), len(places)
    limit, chance = float(f_ppf(CONFIDENCE, count, freedom)), float(f_sf(f, count, freedom))
    return Elimination(tuple(places), less, known, f, limit, chance, needed)


def _divided(matrix: Array, right: Array) -> Array:
    """matrix^-1 right, of a covariance (d, d) whose sizes may differ by many orders."""
    size = np.sqrt(np.diag(matrix))
    scaled = matrix / np.outer(size, size)
    return np.asarray((np.linalg.lstsq(scaled, (right.T / size).T, rcond=None)[0].T / size).T)
