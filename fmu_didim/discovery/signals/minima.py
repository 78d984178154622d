"""Other minima of the final model of a discovery on signals, from the other starts of what was found.

A lag behind a model that lags itself has one. Of a heat capacity and a sensor in series,

    (1 + a s) (1 + b s) y = u,      a of the room, b of the sensor,

the product stays the same with a and b exchanged, but for what fades from the start: two minima, each with values of
its own, of which a fit from one start finds one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from fmu_didim.base.errors import IdentificationError, SimulationError
from fmu_didim.data.signals import Array
from fmu_didim.discovery.signals.search import FIT, SignalDiscovery, SignalSearch, fitted, quick_noise
from fmu_didim.estimators.search.best import not_excluded
from fmu_didim.estimators.search.crew import Ended
from fmu_didim.estimators.search.generations import VISIBLE
from fmu_didim.estimators.search.places import Place, distinct
from fmu_didim.fit.ending import Ending
from fmu_didim.fit.estimate import Estimate
from fmu_didim.fit.exploration.minima import SearchOutcome, squares_of
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.noise.noise import Noise
from fmu_didim.fit.solver.least_squares import minimise
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.signals.path import LAG

STARTS_OF_FOUND = "starts of what was found"
"""Method of this search, beside those that a case asks for."""
AT_MINIMUM = (Ending.SETTLED, Ending.NO_STEP, Ending.NOTHING_PROMISED)
"""How fits end at a minimum: one that ends on its way there is none."""

AROUND = (0.3, 0.6, 1.6, 3.0)
"""[1] Times a lag that was found, from which fits start beside its other starts, each of which reaches to the next only
where nothing else lags: the other minimum has the time constant of the model, which may lie between two of them."""

Estimating = Callable[[LoopModel], Estimate]
"""Identifies all that is free in a model; raises what its estimator raises."""


def beside_other_minima(
    search: SignalSearch, found: SignalDiscovery, final: Estimate, estimating: Estimating
) -> tuple[SignalDiscovery, Estimate]:
    """The final model at the lowest minimum to which the starts of what was found lead. Others that the data do not
    exclude are told in ``search`` of the estimate.

    Args:
        found: with the final fit; final: its estimate.

    Raises:
        RefusedError, IdentificationError, SimulationError: a lower minimum cannot be identified.
    """
    starts = _starts(found, final)
    if not starts or final.search is not None:  # it has looked for other minima as the case asks for it
        return found, final
    fits = _fits(search, final.model, starts, quick_noise(found.final))
    if fits is None:
        return replace(found, is_cut=True), final
    names, own = final.model.names, _place(final.model, final.value, final.standard_deviation)
    places = [_place(fit.model, fit.values, np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))) for fit in fits]
    best = min(range(len(fits)), key=lambda k: places[k].misfit, default=None)
    if best is not None and places[best].misfit < own.misfit - VISIBLE:
        found = replace(found, final=fits[best])
        final = estimating(final.model.with_values(fits[best].values))
        own = _place(final.model, final.value, final.standard_deviation)
    others = [one for one in distinct(places, names) if not one.is_at(own, names)]
    told = tuple(one.told(own.misfit) for one in (own, *others))
    alike, count = not_excluded(final, told[1:]), len(starts) + 1
    if not alike:
        return found, final
    return found, replace(final, search=SearchOutcome(STARTS_OF_FOUND, 0, count, count, names, (), told, alike))


def _starts(found: SignalDiscovery, final: Estimate) -> list[dict[str, float]]:
    """The starts of each of what was found, by the names of free parameters; without amplitudes, which follow from a
    slope."""
    made, values = [], dict(zip(final.names, map(float, final.value), strict=True))
    for candidate in (step.chosen.candidate for step in found.steps):
        starts = candidate.starts if len(candidate.starts) > 1 else []
        if candidate.kind.name == LAG:
            (one,) = candidate.free({}, 0)
            starts = [*starts, *({LAG: factor * values[one.name]} for factor in AROUND)]
        for start in starts:
            free = [p for p in candidate.free(start, 0) if p.is_shape or not candidate.kind.is_scaled]
            made.append({p.name: p.value for p in free})
    return made


def _fits(
    search: SignalSearch, model: LoopModel, starts: Sequence[Mapping[str, float]], noise: Noise
) -> list[Fit] | None:
    """The minima to which these starts lead; None where the time was up before all were tried."""
    report, found = search.progress.counted("fitting from another start", len(starts)), []
    for start in starts:
        if search.progress.is_time_up:
            return None
        with suppress(SimulationError, IdentificationError):
            fit = _fit(model, start, noise, search.progress.ends)
            found += [fit] if fit.ending in AT_MINIMUM else []
        report("")
    return found


def _fit(model: LoopModel, start: Mapping[str, float], noise: Noise, until: float) -> Fit:
    """From some values: all others are fitted beside them first, lest these are drawn back to where they came from."""
    beside = [
        replace(p, value=start[p.name], lowest=start[p.name], highest=start[p.name]) if p.name in start else p
        for p in model.free_parameters
    ]
    held = minimise(model.with_free(beside), noise, stopping=replace(FIT, until=until))
    return fitted(model.with_values(held.values), until=until)


def _place(model: LoopModel, values: Array, deviation: Array) -> Place:
    """A minimum with its values (p,) and their deviations."""
    known, scatter = (dict(zip(model.names, map(float, one), strict=True)) for one in (values, deviation))
    return Place.of(model, Ended(known, scatter, squares_of(model, values), settled=True))
