"""Checks of the experiments against each other: held-out data that are not independent."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, Diagnostic
from fmu_didim.data.signals import Array
from fmu_didim.model.loop_model import LoopModel

COPIED = 0.5
"""[1] Fraction of the rows of a held-out log that a fitted one has, too, to the last digit."""

VALIDATION_COPIED = CATALOGUE(
    "validation-copied", DOUBT, rank=12,
    meaning="The log of a validation experiment is that of an estimation experiment, or part of it: the fit is "
    "compared with itself.",
    next_step="Record a run with another motion for the validation, or leave the validation out.",
)  # fmt: skip
VALIDATION_WITHOUT_TORQUE = CATALOGUE(
    "validation-without-torque", DOUBT, rank=13,
    meaning="A validation experiment has no torque log, so nothing is validated.",
    next_step="Add torque: {file: ...} to it, or leave the validation out.",
)  # fmt: skip


def run_diagnostics(model: LoopModel, without_torque: Sequence[str] = ()) -> list[Diagnostic]:
    """Validation experiments without a log, or with the log of an estimation experiment.

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
    return found


def copied(torque: Array, other: Array) -> float:
    """Fraction of the distinct rows of a log (N, n) that another (M, n) has, too; 0 for a log at rest."""
    own, known = np.unique(torque, axis=0), {row.tobytes() for row in other}
    if own.shape[0] <= 0.5 * torque.shape[0]:
        return 0.0
    return float(np.mean([row.tobytes() in known for row in own]))
