"""Profiles of the parameters of an estimate, side by side."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from fmu_didim.base.errors import FmuDidimError, UnknownNameError
from fmu_didim.estimators.base import Estimator, Progress
from fmu_didim.estimators.search.crew import Crew, check_minima
from fmu_didim.fit.estimate import Estimate
from fmu_didim.fit.exploration.profile import HalfProfile, Side, followed, joined, sides_of
from fmu_didim.fit.iteration import Iteration
from fmu_didim.fit.statistics import error_percent
from fmu_didim.model.loop_model import LoopModel


def profiled(
    estimator: Estimator,
    estimate: Estimate,
    names: Sequence[str],
    crew_of_model: Callable[[LoopModel], Crew],
    *,
    progress: Progress,
) -> Estimate:
    """The estimate with the profiles of some of its parameters, of all where none is named.

    Args:
        crew_of_model: who runs the fits of a model; progress: gets an iteration ``profile`` for each side.

    Raises:
        InputError: the answer of the estimator is no minimum of the misfit; UnknownNameError: a name is not free.
    """
    fit = estimate.minimum
    check_minima(estimator, estimate.model, "profile")
    assert fit is not None  # of all that find minima
    for name in names:
        if name not in estimate.names:
            raise UnknownNameError("free parameter", name, estimate.names, where="profile")
    places = [i for i, name in enumerate(estimate.names) if not names or name in names]
    sides = sides_of(fit, estimate.standard_deviation, estimate.freedom, places)
    loop, halves = estimate.model.loop, dict[int, HalfProfile]()
    error = error_percent(loop, estimate.measured, estimate.simulated)[0]
    crew = crew_of_model(fit.model)
    try:
        for k, half in crew.run(follow_side, sides):
            halves[k] = _failed(sides[k]) if isinstance(half, FmuDidimError) else half
            way = "up" if sides[k].sign > 0 else "down"
            note = f"{estimate.names[sides[k].place]} {way}: {len(halves[k].difference)} points"
            progress(Iteration("profile", len(halves), estimate.value, error, note=note, quantity=loop.quantity))
    finally:
        crew.close()
    linear = estimate.interval()
    found = tuple(
        joined(sides[k], halves[k], halves[k + 1], (float(linear[i, 0]), float(linear[i, 1])))
        for k, i in zip(range(0, len(sides), 2), places, strict=True)
    )
    return replace(estimate, profiles=found)


def follow_side(_: Estimator, model: LoopModel, side: Side) -> HalfProfile:
    """The task of a crew."""
    return followed(model, side)


def _failed(side: Side) -> HalfProfile:
    """A side whose process ended."""
    return HalfProfile(np.zeros((0, side.values.size)), np.zeros(0), np.nan, "failed")
