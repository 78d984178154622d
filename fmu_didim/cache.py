"""Where compiled and extracted files are kept between runs."""

from __future__ import annotations

import errno
import hashlib
import json
import logging
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import platformdirs

from fmu_didim.errors import InputError

COMPILER = "zig"
KINDS = {
    "exported": "FMUs built by this package",
    "extracted": "FMUs, extracted",
    "compiled": "libraries of FMUs that hold sources",
    "ssp": "SSP archives, extracted",
    "loop": "the compiled loop",
    "variational": "compiled sensitivities",
    "reruns": "how FMUs are run again",
    "probes": "how FMUs behave",
    "proofs": "which FMUs of other tools have run to a good end",
    "seats": "which runs use an FMU at the same time",
    COMPILER: "parts of the C compiler",
}
"""What is kept: folder -> what it holds. The names of entries that belong to an FMU begin with its SHA-256."""
LIMIT = 5 * 2**30
"""Bytes from which on the oldest entries leave: some hundred FMUs with their libraries, and bearable on any disk."""
IN_USE = 7 * 24 * 3600.0
"""Seconds for which an entry stays after its last use: it may belong to a run that goes on, a week at most."""
_CHECKED_EVERY = 3600.0
_LAYOUT = ".2"
"""End of the names of folders: other releases, which keep them otherwise, share the cache."""
_CONTENT, _LIST = "content", "files.json"
_log = logging.getLogger(__name__)
_compared: set[Path] = set()
OF_NAMES = (errno.ENAMETOOLONG, errno.EISDIR, errno.EINVAL, errno.EILSEQ)
"""Errors of the system by which it refuses a name, and not the writing."""
PARTIAL = ".partial-"
"""How the names of files and folders begin that are being written."""
STALE = 2 * 3600.0
"""Seconds after which they are given up: four times as long as a compilation may take."""


def cache_directory() -> Path:
    """The folder named by ``FMU_DIDIM_CACHE``, else the user's cache folder; made if absent.

    Raises:
        InputError: it cannot be made.
    """
    named = os.environ.get("FMU_DIDIM_CACHE")
    with _told(named or "the user's cache folder"):
        try:
            path = Path(named) if named else platformdirs.user_cache_path("fmu_didim")
        except RuntimeError as error:  # there is no home folder
            raise OSError(str(error)) from error
        path.mkdir(parents=True, exist_ok=True)
        return path


@contextmanager
def _told(where: Path | str) -> Iterator[None]:
    """What hinders the writing there as an InputError."""
    try:
        yield
    except OSError as error:
        if error.errno in OF_NAMES:
            raise  # by the names of what is written, such as those in an archive
        raise InputError(
            "The cache of compiled and extracted files cannot be written.", where=str(where), got=str(error),
            next_step="Make room (fmu-didim cache clear), or set FMU_DIDIM_CACHE to another folder.",
        ) from error  # fmt: skip


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
    """A folder of the cache, filled once by ``fill`` and moved into place as a whole.

    A list of its files with size and SHA-256 lies beside it: sizes are compared whenever it is asked for, contents once
    in a process, and what is damaged is thrown away and filled anew. Several processes may ask at the same time: each
    fills a folder of its own, the first one stays. Where the cache has grown too large, what was not asked for longest
    goes.

    Args:
        kind: one of KINDS.

    Raises:
        InputError: the cache cannot be written; what ``fill`` raises.
    """
    entry = cache_directory() / kind / f"{key}{_LAYOUT}"
    if _is_whole(entry):
        with suppress(OSError):
            os.utime(entry)  # used
        return entry / _CONTENT
    with _told(entry.parent):
        entry.parent.mkdir(parents=True, exist_ok=True)
        remove_stale(entry.parent)
        partial = Path(tempfile.mkdtemp(prefix=PARTIAL, dir=entry.parent))
        try:
            (partial / _CONTENT).mkdir()
            fill(partial / _CONTENT)
            _write_list(partial)
            _put(partial, entry)
        finally:
            shutil.rmtree(partial, ignore_errors=True)
    limit_size()
    return entry / _CONTENT


def _put(partial: Path, entry: Path) -> None:
    """Move a filled folder to its place, in which a damaged one may be, or that of a process that was faster."""
    try:
        partial.rename(entry)
    except OSError:
        if _is_whole(entry):
            return  # looked at after the move has failed: what came in between is never taken for damaged
        if not entry.exists():
            raise
        _log.info("%s of the cache is damaged and was made anew", entry)
        remove_entry(entry)
        partial.rename(entry)
    sync(entry.parent)


def _write_list(entry: Path) -> None:
    """List the files of an entry, and bring all of them to the disk."""
    content, listed = entry / _CONTENT, {}
    for path in sorted(content.rglob("*")):
        sync(path)
        if path.is_file():
            listed[path.relative_to(content).as_posix()] = [path.stat().st_size, file_digest(path)]
    (entry / _LIST).write_text(json.dumps(listed), encoding="utf-8")
    for path in (entry / _LIST, content, entry):
        sync(path)


def _is_whole(entry: Path) -> bool:
    """Whether all files of an entry are as they were written; others may have come, by an FMU that writes there."""
    try:
        listed = json.loads((entry / _LIST).read_text(encoding="utf-8"))
        for name, (size, digest) in listed.items():
            path = entry / _CONTENT / name
            if path.stat().st_size != size or (entry not in _compared and file_digest(path) != digest):
                return False
    except (OSError, ValueError, TypeError, AttributeError):
        return False
    _compared.add(entry)
    return True


def remove_entry(entry: Path) -> None:
    """Remove a file or folder of the cache; nobody sees half of it."""
    aside = Path(tempfile.mkdtemp(prefix=PARTIAL, dir=entry.parent))
    with suppress(FileNotFoundError):  # another process was faster
        entry.rename(aside / entry.name)
    _compared.discard(entry)
    shutil.rmtree(aside, ignore_errors=True)


@dataclass(frozen=True)
class Entry:
    """A file or folder of the cache; used: when it was last asked for, in s since 1970."""

    path: Path
    kind: str
    size: int
    used: float


def entries(digest: str = "", *, kinds: Iterable[str] = KINDS) -> Iterator[Entry]:
    """What the cache holds: of the FMU with this SHA-256, or all."""
    root = cache_directory()
    for kind in kinds:
        for path in (root / kind).glob(f"{digest}*"):
            if path.name.startswith(PARTIAL):
                continue
            with suppress(OSError):  # another process has removed it
                files = [path, *path.rglob("*")] if path.is_dir() else [path]
                size = sum(file.stat().st_size for file in files if file.is_file())
                yield Entry(path, kind, size, path.stat().st_mtime)


def limit_size() -> None:
    """Remove what was not used for longest where the cache is too large; looked at once in an hour."""
    stamp = cache_directory() / ".size_checked"
    with suppress(OSError):
        if stamp.is_file() and time.time() - stamp.stat().st_mtime < _CHECKED_EVERY:
            return
        stamp.touch()
        limited = [kind for kind in KINDS if kind != COMPILER]
        found = sorted(entries(kinds=limited), key=lambda entry: entry.used)
        size = sum(entry.size for entry in found)
        for entry in found:
            if size <= LIMIT or time.time() - entry.used < IN_USE:
                return
            remove_entry(entry.path)
            size -= entry.size
