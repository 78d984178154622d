"""What an identification or a discovery simulates."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any
from unittest.mock import patch

from fmu_didim.components.derivatives import VariationalComponent
from fmu_didim.cosim import KeptRecordings, Recording, System, simulate
from fmu_didim.estimators import Estimator
from fmu_didim.fit.estimate import Estimate
from fmu_didim.model import loop_model
from fmu_didim.model.loop_model import LoopModel, Simulation


@dataclass(frozen=True)
class Simulated:
    """The runs of the loop, without those of a single tick that only look who runs it.

    Attributes:
        plain, varied: substeps of the plant in each run without and with derivatives, 0 where they are chosen.
    """

    plain: tuple[int, ...]
    varied: tuple[int, ...]


def afresh(model: LoopModel) -> LoopModel:
    """The model without the recordings that it has kept, so that it simulates all again."""
    return replace(model, recordings=KeptRecordings())


def simulated(model: LoopModel, estimator: Estimator) -> tuple[Estimate, Simulated]:
    """An estimate, and the runs that it took."""
    counts: dict[bool, list[int]] = {False: [], True: []}

    def counted(system: System, *arguments: Any, ticks: Any, **options: Any) -> Recording:
        plant = system.components[model.loop.plant_name]
        if ticks[-1] > 0:
            counts[isinstance(plant, VariationalComponent)].append(plant.stated_substeps or 0)
        return simulate(system, *arguments, ticks=ticks, **options)

    with patch.object(loop_model, "simulate", counted):
        estimate = estimator.estimate(afresh(model))
    return estimate, Simulated(tuple(counts[False]), tuple(counts[True]))


@dataclass(frozen=True)
class Run:
    """One run of the loop.

    Attributes:
        effects: that the model has beside the base; cpu_s: of the thread that ran it.
    """

    effects: tuple[str, ...]
    cpu_s: float


@contextmanager
def runs_of_loops() -> Iterator[list[Run]]:
    """The runs of all loops in this process, in a list that grows as they come, from several threads."""
    runs: list[Run] = []
    record = Simulation.record

    def noted(run: Simulation, **options: Any) -> Recording:
        begin = time.thread_time()
        try:
            return record(run, **options)
        finally:
            runs.append(Run(tuple(a.effect for a in run.model.added_effects), time.thread_time() - begin))

    with patch.object(Simulation, "record", noted):
        yield runs
