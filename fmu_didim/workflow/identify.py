"""The verb ``identify``: a case in; the estimate, its validation and the files of the result out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from fmu_didim.case import Case, load_case
from fmu_didim.diagnosis.acting import check_acting, start_warnings
from fmu_didim.diagnosis.consistency import check_consistency
from fmu_didim.diagnosis.validation import Validation, validate
from fmu_didim.documents import load_yaml
from fmu_didim.estimators import Progress, no_progress
from fmu_didim.identification.document import consistency_result, refused_document, result_document
from fmu_didim.identification.estimate import Estimate, RefusedError
from fmu_didim.identification.provenance import provenance
from fmu_didim.identification.result import ConsistencyResult, ResultDocument, save_result
from fmu_didim.identification.start import with_free_delay
from fmu_didim.prediction.loop_model import LoopModel
from fmu_didim.robot import write_robot
from fmu_didim.workflow.case_files import case_files

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


def identify(
    case: Case | Path | str | Mapping[str, Any], *, out: Path | str | None = None, progress: Progress = no_progress
) -> Outcome:
    """Identify the parameters of a case, validate them and, with ``out``, save result and report there.

    Args:
        case: a loaded case, the path of its file, or its content.
        out: folder for ``result.json``, the torque tables, ``report.html`` and ``robot_identified.yaml``.
        progress: called with each iteration.

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
        estimate = case.estimator.estimate(model, progress=progress)
    except RefusedError as error:
        if out is not None:
            refused = refused_document(case.name, model, case.estimator.name, error, record)
            known["remarks"] = remarks
            _save(refused.model_copy(update={**known, "loop": _loop(case, refused)}), (), Path(out))
        raise _with_warnings(error, known.get("consistency"), remarks) from error
    estimate = replace(estimate, provenance=record, remarks=(*remarks, *estimate.remarks))
    found = _found(model, estimate)
    validations = [validate(found, found.start, label) for label in found.experiments]
    document = result_document(case.name, found, estimate, validations, description=case.document.description)
    document = document.model_copy(update={**known, "loop": _loop(case, document)})
    if out is not None:
        _save(document, validations, Path(out))
        described = model.parameters.described(estimate.base_value)
        if described is not None:
            write_robot(described, Path(out) / ROBOT_FILE)
    return Outcome(document, estimate, tuple(validations))


def _found(model: LoopModel, estimate: Estimate) -> LoopModel:
    """The model with the identified values; a delay that only the estimator freed is among them."""
    found = with_free_delay(model) if len(estimate.names) > len(model.names) else model
    return found.with_values(estimate.value)


def _known_of_plant(case: Case, model: LoopModel) -> tuple[dict[str, Any], list[str]]:
    """What is found of a plant of its own before the long work: entries of the result, and remarks.

    Raises:
        InputError: an identified parameter has no effect in the plant.
    """
    if case.document.plant.source is None and case.base is None:
        return {}, []  # the plant is made from the description
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


def _save(document: ResultDocument, validations: tuple[Validation, ...] | list[Validation], out: Path) -> None:
    from fmu_didim.report import write_report

    save_result(document, validations, out)
    write_report(out)
