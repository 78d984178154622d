"""Runs what is not run yet: chunks of runs go to an engine, and each run to a process that may fail alone.

The engine is any ``concurrent.futures`` executor: threads of this process, or Dask's workers. Each of its threads
drives one child process, which runs one case after the other: what kills it, stops it or fills it is the case that it
was on. In a pool of processes that share a queue it could be any of them, and one crash would end them all.
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
from fmu_didim.campaigns.planning.plan import Plan, Run
from fmu_didim.campaigns.running.execute import ENVIRONMENT, Task, Trial, begin, close, execute, try_case
from fmu_didim.campaigns.running.fmu_slots import seats, sources_of
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
"""[s] Work that is handed over at once: a hundred times what an engine takes for it, and little to lose."""
CHUNK_RUNS = 200
"""[runs] Most runs of a chunk, however short: failures are told soon."""
CHUNKS_AHEAD = 2
"""[chunks] Handed over for each worker: one it works on and one so that it never waits."""
KILLS = 2
"""[times] A run whose process is killed from outside so often has failed; once may be mere chance."""

Told = Callable[["Progress"], None]
RowHead = tuple[str, str, str | None, str, float]
"""Id, status, verdict, message and seconds of a run: what an engine brings back."""


@dataclass
class Progress:
    """How far a campaign is.

    Attributes:
        count: runs to do now; done: of them; known: runs that were there before; failed: of those done now.
        last: the runs that have just ended; elapsed, left: s; left is None until the first have ended.
    """

    count: int
    known: int
    done: int = 0
    failed: int = 0
    last: list[RowHead] = field(default_factory=list)
    elapsed: float = 0.0

    @property
    def left(self) -> float | None:
        """Seconds that the rest will take."""
        return self.elapsed * (self.count - self.done) / self.done if self.done else None


class Lane:
    """A child process for runs, one after the other, and the journal of their rows."""

    def __init__(self, folder: Path, allowed: Limits) -> None:
        self._allowed, self.journal = allowed, Journal(folder)
        self._worker: Worker | None = None
        self.stopped = False

    def ask(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Call a function in the process, which is started if there is none."""
        if self._worker is None:
            self._worker = Worker("the run", self._allowed.time_s, subject="The run", environment=ENVIRONMENT)
            self._worker.request("the start", begin, self._allowed.memory_mb, limit=START_LIMIT)
        return self._worker.request("the run", function, *arguments)

    def run(self, task: Task, attempt: int = 1) -> dict[str, Any]:
        """The row of a run; a process that ends is part of it."""
        for kills in range(1, KILLS + 1):
            started, clock = datetime.now(UTC).isoformat(timespec="milliseconds"), time.perf_counter()
            try:
                row: dict[str, Any] = self.ask(execute, task)
                if row["status"] == MEMORY_LIMIT:
                    self.close()  # what is left of it is not to be trusted
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
        if self._worker is not None:
            self._worker.kill()

    def close(self) -> None:
        """End the process."""
        if self._worker is not None:
            with suppress(FmuDidimError):
                self._worker.request("the end", close, limit=5.0)
            self._worker.close()
            self._worker = None


def _ended(error: FmuDidimError) -> dict[str, str]:
    """What the row of a run says that gave none itself."""
    if not isinstance(error, ProcessEndedError):
        return {"status": FAILED, "message": str(error)}
    if error.expired:
        advice = "Something loops or waits in it; raise limits: {time_s: ...} if it is only slow."
    elif error.killed:
        advice = "It may have filled the memory of the machine: take fewer workers, or a lower memory_mb."
    else:
        advice = "An FMU or a Python object of the case is faulty: isolated: true beside an FMU tells which, and where."
    message = f"{error.what}\n  got:   {error.got}\n  next:  {advice}"
    return {"status": TIME_LIMIT if error.expired else CRASHED, "message": message}


@dataclass(frozen=True)
class Chunk:
    """Runs that are handed over at once; all that a worker needs, picklable."""

    folder: str
    tasks: tuple[tuple[Task, int], ...]
    allowed: Limits


_lanes = threading.local()
_all_lanes: list[Lane] = []
_lock = threading.Lock()


def lane_of_thread(folder: str, allowed: Limits) -> Lane:
    """The lane of this thread for a campaign."""
    key = (folder, allowed.model_dump_json())
    if getattr(_lanes, "key", None) != key:
        if getattr(_lanes, "lane", None) is not None:
            _lanes.lane.close()
            _lanes.lane.journal.close()
        _lanes.key, _lanes.lane = key, Lane(Path(folder), allowed)
        with _lock:
            _all_lanes.append(_lanes.lane)
    lane: Lane = _lanes.lane
    return lane


