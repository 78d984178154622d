"""The estimate of a case: from one start, or by the search that it asks for, and with the profiles that it asks for."""

from __future__ import annotations

from fmu_didim.case import Case
from fmu_didim.estimators import Progress
from fmu_didim.estimators.search import crew_of, profiled, searched
from fmu_didim.fit.estimate import Estimate
from fmu_didim.model.loop_model import LoopModel


def estimated(case: Case, model: LoopModel, progress: Progress) -> Estimate:
    """The estimate of a case, on a model of it; raises what its estimator raises."""
    search, names = case.document.search, case.document.profiled
    found = _found(case, model, progress)
    if names is None:
        return found
    processes = None if search is None else search.processes
    return profiled(
        case.estimator, found, names, lambda of: crew_of(case.estimator, of, processes), progress=progress
    )  # fmt: skip


def _found(case: Case, model: LoopModel, progress: Progress) -> Estimate:
    search = case.document.search
    if search is None:
        return case.estimator.estimate(model, progress=progress)
    crew = crew_of(case.estimator, model, search.processes)
    try:
        return searched(case.estimator, model, search, crew, progress=progress)
    finally:
        crew.close()
