"""Where compiled and extracted files are kept between runs."""

from __future__ import annotations

import hashlib
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import platformdirs

PARTIAL = ".partial-"
"""How the names of files and folders begin that are being written."""
STALE = 2 * 3600.0
"""Seconds after which they are given up: four times as long as a compilation may take."""


def cache_directory() -> Path:
    """The folder named by ``FMU_DIDIM_CACHE``, else the user's cache folder; made if absent."""
    named = os.environ.get("FMU_DIDIM_CACHE")
    path = Path(named) if named else platformdirs.user_cache_path("fmu_didim")
    path.mkdir(parents=True, exist_ok=True)
    return path


def file_digest(path: Path) -> str:
    """SHA-256 of a file."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A file to write, which then takes the place of ``path``: nobody sees half of it."""
    with tempfile.NamedTemporaryFile(dir=path.parent, prefix=PARTIAL, suffix=path.name, delete=False) as stream:
        temporary = Path(stream.name)
    try:
        yield temporary
        temporary.chmod(0o644)
        sync(temporary)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def sync(path: Path) -> None:
    """Bring what was written to a file, or the names in a folder, to the disk; a power cut does not empty it then."""
    if path.is_dir():
        with suppress(OSError):  # not every system can: Windows does not open folders
            _sync(path, os.O_RDONLY)
    else:
        _sync(path, os.O_RDWR)


def _sync(path: Path, flags: int) -> None:
    handle = os.open(path, flags)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def remove_stale(folder: Path) -> None:
    """Remove what processes that were killed left half written in a folder."""
    for path in folder.glob(f"{PARTIAL}*"):
        with suppress(OSError):
            if time.time() - path.stat().st_mtime < STALE:
                continue
            if path.is_dir():
                shutil.rmtree(path)
            else:
                path.unlink()


def cached_folder(kind: str, key: str, fill: Callable[[Path], None]) -> Path:
    """The folder ``<cache>/<kind>/<key>``, filled once by ``fill`` and moved into place as a whole.

    Several processes may ask at the same time: each fills a folder of its own, the first one stays.
    """
    target = cache_directory() / kind / key
    if target.is_dir():
        return target
    target.parent.mkdir(parents=True, exist_ok=True)
    partial = Path(tempfile.mkdtemp(prefix=PARTIAL, dir=target.parent))
    try:
        fill(partial)
        try:
            partial.rename(target)
        except OSError:
            if not target.is_dir():
                raise
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return target