def run_chunk(chunk: Chunk) -> list[RowHead]:
    """Run a chunk in this thread; returns what is to be told of it, the rows are in the store."""
    lane, heads = lane_of_thread(chunk.folder, chunk.allowed), []
    with _seats(lane, [task for task, _ in chunk.tasks], chunk.allowed):
        for task, attempt in chunk.tasks:
            if lane.stopped:
                break
            row = lane.run(task, attempt)
            if lane.stopped:  # it was ended from here, not by itself
                break
            lane.journal.write(row)
            message, seconds = row.get("message") or "", row.get("seconds") or 0.0
            heads.append((task.id, row["status"], row.get("verdict"), message, seconds))
        lane.journal.end_chunk()
    return heads


def try_tasks(folder: str, allowed: Limits, tasks: Sequence[Task]) -> list[Trial]:
    """What hinders each of some cases, tried in this thread before any run."""
    lane, found = lane_of_thread(folder, allowed), []
    with _seats(lane, tasks, allowed):
        for task in tasks:
            try:
                found.append(lane.ask(try_case, task))
            except FmuDidimError as error:  # it ended its process
                lane.close()
                found.append(Trial(doubt=str(error)))
    return found


def stop_lanes() -> None:
    """End the processes of this one at once; the runs that they are on leave no row."""
    with _lock:
        for lane in _all_lanes:
            lane.stop()


def end_lanes() -> None:
    """End the processes of this one and their journals, when no run is in flight."""
    with _lock:
        lanes, _all_lanes[:] = list(_all_lanes), []
    for lane in lanes:
        lane.close()
        lane.journal.close() if lane.stopped else lane.journal.seal()


@contextmanager
def _seats(lane: Lane, tasks: Sequence[Task], allowed: Limits) -> Iterator[None]:
    """Held while a chunk runs; before they are given back the process ends, and with it what it keeps of the FMUs."""
    files = {
        Path(task.content.folder, name): allowed.instances[name]
        for task in tasks for case in (task.content.case, task.content.truth or {})
        for name in sources_of(case) & set(allowed.instances)
    }  # fmt: skip
    with seats(files, lambda: lane.stopped):
        yield
        if files:
            lane.close()


def task_of(plan: Plan, run: Run, files: Path | None = None) -> Task:
    """A run as it is sent."""
    where = str(files / run.id) if files is not None and plan.document.keep else ""
    return Task(run.id, run.design, run.data, run.seed, plan.document.verb, plan.content(run.settings), where)


def chunks(plan: Plan, store: Store, todo: Sequence[tuple[Run, int]], size: Callable[[], int]) -> Iterator[Chunk]:
    """The runs in chunks, runs of one case together as far as they fit."""
    files = (store.folder / FILES).resolve()
    folder, allowed = str(store.folder.resolve()), plan.document.limits
    held: list[tuple[Run, int]] = []
    for item in todo:
        another = bool(held) and item[0].design != held[-1][0].design and len(held) >= max(size() // 2, 1)
        if another or len(held) >= size():
            yield Chunk(folder, tuple((task_of(plan, run, files), attempt) for run, attempt in held), allowed)
            held = []
        held.append(item)
    if held:
        yield Chunk(folder, tuple((task_of(plan, run, files), attempt) for run, attempt in held), allowed)


def run_all(
    plan: Plan, store: Store, todo: Sequence[tuple[Run, int]], engine: Executor, workers: int,
    known: int, told: Told,
) -> Progress:  # fmt: skip
    """Run ``todo`` (run, attempt) and tell how far it is.

    Raises:
        InputError: results could not be written, or the engine is gone; what was done is in the store.
    """
    progress, begun = Progress(len(todo), known), time.monotonic()
    sign = store.sign()
    spent = [0.0]

    def size() -> int:
        each = spent[0] / progress.done if progress.done else CHUNK_S / 8
        most = max(1, len(todo) // (4 * workers))
        return max(1, min(int(CHUNK_S / max(each, 1e-3)), CHUNK_RUNS, most))

    waiting = chunks(plan, store, todo, size)
    flying: set[Future[list[RowHead]]] = set()
    try:
        while True:
            while len(flying) < CHUNKS_AHEAD * workers and (chunk := next(waiting, None)) is not None:
                flying.add(engine.submit(run_chunk, chunk))
            if not flying:
                return progress
            done, flying = wait(flying, timeout=ALIVE_S / 4, return_when=FIRST_COMPLETED)
            store.sign()
            for future in done:
                heads = future.result()
                spent[0] += sum(head[4] for head in heads)
                progress.done += len(heads)
                progress.failed += sum(head[1] in FAILURES for head in heads)
                progress.last, progress.elapsed = heads, time.monotonic() - begun
                told(progress)
    except OSError as error:
        raise unwritable(store.folder, error) from error
    except CancelledError as error:
        raise InputError(
            "The cluster is gone: its scheduler does not answer.", where=str(store.folder),
            got=f"{progress.done} of {progress.count} runs were told to be done",
            next_step="Start it again and run the same command: what is in the folder is not run again.",
        ) from error  # fmt: skip
    finally:
        for future in flying:
            future.cancel()
        sign.unlink(missing_ok=True)
