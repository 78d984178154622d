"""Standard parameters of links that exist, from base parameters that were identified.

Data determine the base parameters b alone, b = chi_b + K chi_d. Of all standard parameters that have them, those are
taken that are nearest to the ones of the description, chi0, in the set of machines
(:mod:`fmu_didim.dynamics.physical_set`):

    min |x - x0|^2      b(x) = b',   P_j(x) >= m 1 for each link j,   Ia_j >= 0

with x = chi over the size of each. b' is b where links have it, and else the nearest that they have, by the covariance
C of b: min (b' - b)' C^-1 (b' - b). Sources: as of that module; for values near known ones T. Lee, P.
M. Wensing, F. C. Park, "Geometric robot dynamic identification: a convex programming approach", IEEE T-RO 36(2), 2020.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import clarabel
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from fmu_didim.base.errors import IdentificationError
from fmu_didim.data.signals import Array
from fmu_didim.dynamics.base_parameters import BaseParameters
from fmu_didim.dynamics.physical_set import ENTRIES, TRIANGLE, PhysicalSet, mass_of
from fmu_didim.dynamics.robot.model import RobotModel

NEAR = 1e-6
"""[1] Weight of what no data show, over the squared standard deviations of what they show, while it is asked which base
parameters links have: it keeps the problem bounded."""
IN_LINKS = 1e4
"""[1] Weight of motor inertias that are to be held by the links, over that of all else."""
NONE = 1e-4
"""[1] Of a motor inertia over the robot's size, below which links hold all of it."""
BALL = {"M": 1.0, "XX": 0.1, "YY": 0.1, "ZZ": 0.1}
"""[1] Of the robot's size: a link whose mass the description does not state, of half the usual length across. With none
at all in its place a link of a SCARA had an inertia of 3 kg.m2 and a mass of a gram."""
MARGIN = 1e-5
"""[1] Smallest eigenvalue of the pseudo-inertia of a link over the robot's size: simulators divide by it."""
SURE = 1e-4
"""[1] Standard deviation over the value, by which each is raised while that is asked: below, solvers round."""
ALIKE = 1e-8
"""[1] The same where a distance is told; and of the largest variance, to which those along all directions are raised,
and of the entries of a pseudo-inertia, which may be off by rounding."""
NOTHING = 1e-12
"""[1] Of the robot's size, below which a value is what solvers leave of zero."""
KEPT = 1e-2
"""[standard deviations] Up to which base parameters that links nearly have are those that were given."""


@dataclass(frozen=True)
class StandardParameters:
    """Standard parameters of links that exist.

    Attributes:
        values: name -> value of all standard parameters.
        base: (b,) base parameters of these; away: standard deviations from those that were given, together.
        moved: names of base parameters that were no friction of a machine, and are zero now.
    """

    values: dict[str, float]
    base: Array
    away: float
    moved: tuple[str, ...] = ()


def standard_parameters(
    model: RobotModel, base: BaseParameters, values: Array, covariance: Array, *, in_links: bool = False
) -> StandardParameters:
    """The standard parameters of links that exist which are nearest to those of a description.

    Args:
        model: with the values of the description; values: (b,) base parameters; covariance: (b, b) of these.
        in_links: whether motor inertias are to be as small as the base parameters allow, for formats without them.

    Raises:
        IdentificationError: the solver fails.
    """
    values = np.array(values, dtype=float)
    physical = PhysicalSet.of(model, base, mass_of(model, base, values))
    negative = [i for i in physical.friction if values[i] < 0]
    values[negative] = 0.0
    x, away = _links(model, physical, values, covariance, in_links=in_links)
    chi = base.known.copy()
    chi[base.index] = values
    chi[physical.places] = np.where(np.abs(x) <= NOTHING, 0.0, x) * physical.sizes
    names = [v.name for v in model.parameters]
    return StandardParameters(
        dict(zip(names, chi.tolist(), strict=True)), base.reduce(chi), away, tuple(base.names[i] for i in negative)
    )


def links_that_cannot_exist(model: RobotModel) -> list[int]:
    """The links of a description, from 1, that no distribution of mass has."""
    values, found = {v.name: v.start for v in model.parameters}, []
    for j in range(1, model.joint_count + 1):
        pseudo = np.zeros((4, 4))
        for stem, entries in ENTRIES.items():
            for (row, column), factor in entries.items():
                pseudo[row, column] += factor * values.get(f"{stem}{j}", 0.0)
        pseudo += np.triu(pseudo, 1).T
        if np.linalg.eigvalsh(pseudo).min() < -ALIKE * np.abs(pseudo).max():
            found.append(j)
    return found


