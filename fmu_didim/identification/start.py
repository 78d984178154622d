"""Where an estimation starts: given values, the robot description, or the reference trajectory."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fmu_didim.errors import InputError, UnknownNameError
from fmu_didim.prediction.free_parameter import DELAY, delay_parameter
from fmu_didim.prediction.loop_model import LoopModel
from fmu_didim.prediction.reference_start import from_reference
from fmu_didim.signals import Array

Start = str | Mapping[str, float]
KINDS = ("reference", "description")


def start_values(model: LoopModel, start: Start) -> Array:
    """Values (p,) to start from.

    Args:
        start: ``reference`` (see :func:`~fmu_didim.prediction.reference_start.from_reference`; the plant's own values
            where it has no inverse model), ``description`` (the values of the robot description, regrouped), or values
            by name; base parameters that are missing start at 0, all others where they stand.

    Parameters of a plant without description start at its own values instead.

    Raises:
        InputError: another word; UnknownNameError: a name is not among the free parameters.
    """
    if start == "reference" and model.parameters.has_regressor:
        return from_reference(model)
    if isinstance(start, str) and start in KINDS:
        return model.start
    if isinstance(start, str):
        raise InputError("This start is not known.", where="start", got=start, valid=(*KINDS, "values by name"))
    for name in start:
        if name not in model.names:
            raise UnknownNameError("base parameter", name, model.names, where="start")
    missing = model.start
    if model.parameters.has_regressor:
        missing[: model.linear_count] = 0.0
    values = [start.get(name, value) for name, value in zip(model.names, missing, strict=True)]
    # An experiment's own value starts at that of all where it is not given.
    for i in range(model.parameters.count, model.linear_count):
        key = model.free_parameters[i].key
        if model.names[i] not in start and key in start:
            values[i] = start[key]
    return np.array(values, dtype=float)


def with_free_delay(model: LoopModel) -> LoopModel:
    """The model with the delay of its command free, if it is not so yet."""
    if any(parameter.owner == DELAY for parameter in model.free_parameters):
        return model
    return model.with_free([delay_parameter(float(model.systems[model.first].delays.get(model.plant_name, 0.0)))])
