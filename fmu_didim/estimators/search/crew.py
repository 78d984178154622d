"""Who runs local fits and simulations for a search: threads of this process; child processes by way of a case
(:mod:`fmu_didim.workflow.processes`)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

import numpy as np

from fmu_didim.base.errors import FmuDidimError, FmuError, IdentificationError, InputError, SimulationError
from fmu_didim.data.signals import Array
from fmu_didim.estimators.base import Estimator
from fmu_didim.fit.estimate import Status
from fmu_didim.fit.exploration.minima import squares_of
from fmu_didim.fit.statistics import error_percent
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


Task: TypeAlias = Callable[[Estimator, LoopModel, Any], Any]
"""What a crew runs: a function at the top level of a module, of the estimator, the model and one item."""


Stop = Callable[[], bool]
"""Whether nothing more is to begin."""


def go_on() -> bool:
    """All is to begin."""
    return False


def as_they_end(running: Mapping[Future[Any], int], stop: Stop) -> Iterator[tuple[int, Any]]:
    """Number and result of each of these as it ends; once ``stop`` says so, those that have not begun are left out."""
    for one in as_completed(running):
        if not one.cancelled():
            yield running[one], one.result()
            if stop():
                for other in running:
                    other.cancel()


class Crew(ABC):
    """Runs what a search asks for, side by side."""

    @abstractmethod
    def run(
        self, task: Task, items: Sequence[Any], *, repeats: int = 1, stop: Stop = go_on
    ) -> Iterator[tuple[int, Any]]:
        """Number and result of a task with each of these items, as they end. Where its process ends, the result is the
        error.

        Args:
            repeats: how often as much will be asked for again, as a guess: whether it pays to start processes.
            stop: asked after each result; from then on nothing more begins, and what runs comes to its end.
        """

    def close(self) -> None:  # noqa: B027 - most have nothing to end
        """End what it has started."""

    def fits(self, starts: Sequence[Array], *, stop: Stop = go_on) -> Iterator[tuple[int, Ended]]:
        """Number and end of the local fit from each of these values (p,), as they end; ``stop``: as of :meth:`run`."""
        for k, end in self.run(local_fit, starts, stop=stop):
            yield k, Ended(problem=end.what) if isinstance(end, FmuDidimError) else end

    def squares(self, points: Sequence[Array], *, repeats: int = 1) -> list[Array | None]:
        """(m,) sums of squares of each output at each of these values (p,); None where they cannot be simulated.

        Args:
            repeats: as of :meth:`run`.
        """
        found = dict(self.run(squares_or_none, points, repeats=repeats))
        return [None if isinstance(found[k], FmuDidimError) else found[k] for k in range(len(points))]


def check_minima(estimator: Estimator, model: LoopModel, where: str) -> None:
    """Raise InputError where the answers of an estimator are no minima of the misfit, so that nothing can be compared
    with them; ``where``: the entry that asks for it."""
    if not estimator.finds_minima(model):
        raise InputError(
            f"The answer of {estimator.name} is no minimum of the misfit that could be compared with other values.",
            where=where, got=estimator.name, valid="didim with its finish, clie; output_error of a model:",
            next_step=f"Use one of these, or take {where}: out.",
        )  # fmt: skip


def from_values(estimator: Estimator, start: Mapping[str, float]) -> Estimator:
    """The same estimator, starting there; itself where it needs no start."""
    return replace(estimator, start=dict(start)) if hasattr(estimator, "start") else estimator  # type: ignore[type-var]


def local_fit(estimator: Estimator, model: LoopModel, values: Array) -> Ended:
    """The local fit of an estimator from values (p,)."""
    start = dict(zip(model.names, map(float, values), strict=True))
    try:
        found = from_values(estimator, start).estimate(model)
        squares = squares_of(found.model, found.value)
    except (IdentificationError, SimulationError, FmuError) as error:
        return Ended(problem=error.what)
    return Ended(
        dict(zip(found.names, map(float, found.value), strict=True)),
        dict(zip(found.names, map(float, found.standard_deviation), strict=True)),
        squares, error_percent(model.loop, found.measured, found.simulated)[0], found.status is Status.CONVERGED,
    )  # fmt: skip


def squares_or_none(_: Estimator, model: LoopModel, values: Array) -> Array | None:
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

    def run(
        self, task: Task, items: Sequence[Any], *, repeats: int = 1, stop: Stop = go_on
    ) -> Iterator[tuple[int, Any]]:
        workers, alone = self.workers, replace(self.model, workers=1)
        if workers < 2 or len(items) < 2:
            for k, item in enumerate(items):
                yield k, task(self.estimator, self.model, item)
                if stop():
                    return
            return
        threads = ThreadPoolExecutor(workers)
        try:
            running = {threads.submit(task, self.estimator, alone, item): k for k, item in enumerate(items)}
            yield from as_they_end(running, stop)
        finally:
            threads.shutdown(cancel_futures=True)

    @property
    def workers(self) -> int:
        """How many run at the same time."""
        return self.model.workers_from_start
