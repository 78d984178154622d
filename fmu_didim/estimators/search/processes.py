"""Local fits and simulations in child processes, for loops that Python runs or FMUs of which one runs in a process.

As for the runs of a campaign, each thread of an executor drives a child process of its own
(:class:`~fmu_didim.components.fmu.isolation.process.Worker`): a crash, or a model that hangs, belongs to one start, and
the others go on.
"""

from __future__ import annotations

import threading
import time as clock
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Any

from fmu_didim.base.errors import FmuDidimError
from fmu_didim.components.fmu.isolation.process import START_LIMIT, NotCarriedError, ProcessEndedError, Worker, pack
from fmu_didim.cosim import InstancePool, KeptRecordings
from fmu_didim.estimators.base import Estimator
from fmu_didim.estimators.search.crew import Crew, InThisProcess, Stop, Task, as_they_end, go_on
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.workers import default_workers

FIT_LIMIT_S = 1800.0
"""[s] For one local fit: it hangs, or is one of hours that nobody starts twenty of."""
PAYS_S = 15.0
"""[s] Work in one process from which others are started: each takes 2 s to import what it needs, 10 s on a busy
machine, and two of them save half of the work at best."""
ENVIRONMENT = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "FMU_DIDIM_WORKERS": "1"}
"""Of every process: one thread each, as there are as many as cores."""


def crew_of(estimator: Estimator, model: LoopModel, processes: int | None = None) -> Crew:
    """Who runs the local fits of a model: threads where its loop is compiled, else child processes where it can be
    sent to them and there is more than one core."""
    here = InThisProcess(estimator, model)
    count = default_workers() if processes is None else processes
    if count < 2 or (processes is None and here.workers > 1):
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

    def run(
        self, task: Task, items: Sequence[Any], *, repeats: int = 1, stop: Stop = go_on
    ) -> Iterator[tuple[int, Any]]:
        if not self._workers:
            begun, first = clock.monotonic(), task(self.estimator, self.here.model, items[0])
            yield 0, first
            if stop():
                return
            left = len(items) - 1
            crew = self.here.run if (clock.monotonic() - begun) * left * repeats < PAYS_S else self._side_by_side
            for k, found in crew(task, items[1:], stop=stop):
                yield k + 1, self._or_here(found, task, items[k + 1])
            return
        for k, found in self._side_by_side(task, items, stop=stop):
            yield k, self._or_here(found, task, items[k])

    def _or_here(self, found: Any, task: Task, item: Any) -> Any:
        """What was found; by this process where a child cannot import what the model is made of."""
        return task(self.estimator, self.here.model, item) if isinstance(found, NotCarriedError) else found

    def _side_by_side(self, task: Task, items: Sequence[Any], *, stop: Stop) -> Iterator[tuple[int, Any]]:
        """Number and result, or error, of a task with each of these items, as they come."""
        threads = ThreadPoolExecutor(self.count)
        try:
            running = {threads.submit(self._asked, task, item): k for k, item in enumerate(items)}
            yield from as_they_end(running, stop)
        except BaseException:  # also Ctrl-C
            threads.shutdown(wait=False, cancel_futures=True)
            with self._lock:
                for worker in self._workers:
                    worker.kill()
            raise
        finally:
            threads.shutdown(cancel_futures=True)

    def _asked(self, task: Task, item: Any) -> Any:
        """The result of a task in a process that is free; its error where it raises one or ends its process."""
        try:
            worker = self._taken()
        except FmuDidimError as error:
            return error
        try:
            found = worker.request("a local fit", run_there, task, item, limit=FIT_LIMIT_S)
        except (ProcessEndedError, NotCarriedError) as error:
            worker.close()
            with self._lock:
                self._workers[:] = [one for one in self._workers if one is not worker]
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
            for worker in self._workers:  # that end by themselves, so that no FMU is blamed for it
                worker.close()
            self._workers.clear()
            self._free.clear()


def keep_model(there: Any, estimator: Estimator, model: LoopModel) -> None:
    """Keep what later requests are about, in a child process."""
    there.estimator, there.model = estimator, model


def run_there(there: Any, task: Task, item: Any) -> Any:
    """The result of a task, in a child process."""
    return task(there.estimator, there.model, item)
