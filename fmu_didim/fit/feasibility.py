"""The values nearest to an estimate that physical links can have.

    min  (b - b_hat)' C^-1 (b - b_hat)     b = chi_b + K chi_d,   P_j(chi) >= 0 of each link j,   Ia >= 0

over all standard parameters chi, with the pseudo-inertia of each link

    P = [ tr(I)/2 1 - I   h ]       I = [XX XY XZ; XY YY YZ; XZ YZ ZZ],   h = (MX, MY, MZ)
        [       h'        M ]

positive semidefinite if and only if some distribution of positive mass has these inertial parameters: a convex problem.
Sources: P. M. Wensing, S. Kim, J.-J. E. Slotine, "Linear Matrix Inequalities for Physically Consistent Inertial
Parameter Identification", IEEE RA-L 3(1), 2018; C. D. Sousa, R. Cortesao, "Physical feasibility of robot base inertial
parameter identification: a linear matrix inequality approach", IJRR 33(6), 2014.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import clarabel
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from fmu_didim.base.errors import IdentificationError
from fmu_didim.data.signals import Array
from fmu_didim.dynamics.base_parameters import BaseParameters
from fmu_didim.dynamics.robot import RobotModel

SMALLEST_DEVIATION = 1e-6
"""[1] Smallest relative standard deviation of a value: data without noise need weights, too."""
TOUCHES = 0.01
"""[standard deviations] Values that are nearer to physical ones are physical: the solver's rest."""
MASS_ALONE = 1e-6
"""[1] Weight of parameters that no data show, such as the mass of the first link, against squared standard deviations,
which keeps the problem bounded."""

MOTOR_INERTIA = "Ia"
_ENTRIES = {
    "XX": {(0, 0): -0.5, (1, 1): 0.5, (2, 2): 0.5}, "YY": {(0, 0): 0.5, (1, 1): -0.5, (2, 2): 0.5},
    "ZZ": {(0, 0): 0.5, (1, 1): 0.5, (2, 2): -0.5}, "XY": {(0, 1): -1.0}, "XZ": {(0, 2): -1.0}, "YZ": {(1, 2): -1.0},
    "MX": {(0, 3): 1.0}, "MY": {(1, 3): 1.0}, "MZ": {(2, 3): 1.0}, "M": {(3, 3): 1.0},
}  # fmt: skip
"""Parameter of a link -> its entries in the upper triangle of the pseudo-inertia."""
_SPLIT = re.compile(r"(\w*?)(\d+)")
_TRIANGLE = [(row, column) for column in range(4) for row in range(column + 1)]


@dataclass(frozen=True)
class Nearest:
    """The nearest physical values.

    Attributes:
        values: (b,) base parameters; those of friction and the like as they were.
        distance: sqrt of the minimum, in standard deviations; constraints: how many independent ones hold it back.
        link: number of the link whose inertia has the largest part in that, from 1; 0 where nothing holds it back.
        parameter: place of the base parameter that moves farthest, in standard deviations.
    """

    values: Array
    distance: float
    constraints: int
    link: int
    parameter: int


