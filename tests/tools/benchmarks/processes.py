"""Many identifications of the SCARA in two processes and in one."""

from __future__ import annotations

import multiprocessing
import os
import time
from multiprocessing.pool import Pool

from tests.tools.benchmarks.figure import Figure, Settings
from tests.tools.monte_carlo import Design, context, one_seed

RATE_HZ = 10


def _ready(_: int) -> int:
    """The process that did this, its imports and FMUs loaded."""
    context(RATE_HZ)
    one_seed(Design(RATE_HZ), 0)
    time.sleep(0.05)
    return os.getpid()


def _warm(pool: Pool, processes: int) -> None:
    """Until every process of the pool is ready."""
    seen: set[int] = set()
    while len(seen) < processes:
        seen.update(pool.map(_ready, range(processes), chunksize=1))


def _spin(_: int) -> int:
    """Arithmetic alone, for what two processes give on this machine at this time."""
    return sum(i * i for i in range(200_000))


def run(settings: Settings) -> list[Figure]:
    """Processes are started and warm before the clock runs; each identification has its own noise."""
    count = settings.size(60, 4, 1000)
    context(RATE_HZ)  # what is built is in the cache before two processes ask for it
    seconds, bare = {}, {}
    for processes in (1, 2):
        begin = time.perf_counter()
        with multiprocessing.get_context("spawn").Pool(processes) as pool:
            _warm(pool, processes)
            start = time.perf_counter() - begin
            begin = time.perf_counter()
            found = pool.starmap(
                one_seed, [(Design(RATE_HZ), seed) for seed in range(count)], chunksize=max(1, count // 20)
            )
            seconds[processes] = time.perf_counter() - begin
            begin = time.perf_counter()
            pool.map(_spin, range(100), chunksize=5)
            bare[processes] = time.perf_counter() - begin
        assert len(found) == count
    return [
        Figure(
            f"{count} SCARA identifications, 1 process / 2 processes", seconds[1] / seconds[2], 1.8, "at least",
            {
                "one_process_s": seconds[1], "two_processes_s": seconds[2], "start_of_two_s": start,
                "bare_arithmetic_speed_up": bare[1] / bare[2],
            },
            f"{os.cpu_count()} cores; the start of the processes is not counted",
        )
    ]  # fmt: skip
