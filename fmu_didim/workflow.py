"""The verbs of the Python API: identify and simulate a case."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fmu_didim.cache import file_digest
from fmu_didim.case import Case, load_case
from fmu_didim.case.data import resolve
from fmu_didim.case.document import ExperimentSource, SignalFile
from fmu_didim.errors import InputError, UnknownNameError
from fmu_didim.estimators import Progress, no_progress
from fmu_didim.identification.estimate import Estimate, RefusedError
from fmu_didim.identification.guard import mass_matrix_problem
from fmu_didim.identification.problem import Experiment, Problem, drive_torque, joint_signals
from fmu_didim.identification.provenance import provenance
from fmu_didim.identification.result import ResultDocument, refused_document, result_document, save_result
from fmu_didim.identification.validation import Validation, validate
from fmu_didim.master import SampleOperator, sample_operator, simulate
from fmu_didim.robot import write_robot
from fmu_didim.signals import Trajectory, Variable

ROBOT_FILE = "robot_identified.yaml"
"""The robot description with the identified values: from it come the FMU (``fmu-didim export``) and the model."""


@dataclass(frozen=True)
class Outcome:
    """What :func:`identify` returns.

    Attributes:
        document: the content of ``result.json``.
        estimate: the estimate with its arrays.
        validations: direct validation, and cross validation if the case has a second experiment.
    """

    document: ResultDocument
    estimate: Estimate
    validations: tuple[Validation, ...]


def identify(case: Case | Path | str, *, out: Path | str | None = None, progress: Progress = no_progress) -> Outcome:
    """Identify the parameters of a case, validate them and, with ``out``, save result and report there.

    Args:
        case: a loaded case or the path of its file.
        out: folder for ``result.json``, the torque tables, ``report.html`` and ``robot_identified.yaml``.
        progress: called with each iteration.

    Raises:
        InputError: something in the case is wrong; found before any long work.
        RefusedError: no physical answer was found; with ``out``, a result that says so is saved first.
    """
    case = case if isinstance(case, Case) else load_case(case)
    problem = case.problem
    assert problem is not None
    record = provenance(problem, case.estimator.describe(), validation=case.validation, files=_files(case))
    try:
        estimate = case.estimator.estimate(problem, progress=progress)
    except RefusedError as error:
        if out is not None:
            _save(refused_document(case.name, problem, case.estimator.name, error, record), (), Path(out))
        raise
    estimate = replace(estimate, provenance=record)
    found = _with_delay(problem, estimate)
    validations = [validate(found, estimate.base_value, problem.experiment, label="train")]
    if case.validation is not None:
        # Test signals of the second experiment need their own wiring.
        system = case.system(case.validation.reference)
        there = replace(found, system=replace(system, delays=found.system.delays))
        validations.append(validate(there, estimate.base_value, case.validation, label="validation"))
    document = result_document(case.name, found, estimate, validations, description=case.document.description)
    if out is not None:
        _save(document, validations, Path(out))
        described = problem.parameters.described(estimate.base_value)
        if described is not None:
            write_robot(described, Path(out) / ROBOT_FILE)
    return Outcome(document, estimate, tuple(validations))


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
    reference = case.reference(which)
    names = case.parameters.names
    theta = case.parameters.nominal()
    for name, value in (parameters or {}).items():
        if name not in names:
            raise UnknownNameError("base parameter", name, names, where="parameters")
        theta[names.index(name)] = value
    nothing = np.zeros((1, case.parameters.joint_count))
    experiment = Experiment(reference, reference.time[:1], nothing, _every_tick(reference))
    problem = Problem(case.system(reference), case.parameters, experiment)
    reason = mass_matrix_problem(problem, theta)
    if reason:
        raise InputError(
            f"These parameters cannot be simulated: {reason}.", where="parameters", got=dict(parameters or {})
        )
    recording = simulate(problem.system_with(theta), reference, bounds=problem.position_bounds())
    joints = range(1, problem.joint_count + 1)
    columns = [drive_torque(problem, recording)]
    variables = [Variable(f"tau{j}") for j in joints]
    for name in ("q", "dq", "ddq"):
        if set(joint_signals(problem, name)) <= set(recording.applied):
            columns.append(recording.table(joint_signals(problem, name)))
            variables += [Variable(f"{name}{j}") for j in joints]
    return Trajectory(recording.time, np.column_stack(columns), tuple(variables))


def _every_tick(reference: Trajectory) -> SampleOperator:
    step = float(reference.time[1] - reference.time[0])
    return sample_operator(reference.time, start=float(reference.time[0]), step=step, tick_count=reference.time.size)


def _with_delay(problem: Problem, estimate: Estimate) -> Problem:
    if "delay" in estimate.names:
        return problem.with_delay(float(estimate.value[estimate.names.index("delay")]))
    return problem


def _save(document: ResultDocument, validations: tuple[Validation, ...] | list[Validation], out: Path) -> None:
    from fmu_didim.report import write_report

    save_result(document, validations, out)
    write_report(out)


def _files(case: Case) -> dict[str, str]:
    """SHA-256 of the files that the case reads, under the names it gives them."""
    document = case.document
    named: dict[str, Path] = {}
    for source in (document.robot, document.plant.source, document.controller.source):
        if source is not None and ":" not in source:
            named[source] = case.folder / source
    for experiment in (document.train, document.validation):
        for signal in _signals(experiment):
            named[signal.file] = resolve(signal, case.folder)
    return {name: file_digest(path) for name, path in named.items() if path.is_file()}


def _signals(experiment: ExperimentSource | None) -> list[SignalFile]:
    if experiment is None:
        return []
    parts = (experiment.reference, experiment.torque, experiment.positions)
    return [part for part in parts if isinstance(part, SignalFile)]
