"""The cache of compiled and extracted files."""

from __future__ import annotations

import errno
import hashlib
import json
import logging
import os
import shutil
import stat
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import platformdirs

from fmu_didim.base.errors import InputError
from fmu_didim.base.files import (
    HAS_OWNERS,
    HELD,
    PARTIAL,
    advice,
    follow,
    made,
    owner,
    partial_folder,
    patiently,
    remove_stale,
    sync,
    whole_file,
)

VARIABLE = "FMU_DIDIM_CACHE"
"""Of the environment: the folder of the cache."""

COMPILER = "zig"
KINDS = {
    "exported": "FMUs built by this package",
    "extracted": "FMUs, extracted",
    "compiled": "libraries of FMUs that hold sources",
    "ssp": "SSP archives, extracted",
    "loop": "the compiled loop",
    "variational": "compiled sensitivities",
    "reruns": "how FMUs are run again",
    "readings": "what reading their outputs before a step does",
    "starts": "what says where the states of FMUs start",
    "proofs": "which FMUs of other tools have run and ended well",
    "templates": "compiled templates of pages",
    "fmu_slots": "which runs use an FMU at the same time",
    COMPILER: "parts of the C compiler",
}
"""Folder of the cache -> its content. The names of entries that belong to an FMU begin with its SHA-256."""
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


