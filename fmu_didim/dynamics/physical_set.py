"""Which base parameters a machine can have, as linear and conic inequalities.

Base parameters b are physically consistent if standard parameters chi = (chi_b, chi_d) exist with

    b = chi_b + K chi_d,    P_j(chi) >= 0 for each link j,    Ia >= 0, Fv >= 0, Fc >= 0

with the pseudo-inertia of a link

    P = [ tr(I)/2 1 - I   h ]       I = [XX XY XZ; XY YY YZ; XZ YZ ZZ],   h = (MX, MY, MZ)
        [       h'        M ]

positive semidefinite if and only if some distribution of positive mass has these inertial parameters: a convex set.
Motors that drive each other's joints, j to k, have the inertia matrix

    [ Ia_j  Iam_j   0   ]
    [ Iam_j   .   Iam_i ]  >= 0,    their energy by the velocities of the joints
    [   0   Iam_i  Ia_k ]

Sources: P. M. Wensing, S. Kim, J.-J. E. Slotine, "Linear Matrix Inequalities for Physically Consistent Inertial
Parameter Identification", IEEE RA-L 3(1), 2018; C. D. Sousa, R. Cortesao, "Physical feasibility of robot base inertial
parameter identification: a linear matrix inequality approach", IJRR 33(6), 2014.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fmu_didim.data.signals import Array
from fmu_didim.dynamics.base_parameters import BaseParameters
from fmu_didim.dynamics.robot.model import RobotModel

MOTOR_INERTIA = "Ia"
COUPLED = "Iam"
"""Stem of the inertia of motors that joins a joint to the next one."""
FRICTION = ("Fv", "Fc")
"""Stems of the parameters of friction, which cannot be negative."""
ENTRIES = {
    "XX": {(0, 0): -0.5, (1, 1): 0.5, (2, 2): 0.5}, "YY": {(0, 0): 0.5, (1, 1): -0.5, (2, 2): 0.5},
    "ZZ": {(0, 0): 0.5, (1, 1): 0.5, (2, 2): -0.5}, "XY": {(0, 1): -1.0}, "XZ": {(0, 2): -1.0}, "YZ": {(1, 2): -1.0},
    "MX": {(0, 3): 1.0}, "MY": {(1, 3): 1.0}, "MZ": {(2, 3): 1.0}, "M": {(3, 3): 1.0},
}  # fmt: skip
"""Parameter of a link -> its entries in the upper triangle of the pseudo-inertia."""
SIDE = 4
"""Rows of a pseudo-inertia; as many coupled motors stand in one matrix, others have the diagonal 1."""
TRIANGLE = [(row, column) for column in range(SIDE) for row in range(column + 1)]
"""(row, column) of the entries of an upper triangle, in the order of the columns."""
_NAME = re.compile(r"(\w*?)(\d+)")


@dataclass(frozen=True)
class PhysicalSet:
    """The base parameters of machines: those of inertia are ``map x``, with  fixed + table x >= 0.

    The unknowns x (v,) are standard parameters divided by their size.

    Attributes:
        rows: (r,) places of the base parameters that belong to inertia, which are map (r, v) times x; row_scale: (r,).
        carriers: (r,) unknown that carries each of them.
        table: (m, v) and fixed: (m,), first those of motor inertias, then the upper triangles of the pseudo-inertias,
            and behind them those of coupled motors, what is not on the diagonal times sqrt(2); motors: (k,) joints of
            the first, from 1; coupled: joints of the last.
        friction: places of the base parameters that are friction.
        places, sizes: (v,) of the unknowns among the standard parameters, and by which they are divided.
    """

    rows: NDArray[np.int64]
    row_scale: Array
    map: Array
    carriers: NDArray[np.int64]
    table: Array
    fixed: Array
    motors: tuple[int, ...]
    friction: tuple[int, ...]
    places: NDArray[np.int64]
    sizes: Array
    coupled: tuple[tuple[int, ...], ...] = ()

    @staticmethod
    def of(model: RobotModel, base: BaseParameters, mass: float) -> PhysicalSet:
        """The set of a robot, whose :func:`mass_of` gives the sizes of the unknowns.

        What acts and is not identified keeps its value, unless that is zero, as where nobody has stated it.
        """
        joints = model.description.joints
        stems, places = _split(base)
        inertial, whole, rows = _inertial(base, stems)
        free = (whole[rows] != 0).any(axis=0) | inertial & (base.known == 0)
        free |= inertial & ~np.isin(np.arange(len(stems)), model.active)
        length, power = _length(model), _powers(model, stems, places)
        scale = np.where(inertial, mass * length**power, 1.0)
        motors = np.flatnonzero(free & np.array([stem == MOTOR_INERTIA for stem in stems]))
        table = np.zeros((motors.size + len(TRIANGLE) * len(joints), len(stems)))
        table[np.arange(motors.size), motors] = 1.0
        for i in range(len(stems)):
            for entry, factor in ENTRIES.get(stems[i], {}).items():
                row = motors.size + len(TRIANGLE) * (places[i] - 1) + TRIANGLE.index(entry)
                table[row, i] = factor * (1.0 if entry[0] == entry[1] else np.sqrt(2.0))
        coupled = _coupled(base.standard_names)
        joined = [_motors_of(base.standard_names, group) for group in coupled]
        table = np.vstack([table, *(rows for rows, _ in joined)])
        without = np.concatenate([np.zeros(motors.size + len(TRIANGLE) * len(joints)), *(one for _, one in joined)])
        chosen = np.flatnonzero(free)
        return PhysicalSet(
            rows=rows,
            row_scale=scale[base.index[rows]],
            map=whole[np.ix_(rows, chosen)] * scale[chosen],
            carriers=np.searchsorted(chosen, base.index[rows]),
            table=table[:, chosen],
            fixed=without + table[:, ~free] @ (base.known / scale)[~free],
            motors=tuple(int(j) for j in places[motors]),
            friction=tuple(i for i, name in enumerate(base.standard) if name.rstrip("0123456789") in FRICTION),
            places=chosen,
            sizes=scale[chosen],
            coupled=coupled,
        )

    def only(self, row: int) -> PhysicalSet:
        """The set that a single base parameter belongs to, whatever the others are."""
        kept = self.rows == row
        return replace(
            self, rows=self.rows[kept], row_scale=self.row_scale[kept], map=self.map[kept], carriers=self.carriers[kept]
        )

    @property
    def links(self) -> int:
        """Number of pseudo-inertias, with the matrices of coupled motors."""
        return int(self.table.shape[0] - len(self.motors)) // len(TRIANGLE)

    def matrices(self, stacked: Array) -> Array:
        """(n, 4, 4) of the part of (m,) that holds triangles."""
        triangles = stacked[len(self.motors) :].reshape(-1, len(TRIANGLE))
        result = np.zeros((triangles.shape[0], 4, 4))
        for place, (row, column) in enumerate(TRIANGLE):
            factor = 1.0 if row == column else np.sqrt(0.5)
            result[:, row, column] = result[:, column, row] = factor * triangles[:, place]
        return result

    def held_back(self, dual: Array, slack: Array) -> int:
        """Dimension of the face on which a solution with multipliers and slacks (m,) lies, counted from outside: each
        inequality of a motor inertia is one, a pseudo-inertia that r directions hold back r (r + 1)/2."""
        most = float(np.abs(dual).max())
        count = int((dual[: len(self.motors)] / most > slack[: len(self.motors)]).sum())
        for force, inertia in zip(self.matrices(dual), self.matrices(slack), strict=True):
            # One is zero where the other is not: largest against smallest.
            pairs = np.linalg.eigvalsh(force)[::-1] / most > np.linalg.eigvalsh(inertia)
            count += int(pairs.sum()) * (int(pairs.sum()) + 1) // 2
        return max(1, min(count, self.rows.size))

    def link_of(self, moved: Array, dual: Array) -> tuple[int, ...]:
        """The link, from 1, whose inequalities hold most of a way (r,) of the base parameters; the joints of motors if
        theirs do."""
        change = np.zeros(self.map.shape[1])
        change[self.carriers] = moved / self.row_scale
        parts = dual * (self.table @ change)
        first = len(self.motors)
        by_link = parts[first:].reshape(-1, len(TRIANGLE)).sum(axis=1)
        for joint, part in zip(self.motors, parts[:first], strict=True):
            by_link[joint - 1] += part
        most, links = int(np.argmax(by_link)), self.links - len(self.coupled)
        return (most + 1,) if most < links else self.coupled[most - links]


def mass_of(model: RobotModel, base: BaseParameters, values: Array) -> float:
    """About the mass of a robot with base parameters (b,): the largest that one of inertia has at the usual length of a
    link; 1 where all are zero."""
    stems, places = _split(base)
    rows = _inertial(base, stems)[2]
    power = _powers(model, stems, places)[base.index[rows]]
    return float(np.max(np.abs(values[rows]) / _length(model) ** power, initial=0.0)) or 1.0


def _split(base: BaseParameters) -> tuple[list[str], NDArray[np.int64]]:
    """Stems of the standard parameters, and the numbers of their joints."""
    split = [_NAME.fullmatch(name).groups() for name in base.standard_names]  # type: ignore[union-attr]
    return [stem for stem, _ in split], np.array([int(number) for _, number in split])


def _coupled(names: Sequence[str]) -> tuple[tuple[int, ...], ...]:
    """Joints, from 1, whose motors are coupled one after the other, in groups of at most ``SIDE``, which overlap where
    more are. Where the motor of a joint is no parameter, nothing limits the coupling but the inertia of the robot."""
    groups = list[tuple[int, ...]]()
    for name in names:
        stem, number = _NAME.fullmatch(name).groups()  # type: ignore[union-attr]
        pair = (int(number), int(number) + 1)
        if stem != COUPLED or any(f"{MOTOR_INERTIA}{j}" not in names for j in pair):
            continue
        if groups and groups[-1][-1] == pair[0]:
            longer = (*groups[-1], pair[1])
            groups[-1:] = [longer] if len(longer) <= SIDE else [groups[-1], longer[-SIDE:]]
        else:
            groups.append(pair)
    return tuple(groups)


def _motors_of(names: Sequence[str], group: Sequence[int]) -> tuple[Array, Array]:
    """Rows (10, s) and constants (10,) of the triangle of the inertia matrix of coupled motors; its other diagonal
    elements are 1."""
    rows, constants = np.zeros((len(TRIANGLE), len(names))), np.zeros(len(TRIANGLE))
    for place in range(SIDE):
        cell = TRIANGLE.index((place, place))
        if place >= len(group):
            constants[cell] = 1.0
            continue
        rows[cell, names.index(f"{MOTOR_INERTIA}{group[place]}")] = 1.0
        if place + 1 < len(group):
            rows[TRIANGLE.index((place, place + 1)), names.index(f"{COUPLED}{group[place]}")] = np.sqrt(2.0)
    return rows, constants


def _inertial(base: BaseParameters, stems: list[str]) -> tuple[NDArray[np.bool_], Array, NDArray[np.int64]]:
    """(s,) which standard parameters are of inertia, the table (b, s) of the base parameters over them, and the places
    of the base parameters of inertia."""
    inertial = np.array([stem in ENTRIES or stem in (MOTOR_INERTIA, COUPLED) for stem in stems])
    whole = np.zeros((base.count, len(stems)))
    whole[np.arange(base.count), base.index] = 1.0
    whole[:, base.dependent] = base.regrouping
    return inertial, whole, np.flatnonzero((whole[:, inertial] != 0).any(axis=1))


def _length(model: RobotModel) -> float:
    """The usual length of a link."""
    lengths = [abs(length) for joint in model.description.joints for length in (joint.a, joint.d) if length]
    return float(np.median(lengths)) if lengths else 1.0


def _powers(model: RobotModel, stems: list[str], places: NDArray[np.int64]) -> NDArray[np.int64]:
    """(s,) powers of length in the standard parameters."""
    joints = model.description.joints
    of_motors = [2 if joint.type == "revolute" else 0 for joint in joints]
    powers = []
    for stem, j in zip(stems, places, strict=True):
        coupled = stem == COUPLED  # between a turn and a slide its unit has one length
        powers.append((of_motors[j - 1] + of_motors[j]) // 2 if coupled else _power(stem, of_motors[j - 1]))
    return np.array(powers)


def _power(stem: str, of_motor: int) -> int:
    """Power of length in the unit of a parameter whose other factor is mass."""
    if stem == MOTOR_INERTIA:
        return of_motor
    return 2 - sum(axis == 3 for axis in next(iter(ENTRIES.get(stem, {(0, 0): 0.0}))))
