"""Runs all planned runs that are not in the store yet, in chunks; a run that crashes ends only its own process.

The engine is any ``concurrent.futures`` executor: threads of this process, or Dask's workers. Each of its threads
drives one child process, which runs one case after the other, so that a crash, a time-out or a full memory belongs to
a known run. In a pool of processes with a shared queue one crash would end them all.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from fmu_didim.base.errors import FmuDidimError, InputError
from fmu_didim.campaigns.planning.document import Limits
from fmu_didim.campaigns.planning.plan import Plan, PlannedRun
from fmu_didim.campaigns.running.execute import ENVIRONMENT, Task, Trial, close_worker, execute, start_worker, try_case
from fmu_didim.campaigns.running.fmu_slots import fmu_slots, sources_of
from fmu_didim.campaigns.running.store import (
    ALIVE_S,
    CRASHED,
    FAILED,
    FAILURES,
    FILES,
    MEMORY_LIMIT,
    TIME_LIMIT,
    Journal,
    Store,
    unwritable,
)
from fmu_didim.components.fmu.isolation.process import START_LIMIT, ProcessEndedError, Worker

CHUNK_S = 4.0
"""[s] Work in one chunk: a hundred times the overhead of an engine, and little to lose."""
CHUNK_RUNS = 200
"""[runs] Most runs of a chunk, however short: failures are reported soon."""
CHUNKS_AHEAD = 2
"""[chunks] Submitted for each worker: the one that it works on, and one so that it never waits."""
KILLS = 2
"""[times] A run whose process is killed from outside this often has failed; once may be chance."""

ProgressCallback = Callable[["Progress"], None]
RunSummary = tuple[str, str, str | None, str, float]
"""Id, status, verdict, message and seconds of a run, as an engine returns them."""


@dataclass
class Progress:
    """The progress of a campaign.

    Attributes:
        count: runs to do now; done: finished ones of these; failed: failed ones of these.
        known: runs that were in the store before.
        last: the runs that have just ended; elapsed, left: s; left is None until the first have ended.
    """

    count: int
    known: int
    done: int = 0
    failed: int = 0
    last: list[RunSummary] = field(default_factory=list)
    elapsed: float = 0.0

    @property
    def left(self) -> float | None:
        """[s] Estimated time for the rest."""
        return self.elapsed * (self.count - self.done) / self.done if self.done else None


class RunWorker:
    """A child process that executes runs one after the other, and the journal of their rows."""

    def __init__(self, folder: Path, allowed: Limits) -> None:
        self._allowed, self.journal = allowed, Journal(folder)
        self._process: Worker | None = None
        self.stopped = False

    def ask(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Call a function in the process, started if necessary; raises ProcessEndedError once it is stopped."""
        if self._process is None and not self.stopped:
            self._process = Worker("the run", self._allowed.time_s, subject="The run", environment=ENVIRONMENT)
            self._process.request("the start", start_worker, self._allowed.memory_mb, limit=START_LIMIT)
        if self._process is None or self.stopped:
            raise ProcessEndedError(
                "The campaign was interrupted.", next_step="Give the same command again: finished runs are kept."
            )
        return self._process.request("the run", function, *arguments)

    def run(self, task: Task, attempt: int = 1) -> dict[str, Any]:
        """The row of a run, also where its process ends."""
        for kills in range(1, KILLS + 1):
            started, clock = datetime.now(UTC).isoformat(timespec="milliseconds"), time.perf_counter()
            try:
                row: dict[str, Any] = self.ask(execute, task)
                if row["status"] == MEMORY_LIMIT:
                    self.close()  # its state is unreliable now
                break
            except FmuDidimError as error:
                self.close()
                if isinstance(error, ProcessEndedError) and error.killed and not self.stopped and kills < KILLS:
                    continue
                row = {"id": task.id, "design": task.design, "data": task.data, "seed": task.seed, "started": started,
                       **_ended(error), "seconds": time.perf_counter() - clock}  # fmt: skip
                break
        return {**row, "attempt": attempt}

    def stop(self) -> None:
        """End the process at once, from another thread; the run that it is on leaves no row."""
        self.stopped = True
        if self._process is not None:
            self._process.kill()

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            with suppress(FmuDidimError):
                self._process.request("the end", close_worker, limit=5.0)
            self._process.close()
            self._process = None


def _ended(error: FmuDidimError) -> dict[str, str]:
    """Status and message of a run whose process gave no row."""
    if not isinstance(error, ProcessEndedError):
        return {"status": FAILED, "message": str(error)}
    if error.expired:
        advice = "It waits or loops for ever; raise limits: {time_s: ...} if it is only slow."
    elif error.killed:
        advice = "It may have used up the memory of the machine: take fewer workers, or a lower memory_mb."
    else:
        advice = "An FMU or a Python object of the case crashes: isolated: true at an FMU shows which, and where."
    message = f"{error.what}\n  got:   {error.got}\n  next:  {advice}"
    return {"status": TIME_LIMIT if error.expired else CRASHED, "message": message}


@dataclass(frozen=True)
class Chunk:
    """Runs that are submitted together; picklable, with all that a worker needs."""

    folder: str
    tasks: tuple[tuple[Task, int], ...]
    allowed: Limits


_local = threading.local()
_all_workers: list[RunWorker] = []
_lock = threading.Lock()


def worker_of_thread(folder: str, allowed: Limits) -> RunWorker:
    """The worker of this thread for a campaign."""
    key = (folder, allowed.model_dump_json())
    if getattr(_local, "key", None) != key:
        if getattr(_local, "worker", None) is not None:
            _local.worker.close()
            _local.worker.journal.close()
        _local.key, _local.worker = key, RunWorker(Path(folder), allowed)
        with _lock:
            _all_workers.append(_local.worker)
    worker: RunWorker = _local.worker
    return worker


