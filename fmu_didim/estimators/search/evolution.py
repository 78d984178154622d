"""Global search by differential evolution (R. Storn, K. Price, J. Global Optimization 11, 1997), as SciPy has it."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from fmu_didim.data.signals import Array
from fmu_didim.estimators.base import Progress
from fmu_didim.estimators.search.box import Box
from fmu_didim.estimators.search.crew import Crew
from fmu_didim.estimators.search.options import Search
from fmu_didim.fit.exploration.minima import misfit
from fmu_didim.fit.iteration import Iteration
from fmu_didim.model.loop_model import LoopModel

MEMBERS = 15
"""[points] Of a generation, for each parameter: SciPy's own."""
FEWEST_GENERATIONS = 4
"""[generations] That a cap leaves at least; below that a generation becomes smaller."""
FAILED = 1e30
"""[1] Misfit of values that cannot be simulated: a finite one, so that generations can be compared."""
ALIKE = 1e-3
"""[1] Spread of the misfits of a generation, relative to their mean, at which it ends: the local fit does the rest."""


def evolved(
    model: LoopModel, box: Box, search: Search, crew: Crew, progress: Progress
) -> tuple[Array, int, str]:  # fmt: skip
    """The best values (p,) inside a box, how many simulations they took, and why the search ended early, if it did.

    Each generation is simulated as a whole, so that the answer does not depend on how many run side by side.

    Args:
        progress: gets an iteration ``search`` for each generation.
    """
    from scipy.optimize import differential_evolution  # slow to import

    count, begun, spent = box.place.size, clock.monotonic(), [0, 0]
    members = min(MEMBERS * count, max(search.evaluations // FEWEST_GENERATIONS, 5))
    generations = max(search.evaluations // members - 1, 1)
    lowest: list[tuple[float, Array, float]] = [(math.inf, box.begin, math.nan)]
    stopped = [""]

    def all_at_once(_: Callable[[Array], float], units: Iterable[Array]) -> list[float]:
        points = [box.point(np.asarray(unit)) for unit in units]
        found = crew.squares(points, repeats=generations)
        costs = [
            FAILED if squares is None else misfit(model, squares, values)
            for values, squares in zip(points, found, strict=True)
        ]
        spent[0] += len(points)
        best = int(np.argmin(costs))
        if costs[best] < lowest[0][0]:
            lowest[0] = costs[best], points[best], _error_percent(model, found[best])
        return costs

    def after(*_: Any, **__: Any) -> bool:
        spent[1] += 1
        note = f"{spent[0]} of at most {search.evaluations} simulations"
        progress(Iteration("search", spent[1], *lowest[0][1:], note=note, quantity=model.loop.quantity))
        if search.time_s is not None and clock.monotonic() - begun > search.time_s:
            stopped[0] = f"its time of {search.time_s:g} s was over"
        return bool(stopped[0])

    rng = np.random.default_rng(search.seed)
    found = differential_evolution(
        lambda unit: 0.0, [(0.0, 1.0)] * count, maxiter=generations, init=_first(members, count, rng), seed=rng,
        tol=ALIKE, polish=False, updating="deferred", workers=all_at_once, callback=after,
    )  # fmt: skip
    if not stopped[0] and found.nit >= generations:
        stopped[0] = f"at its cap of evaluations: {search.evaluations}"
    return lowest[0][1], spent[0], stopped[0]


def _first(members: int, count: int, rng: np.random.Generator) -> Array:
    """(members, count) points of the first generation."""
    from scipy.stats import qmc

    return np.asarray(qmc.LatinHypercube(count, seed=rng).random(members))


def _error_percent(model: LoopModel, squares: Array | None) -> float:
    """Of the log: 100 |y - y_s| / |y| of torques, of outputs of what they move."""
    if squares is None:
        return math.nan
    n, measured = model.joint_count, model.measured
    if model.loop.shows_torque:
        return float(100 * np.sqrt(squares[:n].sum() / np.sum(measured**2)))
    moved = np.sum((measured - measured.mean(axis=0)) ** 2, axis=0)
    return float(100 * np.sqrt(np.mean(squares[:n] / moved))) if moved.all() else math.inf
