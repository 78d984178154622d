"""The verb ``simulate``: the loop of a case at the control rate."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from fmu_didim.case import Case, load_case
from fmu_didim.errors import InputError, UnknownNameError
from fmu_didim.master import SampleOperator, sample_operator, simulate
from fmu_didim.prediction.guard import mass_matrix_problem
from fmu_didim.prediction.problem import Experiment, Problem, command_torque, joint_signals
from fmu_didim.signals import Array, Trajectory, Variable


def simulate_case(
    case: Case | Path | str, *, parameters: Mapping[str, float] | None = None, which: str = "train"
) -> Trajectory:
    """Simulate the loop of a case at the control rate.

    Args:
        parameters: base parameters by name; the values of the robot description by default.
        which: the reference of ``train`` or ``validation``.

    Returns:
        Columns ``tau<j>``, ``q<j>``, ``dq<j>``, ``ddq<j>`` at the ticks.

    Raises:
        InputError, UnknownNameError: the case or a name is wrong; SimulationError: the loop diverged.
    """
    case = case if isinstance(case, Case) else load_case(case, require_torque=False)
    problem = loop_without_data(case, which)
    theta = base_values(case, parameters or {})
    reason = mass_matrix_problem(problem, theta)
    if reason:
        raise InputError(
            f"These parameters cannot be simulated: {reason}.", where="parameters", got=dict(parameters or {})
        )
    reference = problem.experiment.reference
    recording = simulate(problem.system_with(theta), reference, bounds=problem.position_bounds())
    joints = range(1, problem.joint_count + 1)
    columns = [command_torque(problem, recording)]
    variables = [Variable(f"tau{j}") for j in joints]
    for name in ("q", "dq", "ddq"):
        if set(joint_signals(problem, name)) <= set(recording.applied):
            columns.append(recording.table(joint_signals(problem, name)))
            variables += [Variable(f"{name}{j}") for j in joints]
    return Trajectory(recording.time, np.column_stack(columns), tuple(variables))


def loop_without_data(case: Case, which: str) -> Problem:
    """The loop of a case along the reference of an experiment whose torque is not needed."""
    reference = case.reference(which)
    nothing = np.zeros((1, case.parameters.joint_count))
    return case.problem_on(Experiment(reference, reference.time[:1], nothing, _every_tick(reference)))


def base_values(case: Case, given: Mapping[str, float]) -> Array:
    """Base parameters (b,): these, and the description's for all others."""
    names, theta = case.parameters.names, case.parameters.nominal()
    for name, value in given.items():
        if name not in names:
            raise UnknownNameError("base parameter", name, names, where="parameters")
        theta[names.index(name)] = value
    return theta


def _every_tick(reference: Trajectory) -> SampleOperator:
    step = float(reference.time[1] - reference.time[0])
    return sample_operator(reference.time, start=float(reference.time[0]), step=step, tick_count=reference.time.size)
