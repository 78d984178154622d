"""Start values of an estimation: given ones, the robot description, or least squares on a motion.

Least squares of the measured torque on the regressor of a motion needs no initial values at all. The motion is the one
that the measured torque implies, by the inverse of the controller, or the reference. Impossible inertias, as
errors of the motion give light links, are replaced by the nearest possible ones.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from fmu_didim.base.errors import IdentificationError, InputError, UnknownNameError
from fmu_didim.data.signals import Array
from fmu_didim.estimators.starts.gains import free_gains, with_first_gains
from fmu_didim.estimators.starts.inverse_simulation import implied_motion
from fmu_didim.estimators.starts.reference_start import Motion, measured_of, rows_of, whole_reference
from fmu_didim.fit.linear_problem import LinearProblem
from fmu_didim.fit.noise.weighting import weighted_solution, whitened
from fmu_didim.fit.region import Region
from fmu_didim.fit.solver.admissible import mass_matrix_problem
from fmu_didim.model.free_parameter import DELAY, delay_parameter
from fmu_didim.model.loop_model import LoopModel, Simulation

NOMINAL_DEVIATION = 0.3
"""[1] Relative standard deviation of the values of a description in the start ``nominal``."""
NOMINAL_FLOOR = 0.01
"""[1] Their smallest size there, in units of the value at which a parameter alone makes up the torque."""

NEGLIGIBLE = 1e-3
"""[1] Part of the value in the description below which the size of a start value does not count."""

Start = str | Mapping[str, float]
KINDS = {
    "torque": "the motion that the measured torque implies",
    "reference": "the reference trajectory",
    "nominal": "the values of the description, corrected by the measured torque",
    "description": "the values of the description",
}
"""Starts in words, in the order in which they are tried."""
PRIOR, PRIOR_TEXT = "prior", "the values of the prior"
"""The start that comes before these where a case has a prior and asks for no other."""
SURE = 30.0
"""[1] By how much surer than it is a prior is there: what has none fits it."""


def start_sequence(model: LoopModel, start: Start) -> tuple[Start, ...]:
    """The start of a case, and those that are tried where it fails."""
    if not model.parameters.has_regressor:
        return (start,)
    if model.prior is not None and start == next(iter(KINDS)):
        return (PRIOR, *KINDS)
    return (start, *(kind for kind in KINDS if kind != start))


def start_text(start: Start) -> str:
    """A start in words."""
    return {**KINDS, PRIOR: PRIOR_TEXT}.get(start, start) if isinstance(start, str) else "the values of the case"


def start_values(model: LoopModel, start: Start) -> Array:
    """Values (p,) to start from.

    Args:
        start: ``torque`` (see :func:`~fmu_didim.estimators.starts.inverse_simulation.implied_motion`), ``reference``,
            ``nominal``
            (as ``torque``, every value held at that of the description as by a measurement), ``description`` (the
            values of the robot description, regrouped), or values by name; base parameters that are missing start at
            0, all others where they stand.

    Parameters of a plant without description start at its own values instead.

    Raises:
        InputError: another word; UnknownNameError: a name is not among the free parameters; SimulationError: the
            controller cannot be inverted; IdentificationError: the motion does not tell the parameters apart.
    """
    if start == PRIOR and model.prior is not None:
        sure = replace(model.prior, rows=SURE * model.prior.rows, target=SURE * model.prior.target)
        return _fitted(replace(model, prior=sure), whole_reference, held=False)
    if start not in KINDS if isinstance(start, str) else not isinstance(start, Mapping):
        raise InputError(
            "This start is not known.", where="start", got=start, valid=(*KINDS, "values by name"),
            next_step="Take one of these, or give values by name.",
        )  # fmt: skip
    if start == "description" or (isinstance(start, str) and not model.parameters.has_regressor):
        return model.start
    if isinstance(start, str):
        motion = whole_reference if start == "reference" else implied_motion
        return _fitted(model, motion, held=start == "nominal")
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


def _fitted(model: LoopModel, motion: Callable[[Simulation], Motion], *, held: bool) -> Array:
    """Values (p,): base parameters by weighted least squares on a motion, as physical links can have them.

    Args:
        held: whether each is held at its value in the description, which counts as measured.
    """
    columns, target = rows_of(model, motion)
    if model.loads and free_gains(model):
        measured = measured_of(model)
        model = with_first_gains(model, columns, target, measured)
        for joint, i in free_gains(model).items():
            target[:, joint] += (model.start[i] - 1) * measured[:, joint]
    count = model.linear_count
    deviation = weighted_solution(model, columns, target)[1]
    table, right = whitened(columns, deviation), (target / deviation).reshape(-1)
    if model.prior is not None:
        table, right = model.beside_prior(table), np.concatenate([right, model.prior.target])
    if held:
        size = np.linalg.norm(right) / np.maximum(np.linalg.norm(table, axis=0), np.finfo(float).tiny)
        prior = NOMINAL_DEVIATION * np.maximum(np.abs(model.start[:count]), NOMINAL_FLOOR * size)
        table = np.vstack([table, np.diag(1 / prior)])
        right = np.concatenate([right, model.start[:count] / prior])
    values = model.start
    equations = LinearProblem.of(table[:, None, :], right[:, None])
    values[:count] = equations.step(np.zeros(count), Region.of(model).of_start().of_base(count), 0.0)[0]
    return values


def simulatable(model: LoopModel, values: Array) -> tuple[Array, str]:
    """Values (p,) that can be simulated, and why they are not the given ones, if they are not: then the base parameters
    are the nearest possible, each relative to its own size."""
    reason = mass_matrix_problem(model, values)
    region, count = Region.of(model), model.linear_count
    if not reason or not region.machines:
        return values, reason
    size = np.maximum(np.abs(values[:count]), NEGLIGIBLE * np.maximum(np.abs(model.start[:count]), NEGLIGIBLE))
    try:
        found = region.of_start().of_base(count).least_squares(np.diag(1 / size), values[:count] / size).values
    except IdentificationError:  # what the description knows is not physical: the reason says more
        return values, reason
    moved = np.concatenate([found, values[count:]])
    return (values if mass_matrix_problem(model, moved) else moved), reason


def with_free_delay(model: LoopModel) -> LoopModel:
    """The model with the delay of its command free, if it is not so yet."""
    if any(parameter.owner == DELAY for parameter in model.free_parameters):
        return model
    samples = float(model.loop.systems[model.first].delays.get(model.loop.plant_name, 0.0))
    return model.with_free((*model.free_parameters, delay_parameter(samples)))