def nearest_physical(
    model: RobotModel,
    base: BaseParameters,
    values: Array,
    covariance: Array,
    *,
    margin: float = 0.0,
    alone: int | None = None,
) -> Nearest:
    """The base parameters nearest to values (b,) with covariance (b, b) that physical links can have.

    Parameters that act and are not identified keep their values, unless those are zero, which means not stated.

    Args:
        margin: smallest eigenvalue of the pseudo-inertias, as a fraction of the robot's size, for values that are to be
            simulated.
        alone: place of the one base parameter that counts; the others are taken as unknown.

    Raises:
        IdentificationError: no physical links have what is known of the robot, or the solver fails.
    """
    problem = _problem(model, base, values, alone)
    rows = problem.rows
    if not rows.size:
        return Nearest(values.copy(), 0.0, 0, 0, 0)
    least = SMALLEST_DEVIATION * np.maximum(np.abs(values[rows]), SMALLEST_DEVIATION * problem.row_scale)
    covered = covariance[np.ix_(rows, rows)] + np.diag(least**2)
    deviation = np.sqrt(np.diag(covered))
    factor = np.linalg.cholesky(covered / np.outer(deviation, deviation))
    table = np.asarray(np.linalg.solve(factor, problem.map / deviation[:, None]))
    target = np.asarray(np.linalg.solve(factor, values[rows] / deviation))
    x, dual, slack = _solved(problem, table, target, margin)
    moved = problem.map @ x - values[rows]
    result = values.copy()
    result[rows] += moved
    distance = float(np.linalg.norm(np.linalg.solve(factor, moved / deviation)))
    farthest = int(rows[np.argmax(np.abs(moved / deviation))])
    if distance < TOUCHES:
        return Nearest(result, distance, 0, 0, farthest)
    return Nearest(result, distance, problem.held_back(dual, slack), problem.link_of(moved, dual), farthest)


@dataclass(frozen=True)
class _Problem:
    """The unknowns x (v,), standard parameters divided by their scale, and the inequalities fixed + table x >= 0.

    Attributes:
        rows: (r,) places of the base parameters that belong to inertia, which are map (r, v) times x; row_scale: (r,).
        carriers: (r,) unknown that carries each of them.
        table: (m, v) and fixed: (m,), first those of motor inertias, then the upper triangles of the pseudo-inertias,
            what is not on the diagonal times sqrt(2); motors: (k,) joints of the former, from 1.
    """

    rows: NDArray[np.int64]
    row_scale: Array
    map: Array
    carriers: NDArray[np.int64]
    table: Array
    fixed: Array
    motors: tuple[int, ...]

    def matrices(self, stacked: Array) -> Array:
        """(n, 4, 4) of the part of (m,) that holds triangles."""
        triangles = stacked[len(self.motors) :].reshape(-1, len(_TRIANGLE))
        result = np.zeros((triangles.shape[0], 4, 4))
        for place, (row, column) in enumerate(_TRIANGLE):
            factor = 1.0 if row == column else np.sqrt(0.5)
            result[:, row, column] = result[:, column, row] = factor * triangles[:, place]
        return result

    def held_back(self, dual: Array, slack: Array) -> int:
        """Dimension of the face on which the solution lies, counted from outside: each inequality of a motor inertia
        is one, a pseudo-inertia that r directions hold back r (r + 1)/2."""
        most = float(np.abs(dual).max())
        count = int((dual[: len(self.motors)] / most > slack[: len(self.motors)]).sum())
        for force, inertia in zip(self.matrices(dual), self.matrices(slack), strict=True):
            # One is zero where the other is not: largest against smallest.
            pairs = np.linalg.eigvalsh(force)[::-1] / most > np.linalg.eigvalsh(inertia)
            count += int(pairs.sum()) * (int(pairs.sum()) + 1) // 2
        return max(1, min(count, self.rows.size))

    def link_of(self, moved: Array, dual: Array) -> int:
        """The link, from 1, whose inequalities hold most of the way from the estimate back."""
        change = np.zeros(self.map.shape[1])
        change[self.carriers] = moved / self.row_scale
        parts = dual * (self.table @ change)
        first = len(self.motors)
        by_link = parts[first:].reshape(-1, len(_TRIANGLE)).sum(axis=1)
        for joint, part in zip(self.motors, parts[:first], strict=True):
            by_link[joint - 1] += part
        return int(np.argmax(by_link)) + 1


