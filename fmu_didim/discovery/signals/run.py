"""Discovery for a model alone, from end to end: identify, search, identify with what was found, judge, document."""

from __future__ import annotations

import time as clock
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fmu_didim.base.diagnostics import Diagnostic
from fmu_didim.base.errors import IdentificationError, SimulationError
from fmu_didim.checks.identification import checked
from fmu_didim.checks.judgement import Judgement
from fmu_didim.checks.outputs.before import START_ELSEWHERE
from fmu_didim.checks.validation import validated
from fmu_didim.discovery.request import Request
from fmu_didim.discovery.selection.plausible import ZERO, chance_of_none
from fmu_didim.discovery.signals.candidates import Candidate
from fmu_didim.discovery.signals.document import signals_document
from fmu_didim.discovery.signals.minima import Estimating, beside_other_minima
from fmu_didim.discovery.signals.search import SignalDiscovery, SignalSearch, fitted
from fmu_didim.fit.estimate import Estimate
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.results.findings import FindingsDocument


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
        steps = found.steps
        try:
            found, final = _identified(search, found, base, estimating)
            found, final = beside_other_minima(search, found, final, estimating)
        except (IdentificationError, SimulationError) as error:
            found = SignalDiscovery(found.base, found.base, tried=found.tried)
            titles = ", ".join(step.chosen.candidate.title for step in steps)
            request = request.noting(NOT_IDENTIFIED.format(titles, error.what))
    if found.steps:  # whether the final model starts where the data do, its own residual says
        before = [d for d in before if d.code is not START_ELSEWHERE]
    document = signals_document(request, found, base, final, _judged(final, before), clock.perf_counter() - begin)
    return FoundOnSignals(document, found, base, final)


NOT_IDENTIFIED = "What explains the data best ({}) cannot be identified beside all else, and was taken out again: {}"


def _identified(
    search: SignalSearch, found: SignalDiscovery, base: Estimate, estimating: Estimating
) -> tuple[SignalDiscovery, Estimate]:
    """The final model identified, without what its values say may be absent: a search ends less sharply."""
    while found.steps:
        final = estimating(found.final.model.with_values(found.final.values))
        chances = {step: chance_of_absence(step.chosen.candidate, final) for step in found.steps}
        absent = [
            step for step in found.steps
            if chances[step] > ZERO and not search.is_needed(step.chosen.candidate, found.final)
        ]  # fmt: skip
        if not absent:
            return found, final
        least = max(absent, key=lambda step: chances[step])
        names = {p.name for p in least.chosen.candidate.free({}, 0)}
        model = final.model.with_values(final.value)
        without = fitted(model.with_free(p for p in model.free_parameters if p.name not in names), until=float("inf"))
        found = replace(found, final=without, steps=tuple(step for step in found.steps if step is not least))
    return found, base


def chance_of_absence(candidate: Candidate, estimate: Estimate) -> float:
    """Probability of values of a candidate as far from those with which nothing changes by chance; zero for a limit,
    which has none."""
    names = {p.name for p in candidate.free({}, 0)}
    free = estimate.model.free_parameters
    neutral = {i: candidate.neutral(p) for i, p in enumerate(free) if p.effect is not None and p.name in names}
    places = [i for i, off in neutral.items() if off is not None]
    if not places:
        return 0.0
    off = np.array([neutral[i] for i in places], dtype=float)
    return chance_of_none(estimate.value[places], estimate.covariance[np.ix_(places, places)], off)


def _judged(estimate: Estimate, before: Sequence[Diagnostic]) -> Judgement:
    """The judgement of an estimate, as an identification gets it."""
    validations = validated(estimate)
    return checked(estimate, validations, before=before).judgement
