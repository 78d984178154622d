"""The verb ``identify``: a case in; the estimate, its validation and the files of the result out."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Unpack

from fmu_didim.base.diagnostics import REMARK, DiagnosedError, Diagnostic, by_weight, refuse_problems
from fmu_didim.base.errors import FmuDidimError, IdentificationError, InputError, SimulationError
from fmu_didim.case import Case, CaseObjects, with_objects
from fmu_didim.checks.identification import acknowledging, checked
from fmu_didim.checks.validation import Validation, validated
from fmu_didim.estimators import Progress, no_progress
from fmu_didim.estimators.search import check_reducible
from fmu_didim.fit.estimate import Estimate, RefusedError
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.stretches import PartOfLogs
from fmu_didim.model.workers import one_blas_thread
from fmu_didim.results.document import consistency_result, refused_document, result_document
from fmu_didim.results.provenance import provenance
from fmu_didim.results.result import save_result
from fmu_didim.workflow.acknowledged import acknowledged
from fmu_didim.workflow.case_files import case_files, repeating
from fmu_didim.workflow.data import DataBeside, case_diagnostics, check_plant
from fmu_didim.workflow.output.loop import described_estimator, described_loop
from fmu_didim.workflow.output.result import Result, result_folder
from fmu_didim.workflow.output.result_folder import ResultFolder, checked_case
from fmu_didim.workflow.search import estimated, estimated_by_part, judged_part, profile_names
from fmu_didim.workflow.start import started_from

_log = logging.getLogger(__name__)


@with_objects
@one_blas_thread
def identify(
    case: Case | Path | str | Mapping[str, Any] | None = None,
    out: Path | str | None = None,
    *,
    start: Result | None = None,
    profile: bool | Sequence[str] | None = None,
    essential: bool = False,
    figures: bool = False,
    progress: Progress | None = None,
    show: Callable[[Result], None] | None = None,
    **objects: Unpack[CaseObjects],
) -> Result:
    """Identify the parameters of a case, validate them and, with ``out``, save result and report there.

    Args:
        case: a loaded case, the path of its file, or its content; None where the objects below are the whole case.
        robot: path, mapping, :class:`RobotDescription` or :class:`RobotModel`.
        plant, controller: path of a description or an FMU, a component (:func:`load_fmu`), a python-control system, or
            a function ``law(q_ref, dq_ref, q, dq)`` of (n,) arrays that returns the (n,) commands; its arguments go by
            their names: ``q_ref``, ``dq_ref``, ``ddq_ref``, ``q``, ``dq``, ``ddq``, ``t``.
        log, reference: ``Log(t, tau)`` and ``Reference(t, q)`` of the experiment that is fitted; what the case says of
            sampling and clock holds for them.
        validation: ``(log, reference)`` of the held-out experiment, or ``(inputs, measured)``.
        loop: entries of the case, such as ``{"rate_hz": 1000}`` for a controller that states no rate.
        model: an FMU, a Modelica file or a component that is calibrated as it is, with neither robot nor controller.
        inputs, measured: ``Inputs(t, u=...)`` and ``Measured(t, y=...)`` of it, by the names of its variables.
        parameters: names of those that are identified, or name -> ``{"start": 1, "minimum": 0}``.
            These eleven take the place of what the case has, or are a case themselves.
        start: a result to start from: of the same parameters, here or on another motion. Those that it lacks start at
            the values of the description.
        profile: whether the interval of each parameter is found by its profile, too, or names of those for which it is;
            by default what the case says.
        essential: whether the base parameters that the data do not need are looked for, by an F-test, and a model
            without them is fitted and compared on held-out data.
        out: folder for ``result.json``, the torque tables, ``report.html``, ``robot_identified.yaml`` with the values
            that all experiments share, and ``robot_identified_<label>.yaml`` for each that has some of its own. They
            replace all that an earlier run left there, or nothing of it.
        figures: whether each chart of the page is written there as PNG and SVG, too (``figure_*``), for a paper.
        progress: called with each :class:`~fmu_didim.fit.iteration.Iteration`.
        show: called with the result before anything is written.

    Raises:
        InputError: something in the case is wrong, or there is no writing to ``out``; found before any long work. Or
            the results could not be written in the end.
        RefusedError: no physical answer was found, or a component failed; with ``out``, a result that says so is
            saved first.
        IdentificationError: the data cannot tell some parameters apart.
    """
    folder = None if out is None else result_folder(out, figures=figures)
    case = checked_case(case, folder, objects)
    if start is not None:
        case = started_from(case, start)
    names = profile_names(case, profile)
    model = case.model
    if essential:
        check_reducible(model)
    sentences = acknowledged(case)
    part = judged_part(case, names, essential=essential)
    judged = None if part is None else part.model
    data = DataBeside(case, judged, progress or no_progress)
    record = _record(case, out, {"profile": profile, "essential": essential})
    refusal = _Refusal(case, folder, record)
    try:
        model = data.model
        consistency, of_plant = data.ahead(partial(check_plant, case, judged or model))
        of_plant = data.ahead(partial(refuse_problems, of_plant))
        if consistency is not None:
            refusal.known["consistency"] = consistency_result(consistency)
        model.pool.failure = None  # what was tried before may have gone beyond what the components stand
        found = _estimated(case, model, data, of_plant, part, names, refusal, essential=essential)
        result = _judged(
            case, replace(found, estimate=replace(found.estimate, provenance=record)), refusal.known, sentences
        )
    except DiagnosedError as error:
        refusal.save(error, error.found)
        raise
    with result.page_beside() if folder is not None else nullcontext() as page:
        if show is not None:
            show(result)
        if folder is not None and page is not None:
            result.write(folder, page)
    return result


def _record(case: Case, out: Path | str | None, choices: Mapping[str, Any]) -> dict[str, Any]:
    """The provenance of the result; choices: of the call."""
    record = provenance(case.model, described_estimator(case), files=case_files(case))
    asked = {name: True for name, wanted in choices.items() if wanted}
    record |= repeating("identify", case, None if out is None else Path(out), asked)
    if case.document.plant.parameter_names:
        record["parameter_names"] = dict(case.document.plant.parameter_names)
    if case.document.search is not None:
        record["search"] = case.document.search.model_dump(mode="json")
    return record


@dataclass(frozen=True)
class _Estimated:
    """An estimate, each experiment simulated with its values, and what was found before it of data and plant."""

    estimate: Estimate
    validations: Sequence[Validation]
    before: Sequence[Diagnostic]


def _estimated(
    case: Case,
    model: LoopModel,
    data: DataBeside,
    of_plant: Sequence[Diagnostic],
    part: PartOfLogs | None,
    names: tuple[str, ...] | None,
    refusal: _Refusal,
    *,
    essential: bool,
) -> _Estimated:
    """The estimate, its validation, and what was found before it of data and plant; of all data where those of a part
    have led to no estimate. Raises what :func:`identify` raises."""
    of_all: list[Diagnostic] | None = None

    def before() -> list[Diagnostic]:
        return by_weight([*(data.found() if of_all is None else of_all), *of_plant])

    try:
        estimate = None if part is None else estimated_by_part(case, part, data.progress)
        if estimate is None:
            of_all = None if part is None else refuse_problems(case_diagnostics(case))
            estimate = estimated(case, model, names, data.progress, essential=essential)
        validations = validated(estimate)  # beside the checks of the data, if these take longer
        data.tell()
        return _Estimated(estimate, validations, before())
    except (RefusedError, SimulationError) as caught:
        known = before()
        refused = _refused(caught).because_of(model.pool.failure)  # the first one of a component, if there was one
        refusal.save(refused, known)
        raise _with_known(refused, known) from caught
    except IdentificationError as error:
        refusal.save(error, before())
        raise
    except Exception:
        before()  # a problem of the data comes first
        raise


def _refused(caught: RefusedError | SimulationError) -> RefusedError:
    if isinstance(caught, RefusedError):
        return caught
    return RefusedError(caught.what, iterations=(), got=caught.got, next_step=caught.next_step, where=caught.where)


@dataclass
class _Refusal:
    """Saves a result that says why there are no values.

    Attributes:
        known: entries of the document that were found before.
    """

    case: Case
    folder: ResultFolder | None
    record: dict[str, Any]
    known: dict[str, Any] = field(default_factory=dict)

    def save(self, error: FmuDidimError, before: Sequence[Diagnostic]) -> None:
        """A failure to write goes to the log only, so that the refusal itself is raised."""
        from fmu_didim.report import write_report

        if self.folder is None:
            return
        case = self.case
        document = refused_document(case.name, case.model, case.estimator.name, error, self.record, known=before)
        document = document.model_copy(update={**self.known, "loop": described_loop(case, document.loop)})
        try:
            with self.folder.written() as new:
                save_result(document, (), new)
                write_report(new)
        except InputError as failed:
            _log.warning("%s", failed)


def _judged(
    case: Case,
    found: _Estimated,
    known: Mapping[str, Any],
    sentences: Mapping[str, str],
) -> Result:
    estimate, validations = found.estimate, found.validations
    checks = acknowledging(checked(estimate, validations, before=found.before), estimate, sentences)
    if estimate.all_samples is not None:  # whose problems would have been found before, had they been in the part
        refuse_problems(checks.judgement.reasons)
    document = result_document(
        case.name, estimate, validations, checks=checks, description=case.document.description,
        case=case.path.name,
    )  # fmt: skip
    document = document.model_copy(update={**known, "loop": described_loop(case, document.loop)})
    return Result.of(document, estimate, validations)


def _with_known(error: RefusedError, before: Sequence[Diagnostic]) -> RefusedError:
    """The refusal with the earlier doubts, which may be its cause."""
    known = [str(found) for found in before if found.code.severity is not REMARK]
    if not known:
        return error
    got = "; ".join(str(part) for part in (error.got, "found before: " + " ".join(known)) if part)
    return RefusedError(
        error.what, iterations=error.iterations, got=got, next_step=error.next_step, values=error.values,
        deviation=error.deviation, where=error.where,
    )  # fmt: skip
