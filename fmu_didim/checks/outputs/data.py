"""Checks of the data of a model before any fit: its inputs and what was measured of its outputs."""

from __future__ import annotations

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, REMARK, Diagnostic
from fmu_didim.checks.data.log import column_diagnostics
from fmu_didim.checks.data.runs import VALIDATION_COPIED, copied
from fmu_didim.checks.outputs.before import before_the_fit
from fmu_didim.model.loop_model import LoopModel

COPIED = 0.5
"""[1] Fraction of the rows of a held-out log that a fitted one has, too, to the last digit."""

INPUT_RESTS = CATALOGUE(
    "input-rests", REMARK, rank=88,
    meaning="An input of a model has one value in all fitted experiments: what it does when it moves is not known from "
    "them.",
    next_step="Record an experiment in which it moves.",
)  # fmt: skip


def model_data_diagnostics(model: LoopModel) -> list[Diagnostic]:
    """What is to be said of the data of a model."""
    experiments = model.experiments
    found = [told for experiment in experiments.values() for told in experiment.told]
    references = [experiments[label].reference for label in model.estimation_labels]
    for name in references[0].names:
        values = np.concatenate([r.column(name) for r in references if name in r.names])
        if not np.ptp(values):
            text = f"It is {values[0]:.4g} throughout: what it does when it moves is not known from these data."
            found.append(Diagnostic(INPUT_RESTS, text, f"input {name}"))
    found += before_the_fit(model)
    for label, experiment in experiments.items():
        columns = dict(zip(model.loop.labels, experiment.torque.T, strict=True))
        columns |= {channel.name: channel.values for channel in experiment.channels}
        for name, values in columns.items():
            found += column_diagnostics(values, f"{label}: {name}")
    for label in experiments.validation_labels:
        for other in model.estimation_labels:
            part = copied(experiments[label].torque, experiments[other].torque)
            if part > COPIED:
                text = f"{100 * part:.0f} % of its rows stand in {other}, to the last digit."
                found.append(Diagnostic(VALIDATION_COPIED, text, label, part, COPIED, "1"))
    return found