def run_chunk(chunk: Chunk) -> list[RunSummary]:
    """Run a chunk in this thread; returns summaries, the rows are in the store."""
    worker, summaries = worker_of_thread(chunk.folder, chunk.allowed), []
    with _fmu_slots(worker, [task for task, _ in chunk.tasks], chunk.allowed):
        for task, attempt in chunk.tasks:
            if worker.stopped:
                break
            row = worker.run(task, attempt)
            if worker.stopped:  # this process ended it
                break
            worker.journal.write(row)
            message, seconds = row.get("message") or "", row.get("seconds") or 0.0
            summaries.append((task.id, row["status"], row.get("verdict"), message, seconds))
        worker.journal.end_chunk()
    return summaries


def try_tasks(folder: str, allowed: Limits, tasks: Sequence[Task]) -> list[Trial]:
    """Load each of some cases in this thread, before any run."""
    worker, found = worker_of_thread(folder, allowed), []
    with _fmu_slots(worker, tasks, allowed):
        for task in tasks:
            if worker.stopped:
                break
            try:
                found.append(worker.ask(try_case, task))
            except FmuDidimError as error:  # it ended its process
                worker.close()
                found.append(Trial(doubt=str(error)))
    return found


def stop_workers() -> None:
    """End all child processes at once; the runs that they are on leave no row."""
    with _lock:
        for worker in _all_workers:
            worker.stop()


def close_workers() -> None:
    """End all child processes and their journals, when no run is in progress."""
    with _lock:
        workers, _all_workers[:] = list(_all_workers), []
    for worker in workers:
        worker.close()
        worker.journal.close() if worker.stopped else worker.journal.seal()


@contextmanager
def _fmu_slots(worker: RunWorker, tasks: Sequence[Task], allowed: Limits) -> Iterator[None]:
    """Hold the slots of a chunk while it runs; its process ends before they are released, and with it its FMUs."""
    files = {
        Path(task.content.folder, name): allowed.instances[name]
        for task in tasks for case in (task.content.case, task.content.truth or {})
        for name in sources_of(case) & set(allowed.instances)
    }  # fmt: skip
    with fmu_slots(files, lambda: worker.stopped):
        yield
        if files:
            worker.close()


def task_of(plan: Plan, run: PlannedRun, files: Path | None = None) -> Task:
    """A run as it is sent to a worker."""
    where = str(files / run.id) if files is not None and plan.document.keep else ""
    return Task(run.id, run.design, run.data, run.seed, plan.document.verb, plan.content(run.settings), where)


def chunks(
    plan: Plan, store: Store, todo: Sequence[tuple[PlannedRun, int]], size: Callable[[], int]
) -> Iterator[Chunk]:
    """The runs in chunks, runs of one case together as far as they fit."""
    files = (store.folder / FILES).resolve()
    folder, allowed = str(store.folder.resolve()), plan.document.limits
    held: list[tuple[PlannedRun, int]] = []
    for item in todo:
        another = bool(held) and item[0].design != held[-1][0].design and len(held) >= max(size() // 2, 1)
        if another or len(held) >= size():
            yield Chunk(folder, tuple((task_of(plan, run, files), attempt) for run, attempt in held), allowed)
            held = []
        held.append(item)
    if held:
        yield Chunk(folder, tuple((task_of(plan, run, files), attempt) for run, attempt in held), allowed)


def run_all(
    plan: Plan, store: Store, todo: Sequence[tuple[PlannedRun, int]], engine: Executor, workers: int,
    known: int, report: ProgressCallback,
) -> Progress:  # fmt: skip
    """Run ``todo`` (run, attempt) and report the progress.

    Raises:
        InputError: results could not be written, or the engine is lost; finished runs are in the store.
    """
    progress, begun = Progress(len(todo), known), time.monotonic()
    announced = store.announce()
    spent = [0.0]

    def size() -> int:
        if not progress.done:
            return 1  # nobody knows how long a run takes, and the user waits for a first word of them
        each = spent[0] / progress.done
        most = max(1, len(todo) // (4 * workers))
        return max(1, min(int(CHUNK_S / max(each, 1e-3)), CHUNK_RUNS, most))

    waiting = chunks(plan, store, todo, size)
    running: set[Future[list[RunSummary]]] = set()
    try:
        while True:
            while len(running) < CHUNKS_AHEAD * workers and (chunk := next(waiting, None)) is not None:
                running.add(engine.submit(run_chunk, chunk))
            if not running:
                return progress
            done, running = wait(running, timeout=ALIVE_S / 4, return_when=FIRST_COMPLETED)
            store.announce()
            for future in done:
                summaries = future.result()
                spent[0] += sum(summary[4] for summary in summaries)
                progress.done += len(summaries)
                progress.failed += sum(summary[1] in FAILURES for summary in summaries)
                progress.last, progress.elapsed = summaries, time.monotonic() - begun
                report(progress)
    except OSError as error:
        raise unwritable(store.folder, error) from error
    except CancelledError as error:
        raise InputError(
            "The cluster is lost: its scheduler does not answer.", where=str(store.folder),
            got=f"{progress.done} of {progress.count} runs were reported as done",
            next_step="Start it again and run the same command: finished runs are not run again.",
        ) from error  # fmt: skip
    finally:
        for future in running:
            future.cancel()
        announced.unlink(missing_ok=True)
