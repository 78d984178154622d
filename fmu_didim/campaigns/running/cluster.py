"""A Dask cluster as the engine of a campaign.

Dask holds no results: finished runs are in the folder of the campaign, which all workers share. A lost scheduler costs
only the runs in progress.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from pathlib import Path

from fmu_didim.base.errors import InputError, loading

SCHEDULER_S = 30.0
"""[s] Time for a scheduler to answer, or to write its file."""
WORKERS_S = 60.0
"""[s] Time for the first worker of a cluster to start."""


@contextmanager
def cluster(address: str) -> Iterator[tuple[Executor, int]]:
    """An executor on a cluster, and how many chunks it runs at once.

    Args:
        address: ``tcp://host:port``, or the scheduler file.

    Raises:
        InputError: distributed is not installed, or no worker answers.
    """
    absent = InputError(
        "A cluster needs Dask.", next_step="Install it here and on the workers: pip install 'fmu_didim[cluster]'."
    )
    with loading("distributed", absent=absent):
        from distributed import Client
    try:
        if "://" in address:
            client = Client(address, timeout=SCHEDULER_S)
        else:
            _wait_for(Path(address))
            client = Client(scheduler_file=address, timeout=SCHEDULER_S)
    except (OSError, ValueError) as error:
        raise InputError(
            "No scheduler answers there.", where=address, got=str(error)[:200],
            next_step="Start one (dask scheduler) and workers (dask worker ADDRESS), or leave --scheduler out.",
        ) from error  # fmt: skip
    try:
        client.wait_for_workers(1, timeout=WORKERS_S)
        yield client.get_executor(pure=False, retries=2), max(1, sum(client.nthreads().values()))
    except TimeoutError as error:
        raise InputError(
            "The cluster has no workers.", where=address, got=f"none within {WORKERS_S:g} s",
            next_step="Start some: dask worker ADDRESS.",
        ) from error  # fmt: skip
    finally:
        client.close(timeout=5)


def _wait_for(file: Path) -> None:
    """Wait for the file of a scheduler that is just starting; raises FileNotFoundError."""
    limit = time.monotonic() + SCHEDULER_S
    while not file.is_file():
        if time.monotonic() > limit:
            raise FileNotFoundError(f"the file {file} does not appear")
        time.sleep(0.1)
