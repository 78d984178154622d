"""Where an estimation starts: given values, the robot description, or the reference trajectory."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fmu_didim.errors import InputError, UnknownNameError
from fmu_didim.prediction.problem import Problem
from fmu_didim.prediction.reference_start import from_reference
from fmu_didim.signals import Array

Start = str | Mapping[str, float]
KINDS = ("reference", "description")


def start_values(problem: Problem, start: Start) -> Array:
    """Base parameters (b,) to start from.

    Args:
        start: ``reference`` (see :func:`from_reference`; the plant's own values where it has no inverse model),
            ``description`` (the values of the robot description, regrouped), or values by name; names that are
            missing start at 0.

    Parameters of a plant without description start at its own values instead.

    Raises:
        InputError: another word; UnknownNameError: a name is not among the base parameters.
    """
    if start == "reference" and problem.parameters.has_regressor:
        return from_reference(problem)
    if isinstance(start, str) and start in KINDS:
        return problem.parameters.nominal()
    if isinstance(start, str):
        raise InputError("This start is not known.", where="start", got=start, valid=(*KINDS, "values by name"))
    for name in start:
        if name not in problem.parameters.names:
            raise UnknownNameError("base parameter", name, problem.parameters.names, where="start")
    parameters = problem.parameters
    missing = np.zeros(parameters.count) if parameters.has_regressor else parameters.nominal()
    return np.array([float(start.get(name, value)) for name, value in zip(parameters.names, missing, strict=True)])
