"""What is known of a robot before it moves: a normal distribution of its base parameters.

How far a link is from its nominal one is measured by the affine-invariant metric of pseudo-inertias P, taken at the
nominal P0:

    d^2 = tr[(P0^-1 (P - P0))^2],        P ~ exp(-d^2 / (2 s^2))

which depends on no choice of frame or unit. In it s is a relative standard deviation: the mass of the link, its second
moment along any axis and every other quadratic form v'P v then have the standard deviation s v'P0 v. The inertial
parameters are linear in P and so normal, with

    cov(P_ij, P_kl) = s^2/2 (P0_ik P0_jl + P0_il P0_jk),

motor inertias and friction are independent of them, and base parameters b = B chi have the mean B chi0 and the
covariance B C B'. What nobody states has no prior; nor has a base parameter that it is a part of. Source: T. Lee,
P. M. Wensing, F. C. Park, "Geometric Robot Dynamic Identification: A Convex Programming Approach", IEEE Transactions on
Robotics 36(2), 2020, whose metric is half of this one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from fmu_didim.base.errors import InputError
from fmu_didim.data.signals import Array
from fmu_didim.dynamics.base_parameters import BaseParameters
from fmu_didim.dynamics.physical_set import ENTRIES, TRIANGLE
from fmu_didim.dynamics.robot.model import RobotModel

THIN = 1e-9
"""[1] Smallest eigenvalue, relative, of a pseudo-inertia scaled to ones on its diagonal: a link that is thinner has no
extent in some direction, of which a relative deviation would say that it is known without error."""
NOTHING = 1e-9
"""[1] Singular values, relative to the largest, that are rounding."""


@dataclass(frozen=True)
class Prior:
    """A normal distribution of the base parameters b, as rows of a least squares problem: rows b - target has
    independent entries of variance one.

    Attributes:
        rows: (r, b); target: (r,).
        mean: (b,); deviation: (b,), infinite for those that have no prior.
        source: where it comes from, in words.
        open: base parameter -> those of its parts that have no prior, because of which it has none.
        doubted: why what it comes from is doubtful, in words; empty where it is not.
    """

    rows: Array
    target: Array
    mean: Array
    deviation: Array
    source: str
    open: Mapping[str, tuple[str, ...]]
    doubted: str = ""

    def padded(self, count: int) -> Array:
        """(r, p) rows for ``count`` values, the first of which are the base parameters."""
        return np.pad(self.rows, ((0, 0), (0, count - self.rows.shape[1])))

    def residual(self, values: Array) -> Array:
        """(r,) what values (p,) leave of the target."""
        return np.asarray(self.target - self.rows @ values[: self.rows.shape[1]])


def link_covariance(values: Array, relative: float) -> Array:
    """(10, 10) covariance of the inertial parameters of a link, in the order of ``ENTRIES``.

    Args:
        values: (10,) nominal ones; relative: standard deviation s.

    Raises:
        ValueError: no body that extends in three directions has these values.
    """
    map_ = _map()
    triangle = map_ @ values
    nominal = np.zeros((4, 4))
    for place, (i, j) in enumerate(TRIANGLE):
        nominal[i, j] = nominal[j, i] = triangle[place]
    diagonal = np.diag(nominal)
    if not (diagonal > 0).all():
        raise ValueError("no mass" if diagonal[3] <= 0 else "negative second moments")
    if np.linalg.eigvalsh(nominal / np.sqrt(np.outer(diagonal, diagonal)))[0] < THIN:
        raise ValueError("a pseudo-inertia that is not positive definite")
    i, j = np.array(TRIANGLE).T
    spread = nominal[np.ix_(i, i)] * nominal[np.ix_(j, j)] + nominal[np.ix_(i, j)] * nominal[np.ix_(j, i)]
    inverse = np.linalg.inv(map_)
    return np.asarray(0.5 * relative**2 * inverse @ spread @ inverse.T)


def _map() -> Array:
    """(10, 10) from inertial parameters to the upper triangle of the pseudo-inertia."""
    result = np.zeros((len(TRIANGLE), len(ENTRIES)))
    for column, entries in enumerate(ENTRIES.values()):
        for entry, factor in entries.items():
            result[TRIANGLE.index(entry), column] = factor
    return result


def prior_of(
    model: RobotModel,
    base: BaseParameters,
    nominal: Mapping[str, float],
    *,
    links: Mapping[int, float],
    single: Mapping[str, float],
    source: str,
) -> Prior:
    """The prior of the base parameters of a robot.

    Parameters that act and are not identified count as known, with their value, unless that is zero, which means not
    stated.

    Args:
        nominal: standard parameter -> value that the prior is about; all that is stated below must be among them.
        links: joint, from 1 -> relative standard deviation of the pseudo-inertia of its link.
        single: other standard parameter -> its standard deviation, in its unit.

    Raises:
        InputError: a link is no body, or nothing is left that the prior says something of.
    """
    names = base.standard_names
    place = {name: i for i, name in enumerate(names)}
    mean, covariance = np.zeros(len(names)), np.zeros((len(names), len(names)))
    stated = np.zeros(len(names), dtype=np.bool_)
    for joint, relative in links.items():
        own = np.array([place[f"{stem}{joint}"] for stem in ENTRIES])
        values = np.array([nominal[names[i]] for i in own])
        try:
            found = link_covariance(values, relative)
        except ValueError as error:
            raise InputError(
                f"The prior needs a link {joint} that is a body: its values have {error}.", where=f"prior, {source}",
                got=", ".join(f"{names[i]} = {v:.4g}" for i, v in zip(own, values, strict=True)),
                valid="mass, first moments and six moments of inertia in the frame of the joint, as CAD gives them",
                next_step=f"State M{joint}, MX{joint}, ..., XX{joint}, YY{joint}, ZZ{joint} of the link in a robot "
                "description, name it under towards:, or leave the joint out of relative_std:.",
            ) from error  # fmt: skip
        mean[own], covariance[np.ix_(own, own)] = _given(values, found, base.known[own])
        stated[own] = True
    for name, deviation in single.items():
        mean[place[name]], covariance[place[name], place[name]] = nominal[name], deviation**2
        stated[place[name]] = True
    return _of_base(base, mean, covariance, stated, source)


def prior_of_values(mean: Array, covariance: Array, source: str, doubted: str = "") -> Prior:
    """The prior of base parameters (b,) with a covariance (b, b), such as those of an earlier result."""
    size = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    scale = np.where(size > 0, size, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    kept = values > NOTHING * float(values.max(initial=0.0))
    rows = (vectors[:, kept] / np.sqrt(values[kept])).T / scale
    return Prior(rows, rows @ mean, mean, np.where(size > 0, size, np.inf), source, {}, doubted)


def with_known(prior: Prior | None, count: int, known: Mapping[int, tuple[float, float]], source: str) -> Prior:
    """A prior, or none, with what is known of further values.

    Args:
        count: p of all values; known: place among them -> mean and standard deviation.
    """
    own = Prior(np.zeros((0, count)), np.zeros(0), np.full(count, np.nan), np.full(count, np.inf), "", {})
    if prior is not None:
        missing = count - prior.mean.size
        own = replace(
            prior, rows=prior.padded(count), mean=np.pad(prior.mean, (0, missing), constant_values=np.nan),
            deviation=np.pad(prior.deviation, (0, missing), constant_values=np.inf),
        )  # fmt: skip
    mean, deviation, rows, target = own.mean.copy(), own.deviation.copy(), [own.rows], [own.target]
    for place, (value, sigma) in known.items():
        mean[place], deviation[place] = value, sigma
        rows.append(np.eye(count)[[place]] / sigma)
        target.append(np.array([value / sigma]))
    words = " and ".join(part for part in (own.source, source) if part)
    return Prior(np.vstack(rows), np.concatenate(target), mean, deviation, words, own.open, own.doubted)


def _given(mean: Array, covariance: Array, known: Array) -> tuple[Array, Array]:
    """Mean and covariance of the parameters of a link beside those that are known, which are not zero in ``known``."""
    is_known = known != 0
    if not is_known.any():
        return mean, covariance
    free = ~is_known
    gain = np.linalg.solve(covariance[np.ix_(is_known, is_known)], covariance[is_known]).T
    left = covariance - gain @ covariance[is_known]
    left[is_known], left[:, is_known] = 0.0, 0.0
    moved = mean + gain @ (known - mean)[is_known]
    return np.where(free, moved, known), left


def _of_base(base: BaseParameters, mean: Array, covariance: Array, stated: NDArray[np.bool_], source: str) -> Prior:
    """From mean (ns,) and covariance (ns, ns) of those standard parameters that are stated."""
    whole = np.zeros((base.count, len(base.standard_names)))
    whole[np.arange(base.count), base.index] = 1.0
    whole[:, base.dependent] = base.regrouping
    unknown = whole * ~stated
    center, spread = whole @ np.where(stated, mean, 0.0), whole @ covariance @ whole.T
    is_open = (unknown != 0).any(axis=1)
    deviation = np.where(is_open, np.inf, np.sqrt(np.maximum(np.diag(spread), 0.0)))
    # What is left of the base parameters in directions that no unknown part moves.
    size = np.where(np.diag(spread) > 0, np.sqrt(np.diag(spread)), 1.0)
    seen = (
        linalg.null_space((unknown / size[:, None]).T, rcond=NOTHING).T / size if is_open.any() else np.diag(1 / size)
    )
    values, vectors = np.linalg.eigh(seen @ spread @ seen.T)
    kept = values > NOTHING * max(float(values.max(initial=0.0)), NOTHING)
    if not kept.any():
        parts = sorted({base.standard_names[i] for i in np.flatnonzero((unknown != 0).any(axis=0))})
        raise InputError(
            "The prior says nothing of any base parameter.", where="prior", got=f"no prior of {', '.join(parts)}",
            next_step="State relative_std: of the links, motor_inertia: or friction:, and values that are not zero.",
        )  # fmt: skip
    rows = (vectors[:, kept] / np.sqrt(values[kept])).T @ seen
    told = {
        base.names[i]: tuple(base.standard_names[k] for k in np.flatnonzero(unknown[i]))
        for i in np.flatnonzero(is_open & (np.diag(spread) > 0))
    }
    return Prior(rows, rows @ center, np.where(is_open, np.nan, center), deviation, source, told)
