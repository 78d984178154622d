"""The verbs of the Python API: identify, simulate and export a case; ``discover`` has a module of its own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fmu_didim import discovering
from fmu_didim.cache import file_digest
from fmu_didim.case import Case, load_case
from fmu_didim.case.data import resolve
from fmu_didim.case.document import ExperimentSource, SignalFile
from fmu_didim.discovery.findings import FindingsDocument
from fmu_didim.documents import load_yaml
from fmu_didim.errors import InputError, UnknownNameError
from fmu_didim.estimators import Progress, no_progress
from fmu_didim.identification.acting import check_acting, start_warnings
from fmu_didim.identification.consistency import check_consistency
from fmu_didim.identification.estimate import Estimate, RefusedError
from fmu_didim.identification.guard import mass_matrix_problem
from fmu_didim.identification.problem import Experiment, Problem, command_torque, joint_signals
from fmu_didim.identification.provenance import provenance
from fmu_didim.identification.result import (
    ConsistencyResult,
    ResultDocument,
    consistency_result,
    load_result,
    refused_document,
    result_document,
    save_result,
)
from fmu_didim.identification.validation import Validation, validate
from fmu_didim.master import SampleOperator, sample_operator, simulate
from fmu_didim.robot import write_robot
from fmu_didim.signals import Array, Trajectory, Variable
from fmu_didim.ssp import write_ssp

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
    known, remarks = _known_of_plant(case, problem)
    record = provenance(problem, case.estimator.describe(), validation=case.validation, files=_files(case))
    if case.document.plant.parameter_names:
        record["parameter_names"] = dict(case.document.plant.parameter_names)
    try:
        estimate = case.estimator.estimate(problem, progress=progress)
    except RefusedError as error:
        if out is not None:
            refused = refused_document(case.name, problem, case.estimator.name, error, record)
            known["remarks"] = remarks
            _save(refused.model_copy(update={**known, "loop": _loop(case, refused)}), (), Path(out))
        raise _with_warnings(error, known.get("consistency"), remarks) from error
    estimate = replace(estimate, provenance=record, remarks=(*remarks, *estimate.remarks))
    found = _with_delay(problem, estimate)
    validations = [validate(found, estimate.base_value, problem.experiment, label="train")]
    if case.validation is not None:
        # Test signals of the second experiment need their own wiring.
        system = case.system(case.validation.reference)
        there = replace(found, system=replace(system, delays=found.system.delays))
        validations.append(validate(there, estimate.base_value, case.validation, label="validation"))
    document = result_document(case.name, found, estimate, validations, description=case.document.description)
    document = document.model_copy(update={**known, "loop": _loop(case, document)})
    if out is not None:
        _save(document, validations, Path(out))
        described = problem.parameters.described(estimate.base_value)
        if described is not None:
            write_robot(described, Path(out) / ROBOT_FILE)
    return Outcome(document, estimate, tuple(validations))


def discover(case: Case | Path | str, out: Path | str | None = None, **options: Any) -> FindingsDocument:
    """Find the physical effects that the model of a case lacks: see :func:`fmu_didim.discovering.discover`."""
    case = case if isinstance(case, Case) else load_case(case)
    return discovering.discover(case, out, files=_files(case), **options)


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
    problem = _without_data(case, which)
    theta = _base_values(case, parameters or {})
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


def export_ssp(case: Case | Path | str, path: Path | str, *, result: Path | str | None = None) -> Path:
    """Write the closed loop of a case as an SSP archive.

    Args:
        path: the ``.ssp`` file.
        result: ``result.json`` or its folder; its values, the delay among them, go into the archive instead of those
            of the robot description.

    Raises:
        InputError: a component is no FMU, or there is no such result, or it holds no values of this case.
    """
    case = case if isinstance(case, Case) else load_case(case, require_torque=False)
    problem = _without_data(case, "train")
    values: dict[str, float] = {}
    if result is not None:
        folder = Path(result).parent if Path(result).suffix == ".json" else Path(result)
        document = load_result(folder)
        values = {name: p.value for name, p in document.parameters.items()}
        if not values:
            raise InputError("The result holds no values.", where=str(result), got=document.status)
        if "delay" in values and "delay" not in case.parameters.names:
            problem = problem.with_delay(values.pop("delay"))
    system = problem.system_with(_base_values(case, values))
    return write_ssp(system, path, name=case.name)


def _without_data(case: Case, which: str) -> Problem:
    """The loop of a case along the reference of an experiment whose torque is not needed."""
    reference = case.reference(which)
    nothing = np.zeros((1, case.parameters.joint_count))
    return case.problem_on(Experiment(reference, reference.time[:1], nothing, _every_tick(reference)))


def _base_values(case: Case, given: Mapping[str, float]) -> Array:
    """Base parameters (b,): these, and the description's for all others."""
    names, theta = case.parameters.names, case.parameters.nominal()
    for name, value in given.items():
        if name not in names:
            raise UnknownNameError("base parameter", name, names, where="parameters")
        theta[names.index(name)] = value
    return theta


def _known_of_plant(case: Case, problem: Problem) -> tuple[dict[str, Any], list[str]]:
    """What is found of a plant of its own before the long work: entries of the result, and remarks.

    Raises:
        InputError: an identified parameter has no effect in the plant.
    """
    if case.document.plant.source is None and case.base is None:
        return {}, []  # the plant is made from the description
    known = {}
    if problem.parameters.has_regressor:
        known["consistency"] = consistency_result(check_consistency(problem))
    check_acting(problem)
    return known, start_warnings(problem)


def _with_warnings(error: RefusedError, found: ConsistencyResult | None, remarks: list[str]) -> RefusedError:
    """The refusal with what was known of the plant before, which may be its cause."""
    known = [*(found.warnings if found is not None else ()), *remarks]
    if not known:
        return error
    got = "; ".join(str(part) for part in (error.got, "before, it was seen of the plant: " + " ".join(known)) if part)
    return RefusedError(error.what, iterations=list(error.iterations), got=got, next_step=error.next_step)


def _loop(case: Case, document: ResultDocument) -> dict[str, Any]:
    """The loop of a result, with the sources that the case names."""
    components = {name: dict(told) for name, told in document.loop["components"].items()}
    if case.document.system is not None:
        for told in components.values():
            told["archive"] = case.document.system.source
    else:
        controller = case.document.controller.source if case.document.controller is not None else None
        for name, source in (("controller", controller), ("plant", case.document.plant.source)):
            told = {"source": source or case.document.robot}
            if name == "controller" and controller is not None and controller.endswith((".yaml", ".yml")):
                told["law"] = load_yaml(case.folder / controller).get("law")
            components[name] = {**told, **components[name]}
    return {**document.loop, "components": components}


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
    controller = document.controller.source if document.controller is not None else None
    archive = document.system.source if document.system is not None else None
    for source in (document.robot, document.plant.source, controller, archive):
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
