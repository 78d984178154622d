"""Campaigns: two workers against two bare processes, what a run costs beside its identification, plans of 100 000."""

from __future__ import annotations

import multiprocessing
import statistics
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from fmu_didim import identify
from fmu_didim.campaigns.campaign import Campaign, study
from fmu_didim.campaigns.reporting.page import write_campaign_report
from fmu_didim.campaigns.reporting.results import Results
from fmu_didim.campaigns.reporting.status import status_of
from fmu_didim.campaigns.running.execute import Task, prepared, start_worker
from fmu_didim.campaigns.running.runner import Progress, RunWorker, task_of
from fmu_didim.campaigns.running.store import Journal, Store
from tests.helpers import ROOT
from tests.tools.benchmarks.figure import Figure, Settings
from tests.tools.benchmarks.scara import case

WORKERS = 2
MEMORY_MB = 8000.0
CASE = ROOT / "examples/scara/identify_200hz.yaml"


def scara(out: Path, seeds: int) -> Campaign:
    """SCARA, torque at 10 Hz, one case."""
    vary = {"train.torque.rate_hz": [10], "validation.torque.rate_hz": [10]}
    return study(CASE, vary=vary, seeds=seeds, noise={"relative": 0.05}, out=out)


def _bare(tasks: Sequence[Task]) -> float:
    """Seconds for the identifications alone, one after the other in this process; data and case are there before."""
    process = SimpleNamespace()
    start_worker(process, MEMORY_MB)
    cases = [prepared(process.state, task)[0] for task in tasks]
    identify(prepared(process.state, tasks[0])[0])
    started = time.perf_counter()
    while cases:
        identify(cases.pop())  # what a case keeps of its runs goes with it, as in a worker
    return time.perf_counter() - started


def run(settings: Settings) -> list[Figure]:
    """Start and validation are not counted on either side; overheads are medians over single runs."""
    case()  # what is built is in the cache before two processes ask for it
    count = settings.size(100, 4, 1000)
    with tempfile.TemporaryDirectory() as folder:
        found = scara(Path(folder) / "run", count)
        tasks = [task_of(found.plan, run) for run in found.plan.runs]
        with multiprocessing.get_context("spawn").Pool(WORKERS) as pool:
            bare = max(pool.map(_bare, [tasks[k::WORKERS] for k in range(WORKERS)], chunksize=1))
        last: list[Progress] = []
        found.run(workers=WORKERS, progress=last.append)
        figures = [_efficiency(count, bare, last[-1].elapsed), _overhead(found, Path(folder), min(count, 50))]
        return figures + _planned(Path(folder), settings.size(100_000, 500))


def _efficiency(count: int, bare: float, campaign: float) -> Figure:
    name = f"{count} SCARA runs, two bare processes / campaign with two workers"
    return Figure(name, bare / campaign, 0.9, "at least", {"bare_s": bare, "campaign_s": campaign})


def _overhead(found: Campaign, folder: Path, count: int) -> Figure:
    """What a run costs beside ``identify``: its data, the way to the worker and back, the journal."""
    worker, outside = RunWorker(folder / "overhead", found.plan.document.limits), []
    process = SimpleNamespace()
    start_worker(process, MEMORY_MB)
    inside = []
    try:
        for run in found.plan.runs[:count]:
            task = task_of(found.plan, run)
            started = time.perf_counter()
            row = worker.run(task)
            worker.journal.write(row)
            outside.append(time.perf_counter() - started - row["seconds"])
            started = time.perf_counter()
            prepared(process.state, task)
            inside.append(time.perf_counter() - started)
    finally:
        worker.close()
        worker.journal.close()
    way, data = 1e3 * statistics.median(outside), 1e3 * statistics.median(inside)
    medians = {"way_and_journal_ms": way, "data_ms": data}
    return Figure("a run beside its identification, ms", way + data, 5.0, "at most", medians)


def _planned(folder: Path, count: int) -> list[Figure]:
    """Seconds of the processor for a plan of so many runs, its status, its report; rows are made up."""
    vary = {"loop.delay_samples": list(np.linspace(0, 1, 10)), "noise.relative": list(np.linspace(0.01, 0.2, 10))}
    started = time.process_time()
    many = study(CASE, vary=vary, seeds=count // 100, noise={}, out=folder / "many")
    runs = many.plan.runs
    planned = time.process_time() - started
    store, journal = Store(many.out), Journal(many.out)
    store.begin(many.plan)
    p = {"unit": "kg", "std": 1.0, "low": -1.0, "high": 1.0, "true": 0.0}
    values = np.random.default_rng(0).normal(size=(len(runs), 8)).tolist()
    for run, row in zip(runs, values, strict=True):
        entries = [{"name": f"p{k}", "value": value, **p} for k, value in enumerate(row)]
        head = {"id": run.id, "status": "answered", "verdict": "valid", "attempt": 1, "started": "2026"}
        journal.write({**head, "parameters": entries})
        journal.end_chunk()
    journal.seal()
    started = time.process_time()
    assert status_of(store).open == 0
    told = time.process_time() - started
    started = time.process_time()
    write_campaign_report(Results(store))
    return [
        Figure(f"{len(runs)} runs planned, s of the processor", planned, 10.0),
        Figure(f"status of {len(runs)} runs, s of the processor", told, 2.0),
        Figure(f"report of {len(runs)} runs, s of the processor", time.process_time() - started, 30.0),
    ]
