"""How the torque changes with the free parameters of a loop, by simulations side by side."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from fmu_didim.errors import SimulationError
from fmu_didim.prediction.external_torque import EXTERNAL_TORQUE
from fmu_didim.prediction.loop_model import FreeParameter, LoopModel
from fmu_didim.prediction.repetition import Repetition, repetition
from fmu_didim.signals import Array

STEP = 1e-4
"""Step of the forward differences, in units of a free parameter's scale: our loops are smooth to 1e-10, truncation
rules."""
_First: TypeAlias = tuple[Repetition, LoopModel]
"""How a log repeats, and the model of its first part alone."""


def sensitivity(model: LoopModel, values: Array, torque: Array, *, only: Sequence[int] = ()) -> Array:
    """d torque / d values, (N, n, p) or of ``only`` some free parameters, by forward differences on the training data.

    Where the motion and the torque repeat, a base parameter is moved for the first period alone.

    Args:
        torque: (N, n) at the values.
    """
    chosen = list(only) if len(only) else list(range(len(model.free_parameters)))
    model = model.integrated_as(values)  # other steps of the integration would look like a change
    first = _first_part(model, torque)
    return np.stack(model.side_by_side([_column(model, i, values, torque, first) for i in chosen]), axis=2)


def _first_part(model: LoopModel, torque: Array) -> _First | None:
    run = model.runs["train"]
    problem = run.problem
    if problem.low_pass is not None or "t_start" in {v.name for v in model.plant.parameters}:
        return None  # the ends of a filtered log are not like its middle; a plant with a clock need not repeat
    found = repetition(problem.experiment, run.operator, problem.system.step_size, torque)
    if found is None:
        return None
    return found, replace(model, runs={**model.runs, "train": replace(run, operator=found.operator)})


def _column(model: LoopModel, i: int, values: Array, torque: Array, first: _First | None) -> Callable[[], Array]:
    parameter = model.free_parameters[i]

    def difference() -> Array:
        for size in (STEP, -STEP, STEP / 30):
            moved = values.copy()
            moved[i] = values[i] + size * parameter.scale
            if not parameter.lowest <= moved[i] <= parameter.highest:
                continue
            try:
                change = _change(model, moved, torque, first if _lasts(parameter) else None)
                return np.asarray(change / (moved[i] - values[i]))
            except SimulationError:
                continue
        return np.zeros_like(torque)  # a free parameter that cannot be moved explains nothing

    return difference


def _lasts(parameter: FreeParameter) -> bool:
    """Whether a free parameter acts all the time: one of an effect may begin late, of which its first period shows
    nothing."""
    return parameter.effect is None and parameter.owner != EXTERNAL_TORQUE


def _change(model: LoopModel, moved: Array, torque: Array, first: _First | None) -> Array:
    if first is not None:
        found, begin = first
        change = found.continued(begin.torque(moved) - torque[: found.operator.count])
        if change is not None:
            return change
    return np.asarray(model.torque(moved) - torque)
