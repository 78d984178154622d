"""The values nearest to an estimate that physical links can have.

min  (b - b_hat)' C^-1 (b - b_hat)     over the base parameters b of a
:class:`~fmu_didim.dynamics.physical_set.PhysicalSet`
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmu_didim.data.signals import Array
from fmu_didim.dynamics.base_parameters import BaseParameters
from fmu_didim.dynamics.physical_set import PhysicalSet, mass_of
from fmu_didim.dynamics.robot import RobotModel
from fmu_didim.fit.region import Machine, Region

SMALLEST_DEVIATION = 1e-6
"""[1] Smallest relative standard deviation of a value: data without noise need weights, too."""
TOUCHES = 0.01
"""[standard deviations] Values that are nearer to physical ones are physical: the solver's rest."""


@dataclass(frozen=True)
class Nearest:
    """The nearest physical values.

    Attributes:
        values: (b,) base parameters; those of friction and the like as they were.
        distance: sqrt of the minimum, in standard deviations; constraints: how many independent ones hold it back.
        link: number of the link whose inertia has the largest part in that, from 1, or those of joints whose motors are
            coupled; none where nothing holds it back.
        parameter: place of the base parameter that moves farthest, in standard deviations.
    """

    values: Array
    distance: float
    constraints: int
    link: tuple[int, ...]
    parameter: int


def nearest_physical(
    model: RobotModel, base: BaseParameters, values: Array, covariance: Array, *, alone: int | None = None
) -> Nearest:
    """The base parameters nearest to values (b,) with covariance (b, b) that physical links can have.

    Parameters that act and are not identified keep their values, unless those are zero, which means not stated.

    Args:
        alone: place of the one base parameter that counts; the others are taken as unknown.

    Raises:
        IdentificationError: no physical links have what is known of the robot, or the solver fails.
    """
    physical = PhysicalSet.of(model, base, mass_of(model, base, values))
    if alone is not None:
        physical = physical.only(alone)
    rows = physical.rows
    if not rows.size:
        return Nearest(values.copy(), 0.0, 0, (), 0)
    least = SMALLEST_DEVIATION * np.maximum(np.abs(values[rows]), SMALLEST_DEVIATION * physical.row_scale)
    covered = covariance[np.ix_(rows, rows)] + np.diag(least**2)
    deviation = np.sqrt(np.diag(covered))
    factor = np.linalg.cholesky(covered / np.outer(deviation, deviation))
    table = np.linalg.solve(factor, np.diag(1 / deviation))
    place = np.zeros(values.size, dtype=np.int64)
    place[rows] = np.arange(rows.size)
    unlimited, every = np.full(rows.size, np.inf), np.ones(rows.size, dtype=np.bool_)
    n = model.joint_count
    machine = Machine(place, physical, np.zeros((0, n, n, values.size)), np.zeros((0, n, n)))
    region = Region(-unlimited, unlimited, (machine,), every, margin=0.0)
    found = region.least_squares(table, table @ values[rows])
    moved = found.values - values[rows]
    result = values.copy()
    result[rows] = found.values
    distance = float(np.sqrt(found.squares))
    farthest = int(rows[np.argmax(np.abs(moved / deviation))])
    if distance < TOUCHES:
        return Nearest(result, distance, 0, (), farthest)
    dual, slack = found.duals[0], found.slacks[0]
    return Nearest(result, distance, physical.held_back(dual, slack), physical.link_of(moved, dual), farthest)
