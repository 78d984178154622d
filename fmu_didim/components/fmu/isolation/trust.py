"""Which FMUs of other tools have run a loop and ended as they should, so that they may run in this process.

The proof of an FMU is a file of the cache under its content, written when a process of its own in which it ran has
ended without an error. While it runs in an ordinary process a mark lies beside it: where the mark outlives its process,
that one was ended abruptly, perhaps by the FMU, and the proof is taken back.
"""

from __future__ import annotations

import atexit
import contextlib
import logging
import os
import sys
from pathlib import Path

from fmu_didim.base.cache import cache_directory, cache_file, is_trusted
from fmu_didim.components.fmu.settings import FmuSettings

_log = logging.getLogger(__name__)
_marks: dict[Path, Path] = {}


def is_proven(component: FmuSettings, instances: int = 1) -> bool:
    """Whether so many instances have run in a process of their own to a good end, and no process has died since."""
    path = _path(component)
    if _proven(path) < instances:
        return False
    if path in _marks:
        return True
    dead = [mark for mark in path.parent.glob(f"{path.name}.running-*") if not _is_alive(mark)]
    if not dead:
        return True
    _log.warning(
        "%s: a process in which it ran ended abruptly, so it runs in one of its own again ('isolated: false' beside "
        "its source, if you trust it).", component.path.name,
    )  # fmt: skip
    for file in (path, *dead):
        with contextlib.suppress(PermissionError):  # another user's
            file.unlink(missing_ok=True)
    return False


def prove(component: FmuSettings, instances: int = 1) -> None:
    """Note that a process of its own in which so many instances ran at once has come to a good end."""
    path = _path(component)
    if _proven(path) >= instances:
        return
    with contextlib.suppress(OSError), cache_file(path) as temporary:  # without a proof it only runs apart again
        temporary.write_text(str(instances), encoding="ascii")


def _proven(path: Path) -> int:
    """Instances at once that have been seen to run; 0 if none."""
    try:
        return int(path.read_text(encoding="ascii")) if is_trusted(path) else 0
    except (OSError, ValueError):
        return 0


def runs_here(component: FmuSettings) -> None:
    """Mark that a proven FMU runs in this process, until this ends in order."""
    path = _path(component)
    if path in _marks or sys.platform == "win32" or not path.is_file():
        return
    mark = path.with_name(f"{path.name}.running-{os.getpid()}")
    with contextlib.suppress(OSError):
        mark.touch()
        _marks[path] = mark


@atexit.register
def _unmark() -> None:
    for mark in _marks.values():
        with contextlib.suppress(OSError):
            mark.unlink(missing_ok=True)


def _path(component: FmuSettings) -> Path:
    return cache_directory() / "proofs" / f"{component.digest}-{component.interface.kind}"


def _is_alive(mark: Path) -> bool:
    """Whether the process of a mark still runs."""
    try:
        os.kill(int(mark.name.rpartition("-")[2]), 0)
    except ProcessLookupError:
        return False
    except (OSError, ValueError):
        return True
    return True