def _problem(model: RobotModel, base: BaseParameters, values: Array, alone: int | None) -> _Problem:
    joints = model.description.joints
    split = [_SPLIT.fullmatch(name).groups() for name in base.standard_names]  # type: ignore[union-attr]
    stems, places = [stem for stem, _ in split], np.array([int(number) for _, number in split])
    inertial = np.array([stem in _ENTRIES or stem == MOTOR_INERTIA for stem in stems])
    whole = np.zeros((base.count, len(stems)))
    whole[np.arange(base.count), base.index] = 1.0
    whole[:, base.dependent] = base.regrouping
    rows = np.flatnonzero((whole[:, inertial] != 0).any(axis=1))
    free = (whole[rows] != 0).any(axis=0) | inertial & (base.known == 0)
    free |= inertial & ~np.isin(np.arange(len(stems)), model.active)
    lengths = [abs(length) for joint in joints for length in (joint.a, joint.d) if length]
    length = float(np.median(lengths)) if lengths else 1.0
    power = np.array([_power(stem, joints[j - 1].type) for stem, j in zip(stems, places, strict=True)])
    mass = float(np.max(np.abs(values[rows]) / length ** power[base.index[rows]], initial=0.0)) or 1.0
    scale = np.where(inertial, mass * length**power, 1.0)
    if alone is not None:
        rows = rows[rows == alone]
    motors = np.flatnonzero(free & np.array([stem == MOTOR_INERTIA for stem in stems]))
    table = np.zeros((motors.size + len(_TRIANGLE) * len(joints), len(stems)))
    table[np.arange(motors.size), motors] = 1.0
    for i in range(len(stems)):
        for entry, factor in _ENTRIES.get(stems[i], {}).items():
            row = motors.size + len(_TRIANGLE) * (places[i] - 1) + _TRIANGLE.index(entry)
            table[row, i] = factor * (1.0 if entry[0] == entry[1] else np.sqrt(2.0))
    chosen = np.flatnonzero(free)
    return _Problem(
        rows=rows,
        row_scale=scale[base.index[rows]],
        map=whole[np.ix_(rows, chosen)] * scale[chosen],
        carriers=np.searchsorted(chosen, base.index[rows]),
        table=table[:, chosen],
        fixed=table[:, ~free] @ (base.known / scale)[~free],
        motors=tuple(int(j) for j in places[motors]),
    )


def _power(stem: str, joint_type: str) -> int:
    """Power of length in the unit of a parameter whose other factor is mass."""
    if stem == MOTOR_INERTIA:
        return 2 if joint_type == "revolute" else 0
    return 2 - sum(axis == 3 for axis in next(iter(_ENTRIES.get(stem, {(0, 0): 0.0}))))


def _solved(problem: _Problem, whitened: Array, target: Array, margin: float) -> tuple[Array, Array, Array]:
    """x (v,), multipliers (m,) and slacks (m,) of  min |whitened x - target|^2,  fixed + table x >= margin.

    The residual is an unknown of its own, so that no product of the two tables is formed.
    """
    count, rows = problem.map.shape[1], target.size
    motors, links = len(problem.motors), problem.table.shape[0] - len(problem.motors)
    quadratic = sparse.diags_array(np.concatenate([np.full(count, MASS_ALONE), np.ones(rows)]))
    table = np.block([[whitened, -np.eye(rows)], [-problem.table, np.zeros((problem.table.shape[0], rows))]])
    room = np.tile([margin * (row == column) for row, column in _TRIANGLE], links // len(_TRIANGLE))
    right = np.concatenate([target, problem.fixed - np.concatenate([np.zeros(motors), room])])
    cones = [clarabel.ZeroConeT(rows), *([clarabel.NonnegativeConeT(motors)] if motors else [])]
    cones += [clarabel.PSDTriangleConeT(4)] * (links // len(_TRIANGLE))
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    solver = clarabel.DefaultSolver(
        sparse.csc_matrix(quadratic), np.zeros(count + rows), sparse.csc_matrix(table), right, cones, settings
    )
    found = solver.solve()
    if found.status not in (clarabel.SolverStatus.Solved, clarabel.SolverStatus.AlmostSolved):
        raise IdentificationError(
            "No physical links were found for what is known of the robot.", got=str(found.status),
            next_step="Check the values of the robot description that are not identified.",
        )  # fmt: skip
    return np.array(found.x)[:count], np.array(found.z)[rows:], np.array(found.s)[rows:]
