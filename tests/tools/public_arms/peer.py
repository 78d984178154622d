"""What a least squares of a peer leaves on the same rows: Pinocchio's regressor on filtered motion.

Nothing of this project computes it: the URDF is read by Pinocchio, the motion filtered by SciPy, and values are those
of the shortest solution, which no machine need have. Friction is viscous, Coulomb and an offset, and each joint has
the inertia of its rotor.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.signal import butter, sosfiltfilt

from fmu_didim.data.signals import Array

ORDER = 4
"""Of the Butterworth filter, applied forward and backward."""
RANK = 1e-10
"""[1] Of the largest singular value, below which the regressor has no direction."""


def rows_of(urdf: Path, time: Array, q: Array, cutoff_hz: float) -> Array:
    """(N, n, p) of the torque along measured positions (N, n) at instants (N,), s."""
    import pinocchio  # type: ignore[import-untyped]

    model = pinocchio.buildModelFromUrdf(str(urdf))
    data, step = model.createData(), float(np.median(np.diff(time)))
    even = np.arange(time[0], time[-1], step)
    filtered = butter(ORDER, cutoff_hz * 2 * step, output="sos")
    q = sosfiltfilt(filtered, np.column_stack([np.interp(even, time, column) for column in q.T]), axis=0)
    dq = np.gradient(q, step, axis=0)
    ddq = np.gradient(dq, step, axis=0)
    motion = [np.column_stack([np.interp(time, even, column) for column in part.T]) for part in (q, dq, ddq)]
    n = model.nv
    found = np.zeros((time.size, n, 10 * n + 4 * n))
    for k, (at, rate, change) in enumerate(zip(*motion, strict=True)):
        found[k, :, : 10 * n] = pinocchio.computeJointTorqueRegressor(model, data, at, rate, change)
        for j, column in enumerate((change, rate, np.sign(rate), np.ones(n))):
            found[k, :, (10 + j) * n : (11 + j) * n] = np.diag(column)
    return found


def values_of(fitted: Sequence[tuple[Array, Array]]) -> Array:
    """(p,) Least squares of the torque (N, n) on rows (N, n, p) of several runs, joints weighted by the residual of a
    first solution."""
    table, torque = (np.concatenate([part[i] for part in fitted]) for i in (0, 1))
    weight = np.ones(torque.shape[1])
    for _ in range(2):
        scaled = (table * weight[:, None]).reshape(-1, table.shape[2])
        values = np.linalg.lstsq(scaled, (torque * weight).reshape(-1), rcond=RANK)[0]
        weight = 1 / (torque - table @ values).std(axis=0)
    return np.asarray(values)
