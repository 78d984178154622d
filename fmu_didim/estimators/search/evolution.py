"""Global search by differential evolution (R. Storn, K. Price, J. Global Optimization 11, 1997), as SciPy has it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from fmu_didim.data.signals import Array
from fmu_didim.estimators.search.generations import ALIKE, Generations

MEMBERS = 15
"""[points] Of a generation, for each parameter: SciPy's own."""
FEWEST_GENERATIONS = 4
"""[generations] That a cap leaves at least; below that a generation becomes smaller."""


def evolved(run: Generations) -> None:
    """Search a box by differential evolution."""
    from scipy.optimize import differential_evolution  # slow to import

    count, most = run.box.place.size, run.search.evaluations
    members = min(MEMBERS * count, max(most // FEWEST_GENERATIONS, 5))
    generations = max(most // members - 1, 1)

    def all_at_once(_: Callable[[Array], float], units: Iterable[Array]) -> list[float]:
        return run.misfits(units, repeats=generations)

    def after(*_: Any, **__: Any) -> bool:
        return run.ended()

    rng = np.random.default_rng(run.search.seed)
    found = differential_evolution(
        lambda unit: 0.0, [(0.0, 1.0)] * count, maxiter=generations, init=_first(members, count, rng), seed=rng,
        tol=ALIKE, polish=False, updating="deferred", workers=all_at_once, callback=after,
    )  # fmt: skip
    if found.nit >= generations:
        run.reached_cap()


def _first(members: int, count: int, rng: np.random.Generator) -> Array:
    """(members, count) points of the first generation."""
    from scipy.stats import qmc

    return np.asarray(qmc.LatinHypercube(count, seed=rng).random(members))
