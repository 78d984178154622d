"""Checks of the experiments against each other: held-out data that are not independent."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, REMARK, Diagnostic
from fmu_didim.data.signals import Array, Trajectory
from fmu_didim.model.experiment import Experiment
from fmu_didim.model.loop_model import LoopModel

COPIED = 0.5
"""[1] Fraction of the rows of a held-out log that a fitted one has, too, to the last digit."""
SAME_MOTION = 0.01
"""[1] RMS difference of two references over what the held-out one moves, below which their motions are the same: above
the noise of measured positions that serve as reference, far below what two planned motions share."""
COMPARED = 0.5
"""[1] Fraction of a held-out reference that another must cover to be compared: what lies beyond is new motion."""
ROUNDING_S = 1e-9
"""[s] By which two equal instants may differ."""

VALIDATION_COPIED = CATALOGUE(
    "validation-copied", DOUBT, rank=12,
    meaning="The log of a validation experiment is that of an estimation experiment, or part of it: the fit is "
    "compared with itself.",
    next_step="Record a run with another motion for the validation, or leave the validation out.",
)  # fmt: skip
VALIDATION_REPEATS = CATALOGUE(
    "validation-repeats-motion", REMARK, rank=90,
    meaning="A validation experiment follows the reference of an estimation experiment: it repeats the motion of the "
    "fit, and what the model lacks may be hidden in both. The prediction of another motion is untested.",
    next_step="Record a run with another motion for the validation.",
)  # fmt: skip
VALIDATION_WITHOUT_TORQUE = CATALOGUE(
    "validation-without-torque", DOUBT, rank=13,
    meaning="A validation experiment has no torque log, so nothing is validated.",
    next_step="Add torque: {file: ...} to it, or leave the validation out.",
)  # fmt: skip


def run_diagnostics(model: LoopModel, without_torque: Sequence[str] = ()) -> list[Diagnostic]:
    """Validation experiments without a log, with the log of an estimation experiment, or with its motion.

    Args:
        without_torque: labels of those that have none.
    """
    found = [
        Diagnostic(VALIDATION_WITHOUT_TORQUE, "It has no torque log, so nothing is compared with it.", label)
        for label in without_torque
    ]
    for label in model.experiments.validation_labels:
        for other in model.estimation_labels:
            part = copied(model.experiments[label].torque, model.experiments[other].torque)
            if part > COPIED:
                text = f"{100 * part:.0f} % of its torque log stand in that of {other}, to the last digit."
                found.append(Diagnostic(VALIDATION_COPIED, text, label, part, COPIED, "1"))
                continue
            own, fitted = model.experiments[label], model.experiments[other]
            if own.external_torques != fitted.external_torques:
                continue
            apart = difference(during_log(own), during_log(fitted))
            if apart < SAME_MOTION:
                text = (
                    f"Its reference is that of {other} but for {100 * apart:.2g} %: the prediction of another motion "
                    "is untested."
                )
                found.append(Diagnostic(VALIDATION_REPEATS, text, label, apart, SAME_MOTION, "1"))
    return found


def during_log(experiment: Experiment) -> Trajectory:
    """The reference from the first to the last sample of the torque log: one file may serve several parts of a run."""
    reference, time = experiment.reference, experiment.time
    inside = (reference.time >= time[0] - ROUNDING_S) & (reference.time <= time[-1] + ROUNDING_S)
    return replace(reference, time=reference.time[inside], values=reference.values[inside])


def difference(reference: Trajectory, other: Trajectory) -> float:
    """RMS difference of two references, each from its first row on, over what the first one moves while both last; the
    largest of all positions and injected signals that change in either. Infinite where they cannot be compared:
    nothing moves, a signal is missing, or the other covers too little of the first."""
    names = [name for name in reference.names if not name.startswith(("dq", "ddq"))]
    if not any(name.startswith("q") for name in names) or any(name not in other.names for name in names):
        return float("inf")
    time, times = reference.time - reference.time[0], other.time - other.time[0]
    both = time <= times[-1] + ROUNDING_S
    if np.count_nonzero(both) <= COMPARED * time.size:
        return float("inf")
    found = []
    for name in names:
        own = reference.column(name)[both]
        gap = own - np.interp(time[both], times, other.column(name))
        moved, apart = float(np.std(own)), float(np.sqrt(np.mean(gap**2)))
        if moved > 0:
            found.append(apart / moved)
        elif np.ptp(other.column(name)) > 0:
            return float("inf")
    return max(found, default=float("inf"))


def copied(torque: Array, other: Array) -> float:
    """Fraction of the distinct rows of a log (N, n) that another (M, n) has, too; 0 for a log at rest."""
    own, known = np.unique(torque, axis=0), {row.tobytes() for row in other}
    if own.shape[0] <= 0.5 * torque.shape[0]:
        return 0.0
    return float(np.mean([row.tobytes() in known for row in own]))
