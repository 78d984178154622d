"""Slots of an FMU: how many runs of this machine may use it at the same time, in all processes together."""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from fmu_didim.base.cache import cache_directory, reported_as_input_error
from fmu_didim.base.files import file_permissions, made

SLOT_POLL_S = 0.05
"""[s] Interval between two attempts to get a slot: short compared with a chunk of runs."""


def sources_of(case: Mapping[str, Any]) -> set[str]:
    """The sources of the plant, the controller and the further components of a case, or of its model."""
    parts = [case.get("plant"), case.get("controller"), case.get("model"), *(case.get("components") or {}).values()]
    return {str(part["source"]) for part in parts if isinstance(part, Mapping) and part.get("source")}


@contextmanager
def fmu_slots(files: Mapping[Path, int], is_over: Callable[[], bool]) -> Iterator[None]:
    """Wait for a slot of each FMU with a limited number of instances, and hold it.

    A slot is a locked file in the cache, so it becomes free when the process that holds it ends, in whatever way. All
    processes take slots in the same order, so that there is no deadlock.

    Args:
        files: FMU -> most runs that use it; is_over: whether to stop waiting.
    """
    with ExitStack() as held:
        for place, count in sorted((_place(file), count) for file, count in files.items()):
            with reported_as_input_error(place):
                made(made(place.parent) / place.name)
            with suppress(PermissionError):  # another user's, in a folder that is not shared
                os.utime(place)  # used
            while not is_over():
                slot = _free_slot(place, count)
                if slot is not None:
                    held.callback(slot.release)
                    break
                time.sleep(SLOT_POLL_S)
        yield


def _place(file: Path) -> Path:
    """The folder with the slots of a file."""
    key = hashlib.sha256(str(file.resolve()).encode()).hexdigest()[:16]
    return cache_directory() / "fmu_slots" / key


def _free_slot(place: Path, count: int) -> FileLock | None:
    """A slot that was free and is now held; None if all are taken."""
    for k in range(count):
        lock = FileLock(place / f"{k}.lock", mode=file_permissions(place), thread_local=False)
        with reported_as_input_error(place), suppress(Timeout):
            lock.acquire(timeout=0)
            return lock
    return None
