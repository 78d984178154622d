"""Where compiled and extracted files are kept between runs."""

from __future__ import annotations

import hashlib
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import platformdirs


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
    with tempfile.NamedTemporaryFile(dir=path.parent, prefix=f".{path.name}.", delete=False) as stream:
        temporary = Path(stream.name)
    try:
        yield temporary
        temporary.chmod(0o644)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def cached_folder(kind: str, key: str, fill: Callable[[Path], None]) -> Path:
    """The folder ``<cache>/<kind>/<key>``, filled once by ``fill`` and moved into place as a whole.

    Several processes may ask at the same time: each fills a folder of its own, the first one stays.
    """
    target = cache_directory() / kind / key
    if target.is_dir():
        return target
    target.parent.mkdir(parents=True, exist_ok=True)
    partial = Path(tempfile.mkdtemp(prefix=".partial-", dir=target.parent))
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
