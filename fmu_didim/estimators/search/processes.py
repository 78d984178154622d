"""Local fits and simulations in child processes, for loops that Python runs or FMUs of which one runs in a process.

As for the runs of a campaign, each thread of an executor drives a child process of its own
(:class:`~fmu_didim.components.fmu.isolation.process.Worker`): a crash, or a model that hangs, belongs to one start, and
the others go on.
"""

from __future__ import annotations

import threading
import time as clock
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

from fmu_didim.base.errors import FmuDidimError
from fmu_didim.components.fmu.isolation.process import START_LIMIT, NotCarriedError, ProcessEndedError, Worker, pack
from fmu_didim.cosim import InstancePool, KeptRecordings
from fmu_didim.data.signals import Array
from fmu_didim.estimators.base import Estimator
from fmu_didim.estimators.search.crew import Crew, Ended, InThisProcess, local_fit, squares_or_none
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.workers import default_workers

FIT_LIMIT_S = 1800.0
"""[s] For one local fit: it hangs, or is one of hours that nobody starts twenty of."""
PAYS_S = 6.0
"""[s] Work in one process from which others are started: each takes some 2 s to import what it needs."""
ENVIRONMENT = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "FMU_DIDIM_WORKERS": "1"}
"""Of every process: one thread each, as there are as many as cores."""

_Item, _Found = TypeVar("_Item"), TypeVar("_Found")


def crew_of(estimator: Estimator, model: LoopModel, processes: int | None = None) -> Crew:
    """Who runs the local fits of a model: threads where its loop is compiled, else child processes where it can be
    sent to them and there is more than one core."""
    here = InThisProcess(estimator, model)
    count = default_workers() if processes is None else processes
    if count < 2 or (processes is None and here.workers([model.start]) > 1):
        return here
    alone = replace(model, pool=InstancePool(), recordings=KeptRecordings(), workers=1)
    try:
        pack((estimator, alone))
    except Exception:  # noqa: BLE001 - objects of a user may raise anything; robots hold expressions that stay here
        return here
    return Processes(estimator, alone, count, here)


@dataclass(frozen=True)
class Processes(Crew):
    """Child processes.

    Attributes:
        estimator, model: what they are sent; count: of them at the same time.
        here: runs what is too little to start them for.
    """

    estimator: Estimator
    model: LoopModel
    count: int
    here: InThisProcess
    _workers: list[Worker] = field(default_factory=list, compare=False)
    _free: list[Worker] = field(default_factory=list, compare=False)
    _lock: threading.Lock = field(default_factory=threading.Lock, compare=False)

    def fits(self, starts: Sequence[Array]) -> Iterator[tuple[int, Ended]]:
        begun, first = clock.monotonic(), local_fit(self.estimator, self.here.model, starts[0])
        yield 0, first
        left = len(starts) - 1
        if (clock.monotonic() - begun) * left < PAYS_S:
            yield from ((k + 1, end) for k, end in self.here.fits(starts[1:]))
            return
        for k, end in self._side_by_side(fit_there, starts[1:]):
            yield k + 1, Ended(problem=end.what) if isinstance(end, FmuDidimError) else end

    def squares(self, points: Sequence[Array]) -> list[Array | None]:
        if not self._workers:
            begun, first = clock.monotonic(), squares_or_none(self.here.model, points[0])
            # A generation is followed by others; what one of a few points takes is left here.
            if (clock.monotonic() - begun) * len(points) * GENERATIONS < PAYS_S or len(points) < self.count:
                return [first, *(squares_or_none(self.here.model, values) for values in points[1:])]
        found = dict(self._side_by_side(squares_there, points))
        return [None if isinstance(found[k], FmuDidimError) else found[k] for k in range(len(points))]

    def _side_by_side(
        self, function: Callable[..., Any], points: Sequence[Array]
    ) -> Iterator[tuple[int, Any]]:  # fmt: skip
        """Number and result, or error, of each of these values, as they come."""
        threads = ThreadPoolExecutor(self.count)
        try:
            running = {threads.submit(self._asked, function, values): k for k, values in enumerate(points)}
            for one in as_completed(running):
                yield running[one], one.result()
        except BaseException:  # also Ctrl-C, and who asks for no more
            threads.shutdown(wait=False, cancel_futures=True)
            self.close()
            raise
        finally:
            threads.shutdown(cancel_futures=True)

    def _asked(self, function: Callable[..., Any], values: Array) -> Any:
        """The result of a call in a process that is free; its error where it raises one or ends its process."""
        try:
            worker = self._taken()
        except FmuDidimError as error:
            return error
        try:
            found = worker.request("a local fit", function, values, limit=FIT_LIMIT_S)
        except (ProcessEndedError, NotCarriedError) as error:
            worker.close()
            with self._lock:
                self._workers.remove(worker)
            return error
        except FmuDidimError as error:
            found = error
        with self._lock:
            self._free.append(worker)
        return found

    def _taken(self) -> Worker:
        """A process that nobody else has, started where there is none."""
        with self._lock:
            if self._free:
                return self._free.pop()
            worker = Worker("a local fit", FIT_LIMIT_S, subject="The process of a start", environment=ENVIRONMENT)
            self._workers.append(worker)
        worker.request("the start", keep_model, self.estimator, self.model, limit=START_LIMIT)
        return worker

    def close(self) -> None:
        """End the processes."""
        with self._lock:
            for worker in self._workers:
                worker.kill()
                worker.close()
            self._workers.clear()
            self._free.clear()


GENERATIONS = 20
"""[1] Generations that a global search has at least, as a rule."""


def keep_model(there: Any, estimator: Estimator, model: LoopModel) -> None:
    """Keep what later requests are about, in a child process."""
    there.estimator, there.model = estimator, model


def fit_there(there: Any, values: Array) -> Ended:
    """The local fit from values (p,), in a child process."""
    return local_fit(there.estimator, there.model, values)


def squares_there(there: Any, values: Array) -> Array | None:
    """Sums of squares (m,) at values (p,), in a child process."""
    return squares_or_none(there.model, values)
