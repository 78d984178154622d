"""Discovery for a model alone, from end to end: identify, search, identify with what was found, judge, document."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from fmu_didim.base.diagnostics import Diagnostic
from fmu_didim.base.errors import IdentificationError, SimulationError
from fmu_didim.checks.identification import checked
from fmu_didim.checks.judgement import Judgement
from fmu_didim.checks.outputs.before import START_ELSEWHERE
from fmu_didim.checks.validation import validate_on
from fmu_didim.discovery.request import Request
from fmu_didim.discovery.signals.document import signals_document
from fmu_didim.discovery.signals.search import SignalDiscovery, SignalSearch
from fmu_didim.fit.estimate import Estimate
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.results.findings import FindingsDocument

Estimating = Callable[[LoopModel], Estimate]
"""Identifies all that is free in a model; raises what its estimator raises."""


@dataclass(frozen=True)
class FoundOnSignals:
    """The answer of :func:`discover_on_signals`.

    Attributes:
        document: the content of ``findings.json``; discovery: the search.
        base, final: estimates without and with what was found; the same where that is nothing.
    """

    document: FindingsDocument
    discovery: SignalDiscovery
    base: Estimate
    final: Estimate


def discover_on_signals(
    model: LoopModel, estimating: Estimating, request: Request, *, before: Sequence[Diagnostic] = ()
) -> FoundOnSignals:
    """Find what acts on the inputs and outputs of a model and is not in it.

    Args:
        model: with its experiments; those for the validation are the held-out data.
        estimating: identifies a model; before: diagnostics of data and model.

    Raises:
        RefusedError, IdentificationError, SimulationError: what is identified cannot be, without anything more.
    """
    begin = clock.perf_counter()
    request.progress.say("base model")
    base = estimating(model)
    search = SignalSearch(request.options, request.progress)
    found = search.run(base.model.with_values(base.value))
    final = base
    if found.steps:
        request.progress.say("final model")
        try:
            final = estimating(found.final.model.with_values(found.final.values))
        except (IdentificationError, SimulationError) as error:
            found, notes = SignalDiscovery(found.base, found.base, tried=found.tried), f"{NOT_IDENTIFIED} {error.what}"
            request = request.noting(notes)
    if found.steps:  # whether the final model starts where the data do, its own residual says
        before = [d for d in before if d.code is not START_ELSEWHERE]
    document = signals_document(request, found, base, final, _judged(final, before), clock.perf_counter() - begin)
    return FoundOnSignals(document, found, base, final)


NOT_IDENTIFIED = "What explains the data best cannot be identified beside all else, and was taken out again:"


def _judged(estimate: Estimate, before: Sequence[Diagnostic]) -> Judgement:
    """The judgement of an estimate, as an identification gets it."""
    validations = [validate_on(estimate.model, estimate.value, label) for label in estimate.model.experiments]
    return checked(estimate, validations, before=before).judgement
