"""Whether a torque log can be that of the loop at all: its signs, the order of its joints, its unit, what is missing.

The base fit would hide such errors, or make physics of them; so the log is compared with what the loop gives at the
start values of the parameters, which need not be good for it:

    c_jk = corr(measured torque of joint j, simulated torque of joint k)
    s_j  = <measured, simulated> / <simulated, simulated>           of joint j
    E(p) = sum_j mean((measured_j - simulated_p(j))^2) / mean(measured_j^2)     of an order p of the joints
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment

from fmu_didim.diagnosis import thresholds as limits
from fmu_didim.errors import InputError, SimulationError
from fmu_didim.prediction.experiment import Experiment
from fmu_didim.prediction.loop_model import LoopModel
from fmu_didim.prediction.noise import TINY
from fmu_didim.signals import Array


def check_log(model: LoopModel, label: str) -> tuple[str, ...]:
    """Remarks on the torque log of one experiment.

    Raises:
        InputError: a torque has the opposite sign, or the joints are in another order.
    """
    measured, where = model.measured_in(label), model.experiments[label].label or label
    gaps = _gaps(model.experiments[label], where)
    try:
        simulated = model.torque(model.start, label)
    except SimulationError:  # nothing to compare with; the fit deals with such a start
        return gaps
    correlation = _correlations(measured, simulated)
    _check_order(measured, simulated, where)
    own = np.diag(correlation)
    if (own < limits.AGAINST).any():
        turned = [int(j) + 1 for j in np.flatnonzero(own < limits.AGAINST)]
        raise InputError(
            "The measured torque runs against the simulated one.",
            where=f"{where}: joint {', '.join(map(str, turned))}",
            got=f"correlation {', '.join(f'{own[j - 1]:.2f}' for j in turned)}",
            valid="positive along the joint, as in the robot description",
            next_step="Turn the sign of these columns, or of the joint's axis in the robot description.",
        )
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = np.sum(measured * simulated, axis=0) / np.sum(simulated**2, axis=0)
    low, high = 1 / limits.OTHER_UNIT, limits.OTHER_UNIT
    units = tuple(
        f"{where}: the torque of joint {j + 1} is {ratio[j]:.3g} times what the start values give: is it in the unit, "
        "and on the side of the gear, that the robot description means?"
        for j in np.flatnonzero((own > limits.FOLLOWS) & ((ratio > high) | (ratio < low)))
    )
    return (*gaps, *units)


def _gaps(experiment: Experiment, where: str) -> tuple[str, ...]:
    """What is said of samples that the logger has dropped."""
    places = experiment.places
    total = int(places[-1]) + 1
    if total == places.size:
        return ()
    first = experiment.time[np.argmax(np.diff(places) > 1)]
    missing = total - places.size
    return (
        f"{where}: {missing} of {total} torque samples {'is' if missing == 1 else 'are'} missing, the first of them "
        f"after t = {first:.6g} s. The others are used; a gap near a reversal hides what happens there.",
    )


def _correlations(measured: Array, simulated: Array) -> Array:
    """(n, n) correlation of each measured with each simulated torque; 0 where one is constant."""
    n = measured.shape[1]
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.nan_to_num(np.corrcoef(measured, simulated, rowvar=False)[:n, n:])


def _check_order(measured: Array, simulated: Array, where: str) -> None:
    """Raises InputError if another order of the joints explains the log far better."""
    size = np.maximum(np.mean(measured**2, axis=0), TINY)
    error = np.mean((measured[:, :, None] - simulated[:, None, :]) ** 2, axis=0) / size[:, None]
    rows, best = linear_sum_assignment(error)
    own, other = float(np.trace(error)), float(error[rows, best].sum())
    if own < limits.WRONG_ORDER * size.size or other > limits.OTHER_ORDER * own:
        return
    moved = [f"column {j + 1} shows joint {k + 1}" for j, k in zip(rows, best, strict=True) if j != k]
    raise InputError(
        "The measured torques seem to be in another order than the joints.",
        where=where,
        got=f"squared error {own:.3g} of the torque's square; {other:.3g} if {', '.join(moved)}",
        next_step="Check the columns of the torque log: torque: {columns: {tau1: ...}}.",
    )
