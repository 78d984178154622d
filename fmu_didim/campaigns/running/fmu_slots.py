"""Seats: how many runs of this machine may use an FMU at the same time, whichever process they are in."""

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

SEAT_POLL_S = 0.05
"""[s] Between two looks for a free seat of an FMU: little beside a chunk of runs."""


def sources_of(case: Mapping[str, Any]) -> set[str]:
    """What a case names as sources of its plant, its controller and its further components."""
    parts = [case.get("plant"), case.get("controller"), *(case.get("components") or {}).values()]
    return {str(part["source"]) for part in parts if isinstance(part, Mapping) and part.get("source")}


@contextmanager
def seats(files: Mapping[Path, int], is_over: Callable[[], bool]) -> Iterator[None]:
    """Wait for a seat of each FMU of which few runs are allowed, and hold it.

    A seat is a locked file in the cache, so it is free again when the process that has it ends, in whatever way. Seats
    are taken in one order everywhere, so that two that wait never wait for each other.

    Args:
        files: FMU -> most runs that use it; is_over: whether the wait is to be given up.
    """
    with ExitStack() as held:
        for place, count in sorted((_place(file), count) for file, count in files.items()):
            with reported_as_input_error(place):
                made(made(place.parent) / place.name)
            with suppress(PermissionError):  # another user's, in a folder that is not shared
                os.utime(place)  # used
            while not is_over():
                seat = _free_seat(place, count)
                if seat is not None:
                    held.callback(seat.release)
                    break
                time.sleep(SEAT_POLL_S)
        yield


def _place(file: Path) -> Path:
    """The folder with the seats of a file."""
    key = hashlib.sha256(str(file.resolve()).encode()).hexdigest()[:16]
    return cache_directory() / "seats" / key


def _free_seat(place: Path, count: int) -> FileLock | None:
    """A seat that nobody had, now held; None if all are taken."""
    for k in range(count):
        lock = FileLock(place / f"{k}.lock", mode=file_permissions(place), thread_local=False)
        with reported_as_input_error(place), suppress(Timeout):
            lock.acquire(timeout=0)
            return lock
    return None
