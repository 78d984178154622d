"""The verb ``identify``: a case in; the estimate, its validation and the files of the result out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from fmu_didim.case import Case, load_case
from fmu_didim.diagnosis.acting import check_acting, start_warnings
from fmu_didim.diagnosis.consistency import check_consistency
from fmu_didim.diagnosis.validation import Validation, validate
from fmu_didim.estimators import Progress, no_progress
from fmu_didim.identification.document import consistency_result, refused_document, result_document
from fmu_didim.identification.estimate import Estimate, RefusedError
from fmu_didim.identification.provenance import provenance
from fmu_didim.identification.result import ConsistencyResult, ResultDocument, save_result
from fmu_didim.identification.start import with_free_delay
from fmu_didim.prediction.loop_model import LoopModel
from fmu_didim.robot import write_robot
from fmu_didim.workflow.case_files import case_files
from fmu_didim.workflow.check import has_own_plant
from fmu_didim.workflow.loop import described_loop
from fmu_didim.workflow.outcome import Outcome

ROBOT_FILE = "robot_identified.yaml"
OWN_ROBOT_FILE = "robot_identified_{label}.yaml"
"""The robot description with the identified values: from it come the FMU (``fmu-didim export``) and the model."""


def identify(
    case: Case | Path | str | Mapping[str, Any], out: Path | str | None = None, *, progress: Progress | None = None
) -> Outcome:
    """Identify the parameters of a case, validate them and, with ``out``, save result and report there.

    Args:
        case: a loaded case, the path of its file, or its content.
        out: folder for ``result.json``, the torque tables, ``report.html``, ``robot_identified.yaml`` with the values
            that all experiments share, and ``robot_identified_<label>.yaml`` for each that has some of its own.
        progress: called with each :class:`~fmu_didim.prediction.iteration.Iteration`.

    Raises:
        InputError: something in the case is wrong; found before any long work.
        RefusedError: no physical answer was found; with ``out``, a result that says so is saved first.
        IdentificationError: the data cannot tell some parameters apart.
    """
    case = case if isinstance(case, Case) else load_case(case)
    model = case.model
    known, remarks = _known_of_plant(case, model)
    record = provenance(model, case.estimator.describe(), files=case_files(case))
    if case.document.plant.parameter_names:
        record["parameter_names"] = dict(case.document.plant.parameter_names)
    try:
        estimate = case.estimator.estimate(model, progress=progress or no_progress)
    except RefusedError as error:
        if out is not None:
            refused = refused_document(case.name, model, case.estimator.name, error, record)
            known["remarks"] = remarks
            _save(refused.model_copy(update={**known, "loop": described_loop(case, refused.loop)}), (), Path(out))
        raise _with_warnings(error, known.get("consistency"), remarks) from error
    estimate = replace(estimate, provenance=record, remarks=(*remarks, *estimate.remarks))
    found = _found(model, estimate)
    validations = [validate(found, found.start, label) for label in found.experiments]
    document = result_document(case.name, found, estimate, validations, description=case.document.description)
    document = document.model_copy(update={**known, "loop": described_loop(case, document.loop)})
    if out is not None:
        _save(document, validations, Path(out))
    outcome = Outcome(document, estimate, tuple(validations), found)
    if out is not None and outcome.robot is not None:
        write_robot(outcome.robot, Path(out) / ROBOT_FILE)
        for label, robot in outcome.robots.items():
            write_robot(robot, Path(out) / OWN_ROBOT_FILE.format(label=label))
    return outcome


def _found(model: LoopModel, estimate: Estimate) -> LoopModel:
    """The model with the identified values; a delay that only the estimator freed is among them."""
    found = with_free_delay(model) if len(estimate.names) > len(model.names) else model
    return found.with_values(estimate.value)


def _known_of_plant(case: Case, model: LoopModel) -> tuple[dict[str, Any], list[str]]:
    """What is found of a plant of its own before the long work: entries of the result, and remarks.

    Raises:
        InputError: an identified parameter has no effect in the plant.
    """
    if not has_own_plant(case):
        return {}, []
    known = {}
    if model.parameters.has_regressor:
        known["consistency"] = consistency_result(check_consistency(model))
    check_acting(model)
    return known, start_warnings(model)


def _with_warnings(error: RefusedError, found: ConsistencyResult | None, remarks: list[str]) -> RefusedError:
    """The refusal with what was known of the plant before, which may be its cause."""
    known = [*(found.warnings if found is not None else ()), *remarks]
    if not known:
        return error
    got = "; ".join(str(part) for part in (error.got, "before, it was seen of the plant: " + " ".join(known)) if part)
    return RefusedError(
        error.what, iterations=error.iterations, got=got, next_step=error.next_step, values=error.values,
        deviation=error.deviation,
    )  # fmt: skip


def _save(document: ResultDocument, validations: tuple[Validation, ...] | list[Validation], out: Path) -> None:
    from fmu_didim.report import write_report

    save_result(document, validations, out)
    write_report(out)
