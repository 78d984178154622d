"""Signals of motors brought to the joints, where motors drive several joints, as those of a wrist do.

With the turns G (n, n) of each motor (row) by one of each joint (column), gear ratios included,

    q_motor = G q  =>  q = G^-1 q_motor,   dq and ddq likewise,     tau = G' tau_motor

by the power dq_motor' tau_motor = dq' tau. Motor i has the number of joint i in the names of signals. Source: Gautier,
Vandanjon, Janot, "Dynamic identification of a 6 dof robot without joint position data", ICRA 2011 (TX40).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fmu_didim.base.errors import InputError
from fmu_didim.data.signals import Array, Trajectory, Variable
from fmu_didim.data.tables.columns import MOTION, target

Turns = tuple[tuple[float, ...], ...]
"""G by rows."""
SINGULAR = 1e-12
"""[1] Of the largest singular value, after rows and columns are scaled, below which motors do not tell the joints."""
ABSENT = 1e-12
"""[1] Of the largest entry of its row, below which an entry of an inverse is rounding: that motor does not count."""
TORQUE = "tau"


def check_turns(turns: Turns) -> None:
    """Raise ValueError where a matrix is not square, or no joints follow from motors by it."""
    if any(len(row) != len(turns) for row in turns):
        raise ValueError(
            f"a square matrix is needed, a row for each motor and a column for each joint; these are {len(turns)} rows "
            f"of {', '.join(str(n) for n in sorted({len(row) for row in turns}))}"
        )
    matrix = np.array(turns)
    rows, columns = (np.abs(matrix).max(axis=axis) for axis in (1, 0))
    for values, what in ((rows, "motor"), (columns, "joint")):
        if not values.all():
            number = int(np.argmin(values)) + 1
            does = "turns with no joint" if what == "motor" else "turns no motor"
            raise ValueError(f"{what} {number} {does}: its {'row' if what == 'motor' else 'column'} is zero")
    sizes = np.linalg.svd(matrix / rows[:, None] / np.abs(matrix / rows[:, None]).max(axis=0), compute_uv=False)
    if sizes[-1] <= SINGULAR * sizes[0]:
        raise ValueError("the matrix is singular: several motions of the joints turn the motors alike")


def mixes(turns: Turns) -> bool:
    """Whether a motor drives several joints, so that the torques of these share its noise."""
    matrix = np.array(turns)
    return bool((matrix != np.diag(np.diag(matrix))).any())


def on_joints(signals: Trajectory, turns: Turns, torque_units: Sequence[str], *, where: str) -> Trajectory:
    """Signals of motors as those of joints; other columns as they are.

    Args:
        turns: G; torque_units: (n,) N.m or N of each joint, or none where they are not known.

    Raises:
        InputError: there are more or fewer joints, or a motor lacks that a joint needs.
    """
    count = len(turns)
    if torque_units and len(torque_units) != count:
        raise InputError(
            "The matrix of the motors is not that of this robot.", where=f"{where}: motors",
            got=f"{count} rows", valid=f"{len(torque_units)}, one for each joint",
            next_step="Give a row for each motor and a column for each joint.",
        )  # fmt: skip
    by_motor = {name: i for i, name in enumerate(signals.names)}
    values, variables = signals.values.copy(), list(signals.variables)
    for stem in (*MOTION, TORQUE):
        there = {j: by_motor[f"{stem}{j}"] for j in range(1, count + 1) if f"{stem}{j}" in by_motor}
        for j, place in there.items():
            row = _row(np.array(turns), j, stem)
            needed = [i for i in range(1, count + 1) if row[i - 1]]
            if absent := [f"{stem}{i}" for i in needed if i not in there]:
                raise InputError(
                    f"{stem}{j} of the joint follows from several motors, of which the file lacks some.", where=where,
                    got=f"no {', '.join(absent)}", valid=", ".join(f"{stem}{i}" for i in needed),
                    next_step="Name their columns, or correct motors:.",
                )  # fmt: skip
            values[:, place] = sum(row[i - 1] * signals.values[:, there[i]] for i in needed)
            units = target(f"{stem}{j}", tuple(torque_units)).names
            variables[place] = Variable(f"{stem}{j}", units[0] if len(units) == 1 else "")
    return replace(signals, values=values, variables=tuple(variables))


def _row(turns: Array, joint: int, stem: str) -> Array:
    """(n,) by which the signal of a joint, from 1, follows from those of the motors."""
    if stem == TORQUE:
        return np.asarray(turns[:, joint - 1])
    row = np.linalg.inv(turns)[joint - 1]
    counts = np.abs(row) * np.abs(turns).max(axis=1)
    return np.where(counts > ABSENT * counts.max(), row, 0.0)
