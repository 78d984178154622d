"""Who runs local fits and simulations for a search: threads of this process; child processes by way of a case
(:mod:`fmu_didim.workflow.processes`)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from fmu_didim.base.errors import FmuError, IdentificationError, SimulationError
from fmu_didim.data.signals import Array
from fmu_didim.estimators.base import Estimator
from fmu_didim.fit.estimate import Status
from fmu_didim.fit.exploration.minima import squares_of
from fmu_didim.fit.statistics import relative_error_percent
from fmu_didim.model.loop_model import LoopModel


@dataclass(frozen=True)
class Ended:
    """Where a local fit has ended.

    Attributes:
        values, deviation: name of each parameter -> value, standard deviation; empty where it failed.
        squares: (m,) sums of the squares that it leaves of each output; error_percent: of the log.
        settled: whether it converged; problem: why it failed.
    """

    values: Mapping[str, float] = field(default_factory=dict)
    deviation: Mapping[str, float] = field(default_factory=dict)
    squares: Array = field(default_factory=lambda: np.zeros(0))
    error_percent: float = np.nan
    settled: bool = False
    problem: str = ""


class Crew(ABC):
    """Runs what a search asks for, side by side."""

    @abstractmethod
    def fits(self, starts: Sequence[Array]) -> Iterator[tuple[int, Ended]]:
        """Number and end of the local fit from each of these values (p,), as they end; who stops iterating stops it."""

    def close(self) -> None:  # noqa: B027 - most have nothing to end
        """End what it has started."""

    @abstractmethod
    def squares(self, points: Sequence[Array]) -> list[Array | None]:
        """(m,) sums of squares of each output at each of these values (p,); None where they cannot be simulated."""


def local_fit(estimator: Estimator, model: LoopModel, values: Array) -> Ended:
    """The local fit of an estimator from values (p,)."""
    start: Any = dict(zip(model.names, map(float, values), strict=True))
    try:
        found = replace(estimator, start=start).estimate(model)  # type: ignore[type-var]
        squares = squares_of(found.model, found.value)
    except (IdentificationError, SimulationError, FmuError) as error:
        return Ended(problem=error.what)
    return Ended(
        dict(zip(found.names, map(float, found.value), strict=True)),
        dict(zip(found.names, map(float, found.standard_deviation), strict=True)),
        squares, relative_error_percent(found.measured, found.simulated)[0], found.status is Status.CONVERGED,
    )  # fmt: skip


def squares_or_none(model: LoopModel, values: Array) -> Array | None:
    """Sums of squares (m,) at values (p,); None where they cannot be simulated."""
    try:
        found = squares_of(model, values)
    except (SimulationError, FmuError):
        return None
    return found if np.isfinite(found).all() else None


@dataclass(frozen=True)
class InThisProcess(Crew):
    """Threads where compiled code runs the loop, else one run after the other.

    Attributes:
        estimator: whose local fits are run; model: the loop.
    """

    estimator: Estimator
    model: LoopModel

    def fits(self, starts: Sequence[Array]) -> Iterator[tuple[int, Ended]]:
        workers, alone = self.workers(starts), replace(self.model, workers=1)
        if workers < 2:
            yield from ((k, local_fit(self.estimator, self.model, values)) for k, values in enumerate(starts))
            return
        threads = ThreadPoolExecutor(workers)
        try:
            running = {threads.submit(local_fit, self.estimator, alone, values): k for k, values in enumerate(starts)}
            for one in as_completed(running):
                yield running[one], one.result()
        finally:
            threads.shutdown(cancel_futures=True)

    def squares(self, points: Sequence[Array]) -> list[Array | None]:
        with ThreadPoolExecutor(self.workers(points)) as threads:
            return list(threads.map(lambda values: squares_or_none(self.model, values), points))

    def workers(self, points: Sequence[Array]) -> int:
        """How many run at the same time."""
        for values in points:
            try:
                return self.model.allowed_workers(values)
            except (SimulationError, FmuError):
                continue
        return 1
