"""The answer of a search: the best of the minima to which local fits lead."""

from __future__ import annotations

import time as clock
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fmu_didim.data.signals import Array
from fmu_didim.estimators.base import Estimator, Progress
from fmu_didim.estimators.search.adaptation import adapted
from fmu_didim.estimators.search.box import Box
from fmu_didim.estimators.search.crew import Crew, Ended, check_minima
from fmu_didim.estimators.search.evolution import evolved
from fmu_didim.estimators.search.generations import VISIBLE, Generations
from fmu_didim.estimators.search.options import Search
from fmu_didim.estimators.search.places import Place, distinct
from fmu_didim.estimators.starts.start import start_values, with_free_delay
from fmu_didim.fit.estimate import Estimate
from fmu_didim.fit.exploration.minima import FoundMinimum, SearchOutcome
from fmu_didim.fit.iteration import Iteration
from fmu_didim.model.loop_model import LoopModel

GLOBAL = {"differential_evolution": evolved, "cmaes": adapted}
"""Method of a search -> what looks at the box as a whole."""
HARDLY_WORSE = 10.8
"""[chi-square] Another minimum that is worse by less is not excluded by the data: 0.1 % by chance, with one degree of
freedom."""


def searched(
    estimator: Estimator, model: LoopModel, search: Search, crew: Crew, *, progress: Progress
) -> Estimate:  # fmt: skip
    """The estimate at the best minimum that a search finds, with the others; that of one start where no parameter has
    bounds.

    Args:
        estimator: whose local fits are compared; model: as for it; crew: who runs them.
        progress: gets an iteration ``start`` for each local fit, then those of the last one, from the best values.

    Raises:
        InputError: the answer of the estimator is not a minimum of the misfit, or the package of the method is absent;
            and as of the estimator, where the fit from the start of the case fails with all others.
    """
    check_minima(estimator, model, "search")
    if getattr(estimator, "estimate_delay", False):
        model = with_free_delay(model)
    begin = model.free_parameters.limited(start_values(model, estimator.start))  # type: ignore[attr-defined]
    box = Box.of(model.free_parameters, begin)
    if not box.place.size:
        nothing = SearchOutcome(search.method, search.seed, 1, search.starts, (), model.names, ())
        return replace(estimator.estimate(model, progress=progress), search=nothing)
    run = _Run(model, search, crew, progress)
    if search.method in GLOBAL:
        looked = Generations(model, box, search, crew, progress)
        GLOBAL[search.method](looked)
        ends = run.fits([looked.best, begin])  # the former in any case, also where the time is over
        run.stopped, evaluations = looked.stopped, looked.spent
    else:
        ends, evaluations = run.fits([begin, *box.drawn(search.starts - 1, search.seed)]), 0
    places = [Place.of(model, end) for end in ends if not end.problem]
    if not places:
        return estimator.estimate(model, progress=progress)  # it says why not even the usual start leads anywhere
    minima = distinct(places, model.names)
    best = replace(estimator, start=minima[0].values_in(model.names))  # type: ignore[type-var]
    found: Estimate = best.estimate(model, progress=progress)
    told = tuple(one.told(minima[0].misfit) for one in minima)
    outcome = SearchOutcome(
        search.method, search.seed, len(ends), run.asked, tuple(model.names[i] for i in box.place),
        tuple(name for i, name in enumerate(model.names) if i not in box.place), told,
        not_excluded(found, told[1:]),
        Counter(end.problem for end in ends if end.problem), evaluations, run.stopped,
    )  # fmt: skip
    return replace(found, search=outcome)


def not_excluded(answer: Estimate, others: Sequence[FoundMinimum]) -> int:
    """How many other minima the data do not exclude, beside an answer with the noise and its colour."""
    inflation = max((colour.inflation for colour in answer.colours), default=1.0)
    return sum(one.worse < HARDLY_WORSE * max(inflation, 1.0) ** 2 for one in others)


@dataclass
class _Run:
    """Local fits with their progress, as long as there is time."""

    model: LoopModel
    search: Search
    crew: Crew
    progress: Progress
    asked: int = 0
    stopped: str = ""
    begun: float = field(default_factory=clock.monotonic)

    def fits(self, starts: Sequence[Array]) -> list[Ended]:
        """The ends of local fits from these values."""
        self.asked, found = len(starts), dict[int, Ended]()
        lowest = np.inf
        for k, end in self.crew.fits(starts, stop=lambda: bool(self.stopped)):
            found[k] = end
            note = end.problem or f"{len(found)} of {len(starts)} starts"
            if not end.problem:
                cost = Place.of(self.model, end).misfit
                note += ", the lowest so far" if cost < lowest - VISIBLE else ""
                lowest = min(lowest, cost)
            values = starts[k] if end.problem else np.array([end.values[name] for name in self.model.names])
            self.progress(
                Iteration("start", k + 1, values, end.error_percent, note=note, quantity=self.model.loop.quantity)
            )
            limit = self.search.time_s
            if limit is not None and clock.monotonic() - self.begun > limit and len(found) < len(starts):
                self.stopped = f"its time of {limit:g} s was over"
        return [found[k] for k in sorted(found)]