def cache_directory() -> Path:
    """The folder named by ``FMU_DIDIM_CACHE``, else the user's cache folder; made if absent.

    If the user's cannot be written, a folder for temporary files that belongs to this user alone; a warning is logged.

    Raises:
        InputError: the one that was named cannot be made, or none can.
    """
    if named := os.environ.get(VARIABLE):
        with reported_as_input_error(Path(named)):
            Path(named).mkdir(parents=True, exist_ok=True)
        return Path(named)
    try:
        path = platformdirs.user_cache_path("fmu_didim")
        path.mkdir(parents=True, exist_ok=True)
        if not os.access(path, os.W_OK | os.X_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
    except (OSError, RuntimeError) as error:  # RuntimeError: there is no home folder
        return _temporary(error)
    return path


def _temporary(why: Exception) -> Path:
    """A private folder in that for temporary files; this process and those that it starts keep to it."""
    with reported_as_input_error(Path("the user's cache folder")):
        path = Path(tempfile.gettempdir()) / f"fmu_didim{f'-{os.getuid()}' if HAS_OWNERS else ''}"
        with suppress(FileExistsError):
            path.mkdir(0o700)
        found = path.lstat()
        own = not HAS_OWNERS or (found.st_uid == os.getuid() and not found.st_mode & 0o077)
        if not own or not stat.S_ISDIR(found.st_mode):
            raise PermissionError(errno.EACCES, "others may write there", str(path))
    _log.warning(
        "The cache folder cannot be written (%s): %s takes its place; %s names another one.", why, path, VARIABLE
    )
    os.environ[VARIABLE] = str(path)
    return path


@contextmanager
def reported_as_input_error(where: Path) -> Iterator[None]:
    """Report what prevents writing there as an InputError."""
    try:
        yield
    except OSError as error:
        if error.errno in OF_NAMES:
            raise  # by the names of what is written, such as those in an archive
        step = f"Make room (fmu-didim cache clear), or set {VARIABLE} to another folder."
        got = str(error)
        if isinstance(error, PermissionError):
            other = _other_owner(Path(error.filename)) if error.filename else ""
            got += f" (it belongs to {other})" if other else ""
            step = f"Set {VARIABLE} to another folder, or have its permissions changed."
        raise InputError(
            "The cache of compiled and extracted files cannot be written.", where=str(where), got=got,
            next_step=advice(error, step, place=f"another folder by {VARIABLE}"),
        ) from error  # fmt: skip


def _other_owner(path: Path) -> str:
    """To whom the nearest part of a path that exists belongs; "" where that is this user."""
    for place in (path, *path.parents):
        with suppress(OSError):
            return owner(place) if HAS_OWNERS and place.lstat().st_uid != os.getuid() else ""
    return ""


def own_folder(kind: str) -> Path:
    """A folder of a kind for this user alone: for programs that write there with permissions of their own.

    Raises:
        InputError: it cannot be made, or another user has made it.
    """
    path = cache_directory() / kind / (str(os.getuid()) if HAS_OWNERS else "own")
    with reported_as_input_error(path):
        made(made(path.parent) / path.name)
    _check_foreign(path)
    return path


@contextmanager
def cache_file(path: Path) -> Iterator[Path]:
    """A file, written as a whole (:func:`fmu_didim.base.files.whole_file`), with the permissions of the cache."""
    with whole_file(made(path.parent) / path.name) as temporary:
        yield temporary
        follow(temporary, path.parent)


def read_record(path: Path) -> dict[str, Any] | None:
    """The mapping that :func:`write_record` wrote; None if it is missing, damaged, or written by a user who is not
    trusted."""
    try:
        found = json.loads(path.read_text(encoding="utf-8")) if is_trusted(path) else None
    except (OSError, ValueError):
        return None
    return found if isinstance(found, dict) else None


def write_record(path: Path, record: Mapping[str, Any]) -> None:
    """Write a mapping as JSON; without effect where the cache cannot be written, as it can be found out again."""
    with suppress(OSError), cache_file(path) as temporary:
        temporary.write_text(json.dumps(record), encoding="utf-8")


def is_trusted(path: Path) -> bool:
    """Whether an entry was written by this user, root, the owner of the cache, or its group where that is setgid.

    Code of others would run as this user. Where others may write, a group proves nothing: it is that of the folder,
    whoever writes. Raises FileNotFoundError where there is no entry.
    """
    if not HAS_OWNERS:
        return True
    root, kind, entry = path.parents[1].stat(), path.parent.lstat(), path.lstat()
    is_closed = not any(place.st_mode & stat.S_IWOTH for place in (root, kind, entry))
    group = root.st_gid if root.st_mode & stat.S_ISGID and is_closed else None
    return all(
        place.st_uid in (os.getuid(), 0, root.st_uid) or (group is not None and place.st_gid == group)
        for place in (kind, entry)
    )


def _check_foreign(entry: Path) -> None:
    """Raise InputError if an entry of another user is not to be taken, or cannot be read."""
    other = _other_owner(entry)
    try:
        trusted, readable = is_trusted(entry), not other or _is_readable(entry)
    except FileNotFoundError:
        return
    except PermissionError:
        trusted, readable = True, False
    step = f"Set {VARIABLE} to a folder of your own"
    if not trusted:
        raise InputError(
            "An entry of the cache was written by another user, and its code would run as you.", where=str(entry),
            got=f"it belongs to {other}", valid="entries of yours, of root, of the owner of the cache, or, where the "
            "folder of the cache is setgid, of its group",
            next_step=f"{step}; or share it with a group that you trust: chmod g+ws,o-w {entry.parents[1]}",
        )  # fmt: skip
    if not readable:
        raise InputError(
            "An entry of the cache belongs to another user and cannot be read.", where=str(entry),
            got=f"it belongs to {other}", next_step=f"{step}; or ask {other} to run: chmod -R g+rwX {entry}",
        )  # fmt: skip


def _is_readable(entry: Path) -> bool:
    if not entry.is_dir():
        return os.access(entry, os.R_OK)
    listed = entry / _LIST
    return os.access(entry, os.R_OK | os.X_OK) and (not listed.exists() or os.access(listed, os.R_OK))


def file_digest(path: Path) -> str:
    """SHA-256 of a file."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def cached_folder(kind: str, key: str, fill: Callable[[Path], None]) -> Path:
    """A folder of the cache, filled once by ``fill`` and moved into place as a whole.

    A list of its files with size and SHA-256 lies beside it: sizes are compared whenever it is asked for, contents once
    in a process, and a damaged folder is removed and filled again. Several processes may ask at the same time: each
    fills a folder of its own, the first one stays. Where the cache has grown too large, what was not asked for longest
    goes.

    Args:
        kind: one of KINDS.

    Raises:
        InputError: the cache cannot be written; what ``fill`` raises.
    """
    entry = cache_directory() / kind / f"{key}{_LAYOUT}"
    _check_foreign(entry)
    if _is_whole(entry):
        with suppress(OSError):
            os.utime(entry)  # used
        return entry / _CONTENT
    with reported_as_input_error(entry.parent):
        remove_stale(made(entry.parent))
        partial = partial_folder(entry.parent)
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
        patiently(lambda: partial.rename(entry))
    except OSError:
        _check_foreign(entry)
        if _is_whole(entry):
            return  # looked at after the move has failed: what came in between is never taken for damaged
        if not entry.exists():
            raise
        _log.info("%s in the cache was damaged and was made again", entry)
        remove_entry(entry)
        patiently(lambda: partial.rename(entry))
    sync(entry.parent)


def _write_list(entry: Path) -> None:
    """List the files of an entry, bring all of them to the disk, and share them as the folder of the kind is shared."""
    content, listed = entry / _CONTENT, {}
    for path in sorted(content.rglob("*")):
        follow(path, entry.parent)
        sync(path)
        if path.is_file():
            listed[path.relative_to(content).as_posix()] = [path.stat().st_size, file_digest(path)]
    (entry / _LIST).write_text(json.dumps(listed), encoding="utf-8")
    for path in (entry / _LIST, content, entry):
        follow(path, entry.parent)
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
    """Remove a file or folder of the cache; no process finds half of it.

    Raises:
        OSError: another user keeps it, or on Windows a program that has loaded it; then it is as it was.
    """
    aside = partial_folder(entry.parent)
    try:
        with suppress(FileNotFoundError):  # another process was faster
            entry.rename(aside / entry.name)
        _compared.discard(entry)
    finally:
        shutil.rmtree(aside, ignore_errors=True)


@dataclass(frozen=True)
class Entry:
    """A file or folder of the cache; used: when it was last asked for, in s since 1970."""

    path: Path
    kind: str
    size: int
    used: float


def entries(digest: str = "", *, kinds: Iterable[str] = KINDS) -> Iterator[Entry]:
    """The entries of the cache: of the FMU with this SHA-256, or all."""
    root = cache_directory()
    for kind in kinds:
        for path in (root / kind).glob(f"{digest}*"):
            if path.name.startswith(PARTIAL):
                continue
            with suppress(OSError):  # another process has removed it
                files = [path, *path.rglob("*")] if path.is_dir() else [path]
                size = sum(file.stat().st_size for file in files if file.is_file())
                yield Entry(path, kind, size, path.stat().st_mtime)


def clear(found: Iterable[Entry]) -> tuple[list[Entry], dict[str, list[Entry]]]:
    """Remove entries: those that are removed, and by reason those that this user may not remove."""
    removed, refused = list[Entry](), dict[str, list[Entry]]()
    for entry in found:
        try:
            remove_entry(entry.path)
            removed.append(entry)
        except OSError as error:
            other = _other_owner(entry.path)
            why = f"belongs to {other}" if other else str(error.strerror or error)
            if getattr(error, "winerror", None) in HELD:
                why = "in use by a program that runs"
            refused.setdefault(why, []).append(entry)
    return removed, refused


def limit_size() -> None:
    """Remove the entries that were not used for longest if the cache is too large; checked once an hour."""
    stamp = cache_directory() / ".size_checked"
    with suppress(OSError):
        if stamp.is_file() and time.time() - stamp.stat().st_mtime < _CHECKED_EVERY:
            return
        stamp.touch()
        follow(stamp, stamp.parent)
        limited = [kind for kind in KINDS if kind != COMPILER]
        found = sorted(entries(kinds=limited), key=lambda entry: entry.used)
        size = sum(entry.size for entry in found)
        for entry in found:
            if size <= LIMIT or time.time() - entry.used < IN_USE:
                return
            with suppress(OSError):  # another user's, or in use
                remove_entry(entry.path)
                size -= entry.size
