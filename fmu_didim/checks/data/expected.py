"""The torque that a log is compared with before any fit of the loop.

nominal   simulated with the start values of the parameters, which may be off by a factor of two or three
fitted    W theta + known along the reference motion, theta by least squares: all that base parameters can absorb
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fmu_didim.base.errors import FmuDidimError, SimulationError
from fmu_didim.base.tall import in_blocks
from fmu_didim.data.signals import Array
from fmu_didim.estimators.starts.reference_start import moving_joints, rows_on, whole_reference
from fmu_didim.fit.noise.noise import TINY
from fmu_didim.fit.solver.admissible import mass_matrix_problem
from fmu_didim.model.loop_model import Simulation

SHIFTS = (0.13, 0.23, 0.31, 0.43, 0.57, 0.69, 0.77)
"""[1] Of the length of the log: no whole periods."""
DEPENDENT = 1e-12
"""[1] Eigenvalue of the normal equations, of the largest one, below which columns depend on others."""
DEAD = 1e-15
"""[1] Of the largest torque of a log, below which the deviation of a joint is none: squares of its inverse are
numbers, and a constant that is rounded has about as much."""
MOSTLY = 0.5
"""[1] Part of the samples of a joint that are wrong by themselves, above which its log tells nothing."""
FEWEST = 20
"""[samples] That are left for each joint, with fewer of which nothing is left out."""


@dataclass(frozen=True)
class Expected:
    """The torque of a log and the expected one.

    Attributes:
        measured: (N, n); nominal: (N, n) simulated at the start values, None where the loop does not run with them.
        columns: (N, n, b) regressor along the reference; known: (N, n) torque beside it; None without one.
        left: which rows (N,) and which joints (n,) of the log these are; None: all.
        moving: (n,) which joints move; None: all.
    """

    measured: Array
    nominal: Array | None = None
    columns: Array | None = None
    known: Array | None = None
    left: tuple[NDArray[np.bool_], NDArray[np.bool_]] | None = None
    moving: NDArray[np.bool_] | None = None

    @property
    def size(self) -> Array:
        """(n,) standard deviation of each measured torque, never zero: that of a dead channel is a rounding of the
        largest torque, 1 where there is none. The torque of a joint that stands still is no more than noise and what
        the others shake: it counts as a part of the largest one."""
        largest = float(np.abs(self.measured).max(initial=0.0))
        found = np.asarray(np.maximum(self.measured.std(axis=0), DEAD * largest if largest > TINY else 1.0))
        return found if self.moving is None else np.where(self.moving, found, found.max(initial=0.0))

    def without(self, wrong: NDArray[np.bool_]) -> Expected:
        """The same without the samples (N, n) that are wrong by themselves: without the joints of which hardly any
        other is left, and without the rows in which one of the other joints has one."""
        joints = np.asarray(wrong.mean(axis=0) <= MOSTLY)
        rows = np.asarray(~wrong[:, joints].any(axis=1))
        if not wrong.any() or not joints.any() or rows.sum() < FEWEST * joints.sum():
            return self
        parts = (self.nominal, self.columns, self.known)
        nominal, columns, known = (None if part is None else part[rows][:, joints] for part in parts)
        moving = None if self.moving is None else self.moving[joints]
        return Expected(self.measured[rows][:, joints], nominal, columns, known, (rows, joints), moving)

    def kept(self, torque: Array) -> Array:
        """Those samples of a torque (N, n) of the whole log that are left."""
        return torque if self.left is None else torque[self.left[0]][:, self.left[1]]

    @property
    def has_all_joints(self) -> bool:
        """Whether no joint was left out."""
        return self.left is None or bool(self.left[1].all())

    @cached_property
    def fitted(self) -> Array | None:
        """(N, n) least squares fit along the reference, each joint divided by its size; None without a regressor."""
        return None if self.columns is None else fitted_by(self.columns, self.measured, self.known, self.size)

    @property
    def best(self) -> Array | None:
        """(N, n) the one of the two that is nearer to the log; None without either."""
        there = [torque for torque in (self.nominal, self.fitted) if torque is not None]
        return min(there, key=self.error, default=None)

    def after(self, part: float) -> Expected:
        """The same without the first part of the log, as a fraction of it."""
        rows = slice(int(part * self.measured.shape[0]), None)
        parts = (self.nominal, self.columns, self.known)
        nominal, columns, known = (None if part is None else part[rows] for part in parts)
        return Expected(self.measured[rows], nominal, columns, known, moving=self.moving)

    def chance(self) -> float:
        """Median error of the fit for the log rolled to other instants."""
        assert self.columns is not None
        known = np.zeros_like(self.measured) if self.known is None else self.known
        errors = []
        for shift in SHIFTS:
            torque = np.roll(self.measured - known, int(shift * self.measured.shape[0]), axis=0)
            rest = torque - fitted_by(self.columns, torque, None, self.size)
            errors.append(float(np.sqrt(np.mean((rest / self.size) ** 2))))
        return float(np.median(errors))

    def error(self, torque: Array) -> float:
        """Error of a torque (N, n) relative to the deviation of the log, root mean square over samples and joints."""
        return float(np.sqrt(np.mean(((self.measured - torque) / self.size) ** 2)))


def fitted_by(columns: Array, measured: Array, known: Array | None, size: Array) -> Array:
    """(N, n) least squares fit of a torque (N, n) by columns (N, n, b), each joint divided by its size (n,)."""
    offset = np.zeros_like(measured) if known is None else known
    return np.asarray(columns @ solved_by(columns, measured - offset, size)[0] + offset)


def solved_by(columns: Array, torque: Array, size: Array) -> tuple[Array, Array]:
    """The values (b,) of that fit, the smallest where columns depend on each other, and their deviation (b,) where
    each joint has as much white noise as its size."""
    # By the normal equations: many fits of long logs, of which three digits are enough.
    count = columns.shape[2]
    products, along = np.zeros((count, count)), np.zeros(count)
    for block, right in zip(in_blocks(columns), in_blocks(torque), strict=True):
        flat = (block / size[:, None]).reshape(-1, count)
        products += flat.T @ flat
        along += flat.T @ (right / size).reshape(-1)
    return solved_from(products, along)


def solved_from(products: Array, along: Array) -> tuple[Array, Array]:
    """The same by products of the columns with each other (b, b), and with the torque (b,)."""
    length = np.sqrt(np.diag(products))
    length[length == 0] = 1.0
    inverse = np.linalg.pinv(products / length / length[:, None], rcond=DEPENDENT, hermitian=True)
    solution = inverse @ (along / length)
    return solution / length, np.sqrt(np.maximum(np.diag(inverse), 0.0)) / length


def expected(run: Simulation) -> Expected:
    """The expected torque of an experiment, by at most one simulation and one regressor."""
    model, measured = run.model, run.model.experiments.measured_in(run.label)
    nominal = columns = known = None
    if not mass_matrix_problem(model, run.values):
        try:
            nominal = run.torque()
        except SimulationError:
            nominal = None  # the fit deals with such a start
    names, moving = run.experiment.reference.names, None
    if model.parameters.has_regressor and all(f"q{j}" in names for j in range(1, model.joint_count + 1)):
        motion = whole_reference(run)
        moving = moving_joints(motion[1])
        try:
            columns, known = rows_on(run, motion)
        except FmuDidimError:
            columns = known = None  # effects whose loads no fit along the reference gives
    return Expected(measured, nominal, columns, known, moving=moving)
