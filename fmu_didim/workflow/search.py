"""The estimate of a case: from one start, or by the search that the case asks for."""

from __future__ import annotations

from fmu_didim.case import Case
from fmu_didim.estimators import Progress
from fmu_didim.estimators.search import crew_of, searched
from fmu_didim.fit.estimate import Estimate
from fmu_didim.model.loop_model import LoopModel


def estimated(case: Case, model: LoopModel, progress: Progress) -> Estimate:
    """The estimate of a case, on a model of it; raises what its estimator raises."""
    search = case.document.search
    if search is None:
        return case.estimator.estimate(model, progress=progress)
    crew = crew_of(case.estimator, model, search.processes)
    try:
        return searched(case.estimator, model, search, crew, progress=progress)
    finally:
        crew.close()
