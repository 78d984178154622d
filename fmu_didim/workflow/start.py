"""An identification that goes on from the result of another one."""

from __future__ import annotations

import logging
from dataclasses import replace

from fmu_didim.base.errors import InputError
from fmu_didim.case import Case
from fmu_didim.workflow.output.result import Result

_log = logging.getLogger(__name__)


def started_from(case: Case, result: Result) -> Case:
    """The case whose estimator starts at the values of a result.

    Parameters that the result lacks start at the values of the description. Values of experiments that the case does
    not have, and of a delay that only the estimator frees, are left out.

    Raises:
        InputError: it is no result, holds no values or others than the case has, or the estimator takes no start.
    """
    if not isinstance(result, Result):
        raise InputError(
            "This is no result to start from.", where="start", got=type(result).__name__,
            valid="what identify() returned, or Result.load(folder)",
            next_step="Values by name go into the case: case.with_(estimator={'start': {...}}).",
        )  # fmt: skip
    model, name = case.model, result.document.name
    if not result.parameters:
        raise InputError(
            "The result to start from holds no values.", where="start", got=f"{name}: {result.verdict}",
            next_step="Take a result that ended with values, or leave start out.",
        )  # fmt: skip
    others = [n for n in result.parameters if n not in model.names]
    unknown = [n for n in others if result.parameters[n].of != "delay" and result.parameters[n].experiment is None]
    if unknown:
        raise InputError(
            "The result to start from has parameters that this case does not have.", where="start",
            got=f"{name}: {', '.join(unknown)}", valid=model.names,
            next_step="Start from a result of the same robot with the same free parameters.",
        )  # fmt: skip
    if not hasattr(case.estimator, "start"):
        raise InputError(
            "This estimator takes no start values.", where="start", got=case.estimator.name,
            next_step="Take one that does, such as didim, or leave start out.",
        )  # fmt: skip
    shared = [p.name for p in model.free_parameters if p.experiment is None]
    described = dict(zip(model.names, map(float, model.start), strict=True))
    values = {n: described[n] for n in shared} | {n: v for n, v in result.values.items() if n in model.names}
    for n in others:
        _log.info("%s of %s has no place in %s and was left out of the start", n, name, case.name)
    options = {**case.document.estimator_options, "start": values}
    document = case.document.model_copy(update={"estimator": options})
    return replace(case, document=document, estimator=replace(case.estimator, start=values))  # type: ignore[type-var]
