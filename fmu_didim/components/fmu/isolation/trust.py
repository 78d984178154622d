"""FMUs of other tools that may run in this process: those whose loop has run without error before.

A record in the cache, under the content of the FMU, states how many instances of it ran at once in a process of its own
that ended without an error. While it runs in an ordinary process a mark lies beside that record: a mark that outlives
its process shows that it ended abruptly, perhaps by the FMU, and the record is removed.
"""

from __future__ import annotations

import atexit
import contextlib
import logging
import os
import sys
from pathlib import Path

from fmu_didim.base.cache import cache_directory, read_record, write_record
from fmu_didim.base.files import is_running
from fmu_didim.components.fmu.settings import PROCESS, FmuSettings, Rerun

_log = logging.getLogger(__name__)
_marks: dict[Path, Path] = {}
_logged: set[Path] = set()


def is_trusted(component: FmuSettings, instances: int = 1) -> bool:
    """Whether so many instances have run in a process of their own that ended well, and no process has died since."""
    path = _path(component)
    if _instances(path) < instances:
        return False
    abandoned = [] if path in _marks else [m for m in path.parent.glob(f"{path.name}.running-*") if not _is_alive(m)]
    if not abandoned:
        return True
    _log.warning(
        "%s: a process in which it ran ended abruptly, so it runs in one of its own again ('isolated: false' beside "
        "its source, if you trust it).", component.path.name,
    )  # fmt: skip
    for file in (path, *abandoned):
        with contextlib.suppress(PermissionError):  # another user's
            file.unlink(missing_ok=True)
    return False


def record_trust(component: FmuSettings, instances: int = 1) -> None:
    """Record that a process of its own in which so many instances ran at once has ended well."""
    path = _path(component)
    if _instances(path) < instances:
        write_record(path, {"instances": instances})


def mark_running(component: FmuSettings) -> None:
    """Mark that a trusted FMU runs in this process; the mark goes when the process ends normally."""
    path = _path(component)
    if path in _marks or sys.platform == "win32" or not path.is_file():
        return
    mark = path.with_name(f"{path.name}.running-{os.getpid()}")
    with contextlib.suppress(OSError):
        mark.touch()
        _marks[path] = mark


def log_isolation(component: FmuSettings, rerun: Rerun | None) -> None:
    """Log, once in a process, why an FMU runs in a process of its own, what that costs, and the remedy.

    Args:
        rerun: how it is run again, if that needs the process; None if it has not run here before.
    """
    path = _path(component)
    if path in _logged:
        return
    _logged.add(path)
    if rerun is None:
        level, text = logging.INFO, (
            "has not run on this machine before: its loop runs in a process of its own this time, which takes about a "
            "second to start ('isolated: false' beside its source, if you trust it)."
        )  # fmt: skip
    else:
        cost = "a new process, about a second, for each run" if rerun.strategy == PROCESS else "a second to start"
        level, text = logging.WARNING, (
            f"runs in a process of its own, by '{rerun.strategy}': {rerun.reason}. That costs {cost}. "
            "If you know better, say so beside its source: 'isolated: false', and 'rerun' for how to run it again."
        )  # fmt: skip
    _log.log(level, "%s %s", component.path.name, text)


@atexit.register
def _remove_marks() -> None:
    for mark in _marks.values():
        with contextlib.suppress(OSError):
            mark.unlink(missing_ok=True)


def _path(component: FmuSettings) -> Path:
    return cache_directory() / "proofs" / f"{component.digest}-{component.interface.kind}"


def _instances(path: Path) -> int:
    """Instances at once that have run well."""
    count = (read_record(path) or {}).get("instances")
    return count if isinstance(count, int) else 0


def _is_alive(mark: Path) -> bool:
    """Whether the process of a mark still runs."""
    process = mark.name.rpartition("-")[2]
    return not process.isdecimal() or is_running(int(process))
