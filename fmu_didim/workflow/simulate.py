"""The verb ``simulate``: the loop of a case at the control rate, or a model with its inputs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from fmu_didim.base.errors import InputError, UnknownNameError
from fmu_didim.case import Case, CaseParts, case_of, with_objects
from fmu_didim.case.runs.experiment import initial_state_of
from fmu_didim.cosim import Instants, sample_operator
from fmu_didim.data.signals import Array, Trajectory
from fmu_didim.fit.solver.admissible import mass_matrix_problem
from fmu_didim.model.experiment import Experiment
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.simulated_table import simulated_table


@with_objects
def simulate(
    case: Case | Path | str | Mapping[str, Any] | None = None,
    *,
    parameters: Mapping[str, float] | None = None,
    experiment: str | None = None,
    **objects: Unpack[CaseParts],
) -> Trajectory:
    """Simulate the loop of a case at the control rate, or the model of a case with the inputs of an experiment.

    Args:
        case: a loaded case, the path of its file, or its content; torque logs are not needed.
        robot, plant, controller, log, reference, validation, loop, model, inputs, measured: objects in the place of
            what the case has, as of
            :func:`identify`.
        parameters: free parameters by name; the values of the robot description, or of the model, by default.
        experiment: label of the experiment whose reference is followed, or whose inputs act; the first one by default.

    Returns:
        Columns ``tau<j>`` (N.m or N), ``q<j>``, ``dq<j>``, ``ddq<j>`` (rad or m, per s, per s2) at the ticks; motions
        that the plant does not give are left out. Of a model its outputs that were measured, and its inputs, in its
        own units.

    Raises:
        InputError, UnknownNameError: the case or a name is wrong; SimulationError: the loop diverged.
    """
    case = case_of(case, objects, require_torque=False)
    model = model_without_data(case, experiment)
    values = named_values(model, parameters or {})
    reason = mass_matrix_problem(model, values)
    if reason:
        raise InputError(
            f"These parameters cannot be simulated: {reason}.", where="parameters", got=dict(parameters or {}),
            next_step="Give values for which every mass and inertia is positive.",
        )  # fmt: skip
    return simulated_table(model.simulation(values), motion=("q", "dq", "ddq"), sampled=True)


def model_without_data(case: Case, label: str | None) -> LoopModel:
    """The loop of a case along the reference of an experiment, by default the first, whose torque is not needed; of a
    model with the inputs of that experiment."""
    label = label or next(iter(case.document.runs))
    reference = case.reference(label)
    if case.data is not None:
        return case.model.on(label)
    nothing = np.zeros((1, case.parameters.joint_count))
    changes = case.document.runs[label].instants is not None
    every = sample_operator(
        reference.time, start=float(reference.time[0]), step=reference.step, tick_count=reference.time.size,
        instants=Instants(reference.time, case.step_size) if changes else None,
    )  # fmt: skip
    begin = initial_state_of(case.document.runs[label])
    experiment = Experiment(
        reference, reference.time[:1], nothing, every, label=label, initial_state=begin,
        measured_starts=case.measured_starts(label, reference),
    )  # fmt: skip
    return case.model_on({label: experiment})


def named_values(model: LoopModel, given: Mapping[str, float]) -> Array:
    """Free parameters (p,): these, and those of the descriptions for all others."""
    values = model.start
    for name, value in given.items():
        if name not in model.names:
            raise UnknownNameError("parameter that is identified", name, model.names, where="parameters")
        values[model.names.index(name)] = value
    return values
