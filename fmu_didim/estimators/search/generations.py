"""Generations of points that a global search asks for, and what it has reached by them."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from fmu_didim.data.signals import Array
from fmu_didim.estimators.base import Progress
from fmu_didim.estimators.search.box import Box
from fmu_didim.estimators.search.crew import Crew
from fmu_didim.estimators.search.options import Search
from fmu_didim.fit.exploration.minima import misfit
from fmu_didim.fit.iteration import Iteration
from fmu_didim.model.loop_model import LoopModel

FAILED = 1e30
"""[1] Misfit of values that cannot be simulated: a finite one, so that generations can be compared."""
ALIKE = 1e-3
"""[1] Spread of the misfits of a generation, relative to their mean, at which it ends: the local fit does the rest."""
VISIBLE = 0.1
"""[chi-square] A misfit that is lower by less counts as the same: the rest of the iterations."""


@dataclass
class Generations:
    """The generations of a global search inside a box.

    Each is simulated as a whole, so that the answer does not depend on how many run side by side.

    Attributes:
        model, box, search, crew: what is searched, where, how, and who simulates.
        progress: gets an iteration ``search`` for each generation.
        spent: simulations; count: generations; stopped: why the search ended early, empty where it did not.
        best: (p,) values of the lowest misfit; lowest: that misfit; error_percent: of the log there.
    """

    model: LoopModel
    box: Box
    search: Search
    crew: Crew
    progress: Progress
    spent: int = 0
    count: int = 0
    stopped: str = ""
    best: Array = field(default_factory=lambda: np.zeros(0))
    lowest: float = math.inf
    error_percent: float = math.nan
    begun: float = field(default_factory=clock.monotonic)

    def __post_init__(self) -> None:
        self.best = self.box.begin

    @property
    def left(self) -> int:
        """Simulations that the cap allows yet."""
        return self.search.evaluations - self.spent

    def misfits(self, units: Iterable[Array], *, repeats: int) -> list[float]:
        """The misfit at each point (d,) of the unit cube; ``repeats``: as many generations may follow."""
        points = [self.box.point(np.asarray(unit)) for unit in units]
        found = self.crew.squares(points, repeats=repeats)
        costs = [
            FAILED if squares is None else misfit(self.model, squares, values)
            for values, squares in zip(points, found, strict=True)
        ]
        self.spent += len(points)
        best = int(np.argmin(costs))
        if costs[best] < self.lowest:
            self.lowest, self.best = costs[best], points[best]
            self.error_percent = _error_percent(self.model, found[best])
        return costs

    def ended(self) -> bool:
        """Tell of a generation that has ended; whether the time of the search is over."""
        self.count += 1
        note = f"{self.spent} of at most {self.search.evaluations} simulations"
        quantity = self.model.loop.quantity
        self.progress(Iteration("search", self.count, self.best, self.error_percent, note=note, quantity=quantity))
        limit = self.search.time_s
        if limit is not None and clock.monotonic() - self.begun > limit:
            self.stopped = f"its time of {limit:g} s was over"
        return bool(self.stopped)

    def reached_cap(self) -> None:
        """The search ended as it had no simulations left, unless its time was over before."""
        self.stopped = self.stopped or f"at its cap of evaluations: {self.search.evaluations}"


def _error_percent(model: LoopModel, squares: Array | None) -> float:
    """Of the log: 100 |y - y_s| / |y| of torques, of outputs of what they move."""
    if squares is None:
        return math.nan
    n, measured = model.joint_count, model.measured
    if model.loop.shows_torque:
        return float(100 * np.sqrt(squares[:n].sum() / np.sum(measured**2)))
    moved = np.sum((measured - measured.mean(axis=0)) ** 2, axis=0)
    return float(100 * np.sqrt(np.mean(squares[:n] / moved))) if moved.all() else math.inf