def _links(
    model: RobotModel, physical: PhysicalSet, values: Array, covariance: Array, *, in_links: bool
) -> tuple[Array, float]:
    """(v,) the unknowns, and the standard deviations between base parameters of these and (b,) values."""
    rows = physical.rows
    wanted = _described(model, physical)
    if not rows.size:
        return wanted, 0.0
    right, own = values[rows], covariance[np.ix_(rows, rows)]
    size = np.maximum(np.abs(right), physical.row_scale)
    root, weight = _root(own, SURE * size), np.ones(wanted.size)
    near = _program(physical, root @ physical.map, root @ right, wanted, NEAR * weight, is_sure=False)
    motors = np.flatnonzero(physical.table[: len(physical.motors)].any(axis=0))
    if in_links:
        wanted[motors], weight[motors] = 0.0, IN_LINKS
    scale, there = physical.row_scale, physical.map @ near
    for target in (right, there):
        if target is right and float(np.linalg.norm(root @ (there - right))) > KEPT:
            continue
        with suppress(IdentificationError):
            x = _with_base(physical, target, wanted, weight, motors if in_links else motors[:0])
            x[physical.carriers] += (target - physical.map @ x) / scale
            if _exists(physical, x):
                return x, float(np.linalg.norm(_root(own, ALIKE * size) @ (target - right)))
    return near, float(np.linalg.norm(_root(own, ALIKE * size) @ (there - right)))


def _described(model: RobotModel, physical: PhysicalSet) -> Array:
    """(v,) the unknowns of the description; of links whose mass it does not state those of a ball."""
    values, wanted = model.parameter_values, np.zeros(physical.places.size)
    for k, (place, size) in enumerate(zip(physical.places, physical.sizes, strict=True)):
        name = model.parameters[place].name
        stem = name.rstrip("0123456789")
        stated = values[model.parameter_index(f"M{name.removeprefix(stem)}")] > 0
        wanted[k] = values[place] / size if stated or stem not in ENTRIES else BALL.get(stem, 0.0)
    return wanted


def _with_base(physical: PhysicalSet, target: Array, wanted: Array, weight: Array, motors: NDArray[np.int64]) -> Array:
    """(v,) with these base parameters (r,) of inertia; of the motor inertias those that can be are zero."""
    table, right = physical.map / physical.row_scale[:, None], target / physical.row_scale
    x = _program(physical, table, right, wanted, weight, is_sure=True)
    small = motors[x[motors] < NONE]
    if not small.size:
        return x
    # Taken from a link afterwards, what is left of them would leave it without inertia in another direction.
    none = np.eye(x.size)[small]
    right = np.append(right, np.zeros(small.size))
    x = _program(physical, np.vstack([table, none]), right, wanted, weight, is_sure=True)
    x[small] = 0.0
    return x


def _exists(physical: PhysicalSet, x: Array) -> bool:
    """Whether links with these unknowns (v,) have some inertia in all directions."""
    slack = physical.fixed + physical.table @ x
    smallest = np.linalg.eigvalsh(physical.matrices(slack)).min(initial=np.inf)
    return bool((slack[: len(physical.motors)] >= 0).all() and smallest > 0)


def _root(covariance: Array, least: Array) -> Array:
    """(r, r) W with W' W the inverse of a covariance (r, r) to which variances least^2 (r,) are added."""
    whole = covariance + np.diag(least**2)
    size = np.sqrt(np.diag(whole))
    eigenvalues, vectors = np.linalg.eigh(whole / np.outer(size, size))
    eigenvalues = np.maximum(eigenvalues, ALIKE * eigenvalues.max(initial=0.0))
    return np.asarray((vectors / np.sqrt(eigenvalues)).T / size)


def _program(
    physical: PhysicalSet, table: Array, right: Array, wanted: Array, weight: Array, *, is_sure: bool
) -> Array:
    """(v,) x of links that exist with the least sum of weight (x - wanted)^2, by Clarabel.

    Args:
        table, right: with table x = right where that is sure; else its squared error is added.
    """
    rows, count = table.shape
    motors, width = len(physical.motors), 0 if is_sure else rows
    room = MARGIN * np.tile([float(row == column) for row, column in TRIANGLE], physical.links)
    whole = np.zeros((rows + len(physical.table), count + width))
    whole[:rows, :count], whole[rows:, :count] = table, -physical.table
    whole[:rows, count:] = -np.eye(rows, width)
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    found = clarabel.DefaultSolver(
        sparse.csc_matrix(sparse.diags_array(np.append(weight, np.ones(width)), format="csc")),
        np.append(-weight * wanted, np.zeros(width)), sparse.csc_matrix(whole),
        np.concatenate([right, physical.fixed[:motors], physical.fixed[motors:] - room]),
        [
            clarabel.ZeroConeT(rows), clarabel.NonnegativeConeT(motors),
            *(clarabel.PSDTriangleConeT(4) for _ in range(physical.links)),
        ], settings,
    ).solve()  # fmt: skip
    if found.status not in (clarabel.SolverStatus.Solved, clarabel.SolverStatus.AlmostSolved):
        raise IdentificationError(
            "No links were found that have these base parameters, or nearly have them.", got=str(found.status),
            next_step="Check the values of the robot description that are not identified.",
        )  # fmt: skip
    return np.array(found.x)[:count]
