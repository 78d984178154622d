"""The verb ``identify``: a case in; the estimate, its validation and the files of the result out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from fmu_didim.case import Case, load_case
from fmu_didim.diagnosis.acting import check_acting, start_diagnostics
from fmu_didim.diagnosis.consistency import Consistency, check_consistency, plant_diagnostics
from fmu_didim.diagnosis.validation import Validation, validate
from fmu_didim.diagnostics import REMARK, DiagnosedError, Diagnostic, by_weight, refuse_problems
from fmu_didim.errors import FmuDidimError, IdentificationError
from fmu_didim.estimators import Progress, no_progress
from fmu_didim.identification.document import consistency_result, refused_document, result_document
from fmu_didim.identification.estimate import Estimate, RefusedError
from fmu_didim.identification.judge import judged
from fmu_didim.identification.provenance import provenance
from fmu_didim.identification.result import ResultDocument, save_result
from fmu_didim.identification.start import with_free_delay
from fmu_didim.prediction.loop_model import LoopModel
from fmu_didim.robot import write_robot
from fmu_didim.workflow.case_files import case_files
from fmu_didim.workflow.check import has_own_plant
from fmu_didim.workflow.data import case_diagnostics
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
    record = provenance(model, case.estimator.describe(), files=case_files(case))
    if case.document.plant.parameter_names:
        record["parameter_names"] = dict(case.document.plant.parameter_names)
    known: dict[str, Any] = {}

    def refused(error: FmuDidimError, before: Sequence[Diagnostic]) -> None:
        if out is not None:
            document = refused_document(case.name, model, case.estimator.name, error, record, known=before)
            _save(document.model_copy(update={**known, "loop": described_loop(case, document.loop)}), (), Path(out))

    try:
        of_data = refuse_problems(case_diagnostics(case, model))
        consistency, of_plant = _known_of_plant(case, model)
    except DiagnosedError as error:
        refused(error, error.found)
        raise
    before = by_weight([*of_data, *of_plant])
    if consistency is not None:
        known["consistency"] = consistency_result(consistency)
    try:
        estimate = case.estimator.estimate(model, progress=progress or no_progress)
    except RefusedError as error:
        refused(error, before)
        raise _with_known(error, before) from error
    except IdentificationError as error:
        refused(error, before)
        raise
    estimate = replace(estimate, provenance=record)
    found = _found(model, estimate)
    validations = [validate(found, found.start, label) for label in found.experiments]
    judgement = judged(found, estimate, validations, before=before)
    document = result_document(
        case.name, found, estimate, validations,
        judged=judgement, description=case.document.description, case=case.path.name,
    )  # fmt: skip
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


def _known_of_plant(case: Case, model: LoopModel) -> tuple[Consistency | None, list[Diagnostic]]:
    """What is found of a plant of its own before the long work: its comparison with the description, and what it says.

    Raises:
        InputError: an identified parameter has no effect in the plant.
    """
    if not has_own_plant(case):
        return None, []
    consistency = check_consistency(model) if model.parameters.has_regressor else None
    check_acting(model)
    return consistency, [*plant_diagnostics(consistency), *start_diagnostics(model)]


def _with_known(error: RefusedError, before: Sequence[Diagnostic]) -> RefusedError:
    """The refusal with what was doubted before, which may be its cause."""
    known = [str(found) for found in before if found.code.severity is not REMARK]
    if not known:
        return error
    got = "; ".join(str(part) for part in (error.got, "before, it was seen: " + " ".join(known)) if part)
    return RefusedError(
        error.what, iterations=error.iterations, got=got, next_step=error.next_step, values=error.values,
        deviation=error.deviation,
    )  # fmt: skip


def _save(document: ResultDocument, validations: tuple[Validation, ...] | list[Validation], out: Path) -> None:
    from fmu_didim.report import write_report

    save_result(document, validations, out)
    write_report(out)
