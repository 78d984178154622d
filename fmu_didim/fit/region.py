"""Least squares over what machines can be: limits of single values, and links that exist.

    min  |T v - y|^2     low <= v <= high,   v_k = K_k x_k,   c_k + A_k x_k >= 0,   M(q, v_k) - e diag M(q, v_k) >= 0

with the base parameters v_k of each experiment and the values of each load, the inequalities of
:class:`~fmu_didim.dynamics.physical_set.PhysicalSet` and, for values that are to be simulated, the inertia matrix
at some positions, whose scaled eigenvalues are to be e at least: a semidefinite program, solved by
Clarabel (P. J. Goulart, Y. Chen, "Clarabel: An interior-point solver for conic programs with quadratic objectives",
arXiv:2405.12762, 2024).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import pairwise
from typing import cast

import clarabel
import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import block_diag

from fmu_didim.base.errors import IdentificationError
from fmu_didim.components import SameObject
from fmu_didim.data.signals import Array, Trajectory
from fmu_didim.dynamics.physical_set import TRIANGLE, PhysicalSet, mass_of
from fmu_didim.dynamics.robot.inertia import scaled_eigenvalues
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.parameters import RobotParameters

MASS_ALONE = 1e-11
"""[1] Weight of what no data show, such as the mass of the first link, against squares of all that the data show: it
keeps the problem bounded, and is so small that the solver stops before it has made every link as light as can be."""
MARGIN = 1e-5
"""[1] Smallest eigenvalue of the pseudo-inertia of a link, as a fraction of the robot's size: what is to be simulated
must have some inertia."""
SMALLEST = 1e-3
"""[1] Smallest eigenvalue of the scaled inertia matrix of values that are to be simulated: real machines have 0.2 and
more, light ones of many joints some hundredths."""
SMALLEST_OF_START = 0.1
"""[1] The same of a start, which need not be near the answer: the equations stay far from stiff."""
SOLVED = 1e-7
"""[1] What the solver leaves, as a fraction of the value with which a parameter makes up all data alone."""
ACCURACY = 1e-10
"""[1] Of the squares of all that the data show, to which the solver goes: its own 1e-8 left single steps of a TX40,
whose residual is a 250th of its torque, a fifth of a standard deviation short, and this leaves a thousandth of that."""
POSITIONS = 16
"""[positions] Along the reference of an experiment, at which the inertia matrix is bounded."""
KEPT = 32
"""[machines] Kept with their last links, and with as many tables of positions: every stage of an estimation asks for
the same ones."""


@dataclass(frozen=True)
class Constrained:
    """The least squares solution in a region.

    Attributes:
        values: (p,); squares: |T v - y|^2.
        duals, slacks: multipliers and slacks (m,) of the inequalities of each machine.
    """

    values: Array
    squares: float
    duals: tuple[Array, ...]
    slacks: tuple[Array, ...]


@dataclass(frozen=True)
class Machine:
    """What the base parameters of an experiment can be.

    Attributes:
        place: (b,) of the base parameters among all values; physical: the set that they belong to.
        columns: (K, n, n, b) and known: (K, n, n) of the inertia matrices at K positions, each joint divided by the
            root of its size.
        links: the unknowns (v,) of the last solution, if there was one.
    """

    place: NDArray[np.int64]
    physical: PhysicalSet
    columns: Array
    known: Array
    links: list[Array] = field(default_factory=list, compare=False, repr=False)

    def triangles(self, smallest: float) -> tuple[Array, Array]:
        """Upper triangles (K t, b) and (K t,) of M - smallest diag M, what is not on the diagonal times sqrt(2)."""
        n = self.known.shape[1]
        cells = [(i, j, 1 - smallest if i == j else np.sqrt(2.0)) for j in range(n) for i in range(j + 1)]
        table = np.stack([factor * self.columns[:, i, j] for i, j, factor in cells], axis=1)
        fixed = np.stack([factor * self.known[:, i, j] for i, j, factor in cells], axis=1)
        return table.reshape(-1, table.shape[2]), fixed.reshape(-1)

    def surely_holds(self, values: Array, margin: float, smallest: float) -> bool:
        """Whether base parameters (b,) are those of the last links, the parameters that carry them moved."""
        if not self.links:
            return False
        physical, moved = self.physical, self.links[-1].copy()
        rows = physical.rows
        moved[physical.carriers] += (values[rows] - physical.map @ moved) / physical.row_scale
        slack = physical.fixed + physical.table @ moved
        if (slack[: len(physical.motors)] < 0).any() or np.linalg.eigvalsh(physical.matrices(slack)).min() < margin:
            return False
        return self.inertia_holds(values, smallest)

    def inertia_holds(self, values: Array, smallest: float) -> bool:
        """Whether the inertia matrices of base parameters (b,) have scaled eigenvalues of this size at least."""
        return not self.too_light(values, smallest).any()

    def too_light(self, values: Array, smallest: float) -> NDArray[np.bool_]:
        """(K,) at which positions that is not so."""
        if not self.known.size:
            return np.zeros(len(self.known), dtype=np.bool_)
        return ~(scaled_eigenvalues(self.columns @ values + self.known) >= smallest)

    def bounded_at(self, places: NDArray[np.bool_]) -> Machine:
        """The machine with some of the positions (K,) at which its inertia matrix is bounded; its last links are the
        same."""
        return replace(self, columns=self.columns[places], known=self.known[places])


@dataclass(frozen=True)
class Region:
    """Where values (p,) may be.

    Attributes:
        low, high: (p,) limits of single values.
        machines: of the experiments whose base parameters differ; empty where no robot is described.
        base: (p,) which of the values are base parameters of machines.
        margin: smallest eigenvalue of the pseudo-inertias, as a fraction of the robot's size.
        smallest: eigenvalue of the scaled inertia matrices.
    """

    low: Array
    high: Array
    machines: tuple[Machine, ...] = ()
    base: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))
    margin: float = MARGIN
    smallest: float = SMALLEST

    @staticmethod
    def of(model: LoopModel) -> Region:
        """What the free parameters of a model may be: those of each experiment a machine, friction not negative."""
        low, high = model.free_parameters.limits
        if not isinstance(model.parameters, RobotParameters):
            return Region(low, high)
        low, machines = low.copy(), []
        labels: dict[tuple[int, ...], list[str]] = {}
        for label in model.experiments:
            labels.setdefault(tuple(model.free_parameters.places(label).tolist()), []).append(label)
        for place, together in labels.items():
            machine = _machine(model, place, together)
            friction = machine.place[list(machine.physical.friction)]
            low[friction] = np.maximum(low[friction], 0.0)
            machines.append(machine)
        for first in dict.fromkeys(k.experiment for k in model.free_parameters if k.is_load):
            assert first is not None
            machines.append(_load(model, first, [i for i, _ in model.free_parameters.loads(first)]))
        return Region(low, high, tuple(machines), np.arange(low.size) < model.linear_count)

    def of_base(self, count: int) -> Region:
        """The region of the first values alone, the base parameters."""
        return replace(self, low=self.low[:count], high=self.high[:count], base=self.base[:count])

    def of_start(self) -> Region:
        """Values from which an estimation can start."""
        return replace(self, smallest=SMALLEST_OF_START)

    @property
    def limits(self) -> tuple[Array, Array]:
        """(p,) lowest and highest values of the base parameters; infinite for all other values."""
        return np.where(self.base, self.low, -np.inf), np.where(self.base, self.high, np.inf)

    def limits_hold(self, values: Array) -> bool:
        """Whether base parameters among values (p,) lie within limits of their own."""
        low, high = self.limits
        return bool(((values >= low) & (values <= high)).all())

    def surely_holds(self, values: Array) -> bool:
        """Whether values (p,) are found to lie in the region without solving anything: by the links of each machine in
        the last solution that it had."""
        return self.limits_hold(values) and all(
            machine.surely_holds(values[machine.place], self.margin, self.smallest) for machine in self.machines
        )

    def least_squares(self, table: Array, right: Array) -> Constrained:
        """The values (p,) in the region with the least |table (m, p) values - right (m,)|, no column zero.

        The residual is an unknown of its own, so that the table is not squared. Inertia matrices, the larger part of
        the work, are looked at afterwards: the problem is solved again with those that would not hold, until all do.

        Raises:
            IdentificationError: no machine has what is known of the robot, or the solver fails.
        """
        machines, bounded = self.machines, [np.zeros(len(machine.known), dtype=np.bool_) for machine in self.machines]
        while not all(places.all() for places in bounded):
            some = tuple(machine.bounded_at(places) for machine, places in zip(machines, bounded, strict=True))
            try:
                found = replace(self, machines=some)._solved(table, right)
            except IdentificationError:
                break
            light = [machine.too_light(found.values[machine.place], self.smallest) for machine in machines]
            after = [places | new for places, new in zip(bounded, light, strict=True)]
            if all((new == places).all() for new, places in zip(after, bounded, strict=True)):
                return found
            bounded = after
        return self._solved(table, right)

    def _solved(self, table: Array, right: Array) -> Constrained:
        """As :meth:`least_squares`, with all inertia matrices at once."""
        length = np.linalg.norm(table, axis=0)
        size = max(float(np.linalg.norm(right)), 1.0)
        unit = size / length  # of a value: what alone makes up the right side
        program = self._program(table / length, right / size, unit)
        found = program.solve()
        if found.status not in (clarabel.SolverStatus.Solved, clarabel.SolverStatus.AlmostSolved):
            raise IdentificationError(
                "No physical links were found for what is known of the robot.", got=str(found.status),
                next_step="Check the values of the robot description that are not identified.",
            )  # fmt: skip
        unknowns, dual, slack = (np.array(part) for part in (found.x, found.z, found.s))
        ends = unit.size + np.cumsum([0, *(machine.physical.map.shape[1] for machine in self.machines)])
        for machine, first, last in zip(self.machines, ends[:-1], ends[1:], strict=True):
            machine.links[:] = [unknowns[first:last]]
        values = unknowns[: unit.size] * unit
        for limit in self.limits:
            touched = np.abs(values - limit) <= SOLVED * unit  # at a limit is on it
            values[touched] = limit[touched]
        values = np.clip(values, *self.limits)
        first = right.size + self._equal + self._limited
        squares = float(np.sum((table @ values - right) ** 2))
        return Constrained(values, squares, self._of_machines(dual[first:]), self._of_machines(slack[first:]))

    @property
    def _equal(self) -> int:
        """Number of equations between values and the unknowns of machines."""
        return sum(machine.physical.rows.size for machine in self.machines)

    @property
    def _limited(self) -> int:
        """Number of limits of single values."""
        return int(np.isfinite(self.limits).sum())

    def _program(self, table: Array, right: Array, unit: Array) -> clarabel.DefaultSolver:
        """The cone program. Unknowns: the values divided by ``unit``, those of the machines, and the residual."""
        rows, count = table.shape
        machines = [machine.physical for machine in self.machines]
        limits = [
            (sign, limit, np.flatnonzero(np.isfinite(limit))) for sign, limit in zip((-1, 1), self.limits, strict=True)
        ]
        one = np.eye(count)
        of_machines = [(one * unit)[m.place[m.physical.rows]] / m.physical.row_scale[:, None] for m in self.machines]
        inertias = [(m.place, *m.triangles(self.smallest)) for m in self.machines]
        none = np.zeros((0, 0))
        maps = block_diag(none, *(m.map / m.row_scale[:, None] for m in machines))
        motors = block_diag(none, *(m.table[: len(m.motors)] for m in machines))
        links = block_diag(none, *(m.table[len(m.motors) :] for m in machines))
        of_links = slice(count, count + maps.shape[1])
        blocks: list[tuple[Array, slice]] = [  # rows of coefficients, and of which unknowns; those of others are zero
            (np.vstack([table, *of_machines]), slice(count)),
            *((sign * one[at], slice(count)) for sign, _, at in limits),
            (-motors, of_links),
            (-links, of_links),
            *((-columns @ (one * unit)[place], slice(count)) for place, columns, _ in inertias),
        ]
        whole = np.zeros((sum(len(part) for part, _ in blocks), of_links.stop + rows))
        first = 0
        for part, place in blocks:
            whole[first : (first := first + len(part)), place] = part
        whole[:rows, of_links.stop :] = -np.eye(rows)
        whole[rows : rows + self._equal, of_links] = -maps
        room = self.margin * np.array([float(row == column) for row, column in TRIANGLE])
        rights = [
            right,
            np.zeros(self._equal),
            *(sign * limit[at] / unit[at] for sign, limit, at in limits),
            *(m.fixed[: len(m.motors)] for m in machines),
            *(m.fixed[len(m.motors) :] - np.tile(room, m.links) for m in machines),
            *(fixed for *_, fixed in inertias),
        ]
        cones = [
            clarabel.ZeroConeT(rows + self._equal),
            clarabel.NonnegativeConeT(self._limited + motors.shape[0]),
            *(clarabel.PSDTriangleConeT(4) for _ in range(links.shape[0] // len(TRIANGLE))),
            *(clarabel.PSDTriangleConeT(m.known.shape[1]) for m in self.machines for _ in m.known),
        ]
        weights = np.concatenate([np.zeros(count), np.full(maps.shape[1], MASS_ALONE), np.ones(rows)])
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = ACCURACY
        quadratic, sparse_whole = sparse.diags_array(weights, format="csc"), sparse.csc_matrix(whole)
        linear = np.zeros(weights.size)
        return clarabel.DefaultSolver(quadratic, linear, sparse_whole, np.concatenate(rights), cones, settings)

    def _of_machines(self, stacked: Array) -> tuple[Array, ...]:
        """The inequalities of each machine, from those of all motors followed by those of all links."""
        motors = [len(machine.physical.motors) for machine in self.machines]
        links = [machine.physical.links * len(TRIANGLE) for machine in self.machines]
        ends = np.cumsum([0, *motors, *links])
        pieces = [stacked[a:b] for a, b in pairwise(ends)]
        return tuple(np.concatenate(pair) for pair in zip(pieces[: len(motors)], pieces[len(motors) :], strict=True))


def _machine(model: LoopModel, place: tuple[int, ...], labels: Sequence[str]) -> Machine:
    """The machine of some experiments, at the power of two that is nearest to its mass."""
    parameters = model.parameters
    assert isinstance(parameters, RobotParameters)
    positions = np.concatenate([positions_along(model, label, POSITIONS) for label in labels])
    mass = mass_of(parameters.model, parameters.base, model.start[list(place)])
    return _machine_along(SameObject(parameters), place, positions.tobytes(), 2.0 ** round(math.log2(mass)))


@lru_cache(maxsize=KEPT)
def _machine_along(parameters: SameObject, place: tuple[int, ...], positions: bytes, mass: float) -> Machine:
    """The machine whose base parameters have these places among all values, along positions (K, n)."""
    of = parameters.value
    assert isinstance(of, RobotParameters)
    robot, base = of.model, of.base
    physical = PhysicalSet.of(robot, base, mass)
    matrices = robot.inertia_columns(np.frombuffer(positions).reshape(-1, robot.joint_count))
    columns = matrices[..., base.index]
    unit = np.zeros(base.count)
    unit[physical.rows] = physical.row_scale
    size = np.sqrt(np.einsum("kiib,b->i", np.abs(columns), unit) / len(columns))
    size[size == 0] = 1.0
    scale = 1 / np.outer(size, size)
    return Machine(np.array(place), physical, columns * scale[..., None], (matrices @ base.known) * scale)


def _load(model: LoopModel, label: str, places: Sequence[int]) -> Machine:
    """What a load on the last link can be, whose values have these places among all: a body of positive mass. With it,
    what a robot is that can exist can exist, too."""
    physical, n = model.loads[label].physical, model.joint_count
    return Machine(np.array(places), physical, np.zeros((0, n, n, len(places))), np.zeros((0, n, n)))


def positions_along(model: LoopModel, label: str, count: int) -> Array:
    """(K, n) positions along the reference of an experiment, K at most ``count``; zero where it has none."""
    return _positions(SameObject(model.experiments[label].reference), model.joint_count, count)


@lru_cache(maxsize=KEPT)
def _positions(of: SameObject, joints: int, count: int) -> Array:
    """(K, n) positions of so many joints along a reference."""
    reference, names = cast("Trajectory", of.value), [f"q{j}" for j in range(1, joints + 1)]
    if set(names) <= set(reference.names):
        ticks = np.unique(np.linspace(0, reference.time.size - 1, count).astype(np.int64))
        found = reference.select(names)[ticks]
    else:
        found = np.zeros((1, joints))
    found.flags.writeable = False
    return found
