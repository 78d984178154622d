"""Global search by CMA-ES with restarts, each of a larger population, as the package ``cmaes`` has it.

Sources: N. Hansen, A. Ostermeier, Evolutionary Computation 9(2), 2001; A. Auger, N. Hansen, IEEE CEC 2005 (restarts
with a doubled population); M. Nomura, M. Shibata, "cmaes: A Simple yet Practical Python Library for CMA-ES", 2024.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from fmu_didim.base.errors import InputError, loading
from fmu_didim.estimators.search.generations import ALIKE, VISIBLE, Generations

WIDTH = 0.3
"""[1] Standard deviation of the first generation, of the width of the box: that of Auger and Hansen is 0.5, which cuts
off a third at the edges; Hansen advises a quarter to a third of where the minimum is expected."""
GROWTH = 2
"""[1] Population of a restart over that of the one before: of Auger and Hansen."""
IN_VAIN = 2
"""[restarts] That find nothing lower, one after the other, before the search ends: the first one that stays above may
have met a local minimum itself."""


def adapted(run: Generations) -> None:
    """Search a box by CMA-ES.

    Raises:
        InputError: the package is not installed.
    """
    absent = InputError(
        "CMA-ES needs the package cmaes.", where="search.method", got="cmaes, which is not installed",
        valid="starts, differential_evolution; cmaes with its package",
        next_step="Install it: pip install 'fmu_didim[cmaes]'.",
    )  # fmt: skip
    with loading("cmaes", absent=absent):
        from cmaes import CMA
    rng, count = np.random.default_rng(run.search.seed), run.box.place.size
    members, vain, cube = None, 0, np.tile([0.0, 1.0], (count, 1))
    while vain < IN_VAIN:
        begin, seed = rng.random(count), int(rng.integers(2**31))
        strategy = CMA(begin, WIDTH, bounds=cube, seed=seed, population_size=members)
        before = run.lowest
        if not _one_run(strategy, run):
            return
        vain = 0 if run.lowest < before - VISIBLE else vain + 1
        members = GROWTH * strategy.population_size


def _one_run(strategy: Any, run: Generations) -> bool:
    """One run until its generations are alike; False where the search has to end, by its time or its cap."""
    members: int = strategy.population_size
    while not run.spent or members <= run.left:
        units = [strategy.ask() for _ in range(members)]
        costs = run.misfits(units, repeats=run.left // members)
        strategy.tell(list(zip(units, costs, strict=True)))
        if run.ended():
            return False
        if np.std(costs) <= ALIKE * abs(np.mean(costs)) or strategy.should_stop():
            return True
    run.reached_cap()
    return False
