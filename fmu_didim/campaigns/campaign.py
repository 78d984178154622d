"""A campaign as an object: check it, run it, read its results."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from os import cpu_count
from pathlib import Path
from typing import Any

from fmu_didim.base.documents import load_yaml, problems_error
from fmu_didim.base.errors import InputError, UnknownNameError
from fmu_didim.base.files import file_name
from fmu_didim.campaigns.planning.fields import plain
from fmu_didim.campaigns.planning.plan import Plan, PlannedRun
from fmu_didim.campaigns.reporting.results import Results
from fmu_didim.campaigns.reporting.sections import duration
from fmu_didim.campaigns.running.execute import Task, Trial, execute
from fmu_didim.campaigns.running.runner import (
    ProgressCallback,
    RunWorker,
    close_workers,
    run_all,
    stop_workers,
    task_of,
    try_tasks,
)
from fmu_didim.campaigns.running.store import FAILURES, Store
from fmu_didim.campaigns.validation import case_problems, read_campaign
from fmu_didim.case import Case
from fmu_didim.case.in_memory import Memory
from fmu_didim.results.provenance import code_digest
from fmu_didim.workflow.output.result_folder import check_writable

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class DryRun:
    """The runs of a campaign and their estimated time.

    Attributes:
        name: of the campaign; count: different runs; equal: further runs that equal one of these.
        known: runs that are in the folder already.
        cases: runs that differ by more than their seed; first: the first runs; tried: cases that were loaded.
        seconds: estimate for all runs from two trials; None where nothing is left to run.
    """

    name: str
    count: int
    equal: int
    known: int
    cases: int
    tried: int
    workers: int
    first: tuple[PlannedRun, ...]
    seconds: float | None

    def lines(self) -> list[str]:
        """For the terminal."""
        found = [f"{self.name}: {self.count} runs of {self.cases} cases; {self.tried} cases were loaded"]
        if self.equal:
            found.append(f"{self.equal} further runs equal others and are run and counted once")
        if self.known:
            found.append(f"{self.known} are in the folder already")
        for number, run in enumerate(self.first, start=1):
            found.append(f"  {number}. {json.dumps(run.labels, default=str)}, seed {run.seed}, id {run.id}")
        if self.seconds is not None:
            took = duration(self.seconds)
            found.append(f"about {took} with {self.workers} workers, by two trials; nothing was written")
        return found


class Campaign:
    """A campaign, all of whose cases have the right form; made by :func:`campaign` and :func:`study`.

    Attributes:
        plan: its runs; out: folder of its results.
    """

    def __init__(self, plan: Plan, out: Path, *, problems: Sequence[str] = ()) -> None:
        self.plan, self.out = plan, out
        self._problems = list(problems)

    def __repr__(self) -> str:
        return f"Campaign({self.plan.document.name!r}, {self.plan.combination_count} runs, {self.out})"

    def check(self, *, workers: int | None = None, scheduler: str | None = None) -> None:
        """Check names, values and files before the first run, and load a case for each value.

        Raises:
            InputError: with all problems at once.
        """
        with _engine(workers, scheduler) as (engine, count):
            self._check(engine, count)

    def dry_run(self, *, workers: int | None = None) -> DryRun:
        """Check the campaign and estimate its run time by two trials of its first case; nothing is written."""
        with _engine(workers, None) as (engine, count):
            tried = self._check(engine, count)
        todo, known = self._todo(None)
        runs = self.plan.runs
        return DryRun(
            name=self.plan.document.name, count=len(runs), equal=self.plan.combination_count - len(runs), known=known,
            cases=len({run.design for run in runs}), tried=tried, workers=count, first=runs[:3],
            seconds=self._estimate([run for run, _ in todo], count) if todo else None,
        )  # fmt: skip

    def _estimate(self, todo: Sequence[PlannedRun], workers: int) -> float:
        """[s] Estimated run time: the first run of a case loads it, those with other seeds reuse it."""
        worker = RunWorker(self.out, self.plan.document.limits)
        pair = todo[0], next((run for run in todo[1:] if run.design == todo[0].design), todo[-1])
        try:
            cold, warm = (float(worker.ask(execute, task_of(self.plan, run))["seconds"]) for run in pair)
        finally:
            worker.close()
        cases = len({run.design for run in todo})
        return (cases * max(cold - warm, 0.0) + len(todo) * warm) / workers

    def run(
        self,
        *,
        workers: int | None = None,
        scheduler: str | None = None,
        only: Iterable[str] = (),
        progress: ProgressCallback | None = None,
    ) -> Results:
        """Run all that is not in the folder yet.

        Args:
            workers: processes on this machine; as many as cores by default.
            scheduler: address of a Dask scheduler (``tcp://...``) or its file, whose workers share the folders.
            only: ids of the runs to run, whether they are in the folder or not.
            progress: called when runs have ended.

        Raises:
            InputError: the campaign has errors, all of which are listed; or results cannot be written.
        """
        check_writable(self.out)
        with _engine(workers, scheduler) as (engine, count):
            self._check(engine, count)
            store = Store(self.out)
            store.begin(self.plan)
            if others := store.other_runners():
                _log.info("%s also runs this campaign; what it has done is not run here", ", ".join(others))
            todo, known = self._todo(only or None)
            if others:
                half = len(todo) // 2
                todo = [*todo[half:], *todo[:half]]  # the other runner started with the first half
            if todo:
                run_all(self.plan, store, todo, engine, count, known, progress or (lambda _: None))
        return Results(store)

    def failed(self) -> list[str]:
        """Ids of the runs that have failed; not those that were refused, which would be refused again."""
        rows = Store(self.out).rows(()).to_pylist()
        return [row["id"] for row in rows if row["status"] in FAILURES and row["id"] in self.plan.by_id]

    def retry(self, **options: Any) -> Results:
        """Run the failed runs again; options as of :meth:`run`."""
        failed = self.failed()
        return self.run(only=failed, **options) if failed else self.results()

    def results(self) -> Results:
        """The results so far; raises InputError where there are none."""
        return Results(Store(self.out))

    def _check(self, engine: Executor, workers: int) -> int:
        """Raise all errors at once; returns how many cases were loaded."""
        allowed, folder = self.plan.document.limits, str(self.out.resolve())

        def attempt(tasks: Sequence[Task]) -> list[Trial]:
            _log.info("checking %d case%s ...", len(tasks), "" if len(tasks) == 1 else "s")
            parts = [tasks[k::workers] for k in range(workers)]
            done = [engine.submit(try_tasks, folder, allowed, part) for part in parts if part]
            found: list[Trial] = [Trial() for _ in tasks]
            for k, future in enumerate(done):
                found[k::workers] = future.result()
            return found

        found, tried = case_problems(self.plan, attempt)
        if found := [*self._problems, *found]:
            raise problems_error(found, where=self.plan.document.name)
        return tried

    def _todo(self, only: Iterable[str] | None) -> tuple[list[tuple[PlannedRun, int]], int]:
        """The runs to do, each with the number of its attempt, and how many are known."""
        store = Store(self.out)
        rows = store.rows(()).to_pylist() if self.out.is_dir() else []
        attempts = {row["id"]: row["attempt"] or 1 for row in rows}
        known = sum(run.id in attempts for run in self.plan.runs)
        if only is None:
            return [(run, 1) for run in self.plan.runs if run.id not in attempts], known
        wanted = list(only)
        for name in wanted:
            if name not in self.plan.by_id:
                raise UnknownNameError("run of this plan", name, list(self.plan.by_id)[:10], where=str(self.out))
        return [(self.plan.by_id[name], attempts.get(name, 0) + 1) for name in wanted], known


@contextmanager
def _engine(workers: int | None, scheduler: str | None) -> Iterator[tuple[Executor, int]]:
    """The executor of the runs, and how many it works on at once."""
    if scheduler is not None:
        from fmu_didim.campaigns.running.cluster import cluster

        with cluster(scheduler) as found:
            try:
                yield found
            finally:
                close_workers()  # there are some where the workers are threads of this process
        return
    count = workers or cpu_count() or 1
    pool = ThreadPoolExecutor(count)
    try:
        yield pool, count
    except BaseException:  # Ctrl-C as well
        stop_workers()
        raise
    finally:
        pool.shutdown(cancel_futures=True)
        close_workers()


def campaign(
    source: Path | str | Mapping[str, Any], out: Path | str | None = None, *, folder: Path | str = "."
) -> Campaign:
    """A campaign from its file or its content; see :class:`~fmu_didim.campaigns.planning.document.CampaignDocument`.

    Args:
        out: folder for its results; ``results/<folder of the file>-<its name>`` by default.
        folder: to which the paths of a content are relative.

    Raises:
        InputError: it holds an object that only this process has, or too many errors to plan anything;
            :meth:`Campaign.check` reports all others.
    """
    if isinstance(source, Mapping):
        content, folder, file = plain(source, Memory()), Path(folder), ""
        where = stem = file_name(str(source.get("name", "campaign")))
    else:
        content, folder, file, where = load_yaml(source), Path(source).parent, Path(source).name, str(source)
        stem = f"{Path(source).resolve().parent.name}-{Path(source).stem}"
    plan, found = read_campaign(content, folder)
    if plan is None:
        raise problems_error(found, where=where)
    return Campaign(replace(plan, file=file), Path(out or Path("results") / stem), problems=found)


def study(
    case: Case | Path | str | Mapping[str, Any],
    *,
    vary: Mapping[str, Any] | Sequence[Mapping[str, Any]],
    seeds: int | Iterable[int] = 1,
    out: Path | str | None = None,
    folder: Path | str = ".",
    **entries: Any,
) -> Campaign:
    """A campaign without a file.

    Args:
        case: a case, its file or its content.
        vary, seeds: as in a campaign file; entries: its other entries (``noise``, ``truth``, ``verb``, ``keep``, ...).
        out: folder for its results, ``results/<name>`` by default.
        folder: to which the paths of a content are relative.

    Raises:
        InputError: as of :func:`campaign`.
    """
    if isinstance(case, Case):
        content, folder = plain(case.content, case.memory, "case"), case.folder
    else:
        content = dict(case) if isinstance(case, Mapping) else str(case)
    name = entries.pop("name", None) or (f"study of {Path(content).stem}" if isinstance(content, str) else "study")
    listed = seeds if isinstance(seeds, int) else list(seeds)
    document = {"name": name, "case": content, "vary": vary, "seeds": listed, **entries}
    return campaign(document, out, folder=folder)


def opened(folder: Path | str) -> Campaign:
    """The campaign of a folder of results, to repeat its runs.

    Raises:
        InputError: it was planned by another version of the code, or files have changed since: results would mix.
    """
    store = Store(folder)
    head = store.head()
    found = campaign(head["campaign"], Path(folder), folder=head["folder"])
    found.plan = replace(found.plan, file=head.get("file", ""))
    ids = set(store.planned()["id"].to_pylist())
    if ids != set(found.plan.by_id):
        code = "the code" if head["code"] != code_digest() else "a file"
        raise InputError(
            f"The runs differ from those that were planned: {code} has changed.", where=str(folder),
            got=f"{len(ids - set(found.plan.by_id))} of {len(ids)} planned runs have changed",
            next_step="Run the campaign file again: changed runs are repeated; old and new results are not mixed.",
        )  # fmt: skip
    return found
