"""Whether the answer from one start may be a wrong local minimum, of outputs of any model.

A few values between the bounds of the parameters, or within a factor of two of the answer where there are none, are
simulated once each: where one of them fits better, the answer is a local minimum. A residual that is far from white is
no sign by itself: sensors have memories, too.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, REMARK, Diagnostic
from fmu_didim.base.errors import FmuError, SimulationError
from fmu_didim.checks.residual import NoiseResult
from fmu_didim.data.signals import Array
from fmu_didim.estimators.search.box import Box
from fmu_didim.fit.estimate import Estimate
from fmu_didim.fit.exploration.minima import misfit, squares_of
from fmu_didim.model.free_parameter import FreeParameter
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.workers import side_by_side

POINTS = 4
"""[points] That are looked at, and as many more for each parameter: about a third of what the fit itself simulates."""
MOST_POINTS = 40
"""[points] Of many parameters: they fill no box of that many dimensions anyway."""
AROUND = 2.0
"""[1] Factor around the value of a parameter without bounds: the next minima of a rate or a period lie within."""
CLEARLY_LOWER = 1.0
"""[chi-square] By which another place fits better than the answer: any lower misfit shows that this is a local minimum,
and less is what the last steps of a fit leave, or jitter."""

LOWER_ELSEWHERE = CATALOGUE(
    "lower-minimum", DOUBT, rank=3,
    meaning="The answer from one start is a local minimum: with other values, which are no minimum yet, the model fits "
    "the data better.",
    next_step="Search from several starts: search: {starts: 20}, with minimum: and maximum: under identify:; or start "
    "there.",
)  # fmt: skip
ONE_START = CATALOGUE(
    "one-start", REMARK, rank=64,
    meaning="There was one start, and no lower misfit at a few other values. Other minima were not looked for.",
    next_step="Where the model is strongly nonlinear: search: {starts: 20}.",
)  # fmt: skip


def one_start_diagnostics(estimate: Estimate, tests: tuple[NoiseResult, ...]) -> list[Diagnostic]:
    """What speaks for a wrong local minimum; nothing of a torque, whose minima the estimators look for themselves.

    Args:
        tests: of the residual of each output.
    """
    if estimate.model.loop.shows_torque:
        return []
    searched = estimate.search is not None and estimate.search.searched
    if searched or _is_explained(tests):
        return []
    lower = lower_elsewhere(estimate)
    if lower is None:
        text = "One start: at a few values elsewhere the misfit is no lower; other minima were not looked for."
        return [Diagnostic(ONE_START, text)]
    values, gain = lower
    told = ", ".join(f"{name} = {value:.4g}" for name, value in zip(estimate.names, values, strict=True))
    text = f"The answer is a local minimum: {told} fits better (chi-square lower by {gain:.3g})."
    return [Diagnostic(LOWER_ELSEWHERE, text, value=gain, bound=CLEARLY_LOWER, unit="chi-square")]


def _is_explained(tests: tuple[NoiseResult, ...]) -> bool:
    """Whether all residuals are as small as their known noise: then nothing fits better by more than chance."""
    known = [test.chi_square_per_sample is not None and not test.exceeds_noise for test in tests]
    return bool(known) and all(known)


def lower_elsewhere(estimate: Estimate) -> tuple[Array, float] | None:
    """Values (p,) among a few elsewhere that fit better than the answer, and by how much, as a chi-square; None where
    there are none."""
    model, values = estimate.model, estimate.value
    free = [_around(one, value) for one, value in zip(model.free_parameters, values, strict=True)]
    box = Box.of(type(model.free_parameters)(free), values)
    if not box.place.size:
        return None
    points = box.drawn(min(POINTS * (1 + box.place.size), MOST_POINTS), seed=0)
    here = _misfit(model, values)
    costs = side_by_side([partial(_misfit, model, one) for one in points], model.allowed_workers(values))
    best = int(np.argmin(costs))
    return (points[best], here - costs[best]) if costs[best] < here - CLEARLY_LOWER else None


def _around(one: FreeParameter, value: float) -> FreeParameter:
    """The parameter with bounds: its own, or a factor around its value."""
    if np.isfinite(one.lowest) and np.isfinite(one.highest):
        return one
    low, high = sorted((value / AROUND, value * AROUND))
    return replace(one, lowest=max(low, one.lowest), highest=min(high, one.highest))


def _misfit(model: LoopModel, values: Array) -> float:
    try:
        return misfit(model, squares_of(model, values), values)
    except (SimulationError, FmuError):
        return np.inf
