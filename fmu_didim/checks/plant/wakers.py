"""What would wake a parameter that does nothing: an input that changes, or another value of another parameter."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from fmu_didim.base.errors import FmuError, SimulationError
from fmu_didim.data.signals import Array
from fmu_didim.model.loop_model import LoopModel

MOST_TRIALS = 24
"""[trials] For one parameter, of two short simulations each: a model with many inputs is not searched to its end."""
SLOPE = 1.0
"""[1] Rise of an input over the record, of its size or of one unit where it is zero."""

Idle = Callable[[LoopModel, Array], bool]
"""Whether the parameter still does nothing in another model, at other values."""


def wakers(model: LoopModel, values: Array, place: int, is_idle: Idle) -> list[str]:
    """What wakes a parameter, in words; empty where nothing that was tried does.

    Args:
        values: (p,); place: of the parameter.
    """
    label = next(label for label in model.estimation_labels if model.free_parameters.acts(place, label))
    reference = model.experiments[label].reference
    constant = [k for k in range(len(reference.names)) if not np.ptp(reference.values[:, k])]
    found, trials = [], 0
    for k in constant:
        trials += 1
        if trials <= MOST_TRIALS and not _still(is_idle, _with_rise(model, label, k), values):
            found.append(f"an input {reference.names[k]} that changes")
    for i, parameter in enumerate(model.free_parameters):
        trials += 1
        if i == place or trials > MOST_TRIALS:
            continue
        other = values.copy()
        other[i] = values[i] + parameter.scale if values[i] + parameter.scale <= parameter.highest else parameter.lowest
        if np.isfinite(other[i]) and other[i] != values[i] and not _still(is_idle, model, other):
            found.append(f"{parameter.name} = {other[i]:.4g} instead of {values[i]:.4g}")
    return found


def _with_rise(model: LoopModel, label: str, column: int) -> LoopModel:
    """The model with one column of a reference that rises over its record."""
    experiment = model.experiments[label]
    values = experiment.reference.values.copy()
    size = abs(float(values[0, column])) or 1.0
    values[:, column] += SLOPE * size * np.linspace(0.0, 1.0, len(values))
    return model.with_experiment(label, replace(experiment, reference=replace(experiment.reference, values=values)))


def _still(is_idle: Idle, model: LoopModel, values: Array) -> bool:
    """Whether the parameter does nothing there; also where that cannot be simulated."""
    try:
        return is_idle(model, values)
    except (SimulationError, FmuError):
        return True
