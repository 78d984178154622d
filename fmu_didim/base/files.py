"""Files as Linux, macOS and Windows take them: their names, their permissions, whole or not at all."""

from __future__ import annotations

import hashlib
import os
import re
import secrets
import shutil
import socket
import stat
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import TypeVar

PARTIAL = ".partial-"
"""How the names of files and folders begin that are being written."""
STALE = 2 * 3600.0
"""Seconds after which those of other machines are given up: four times as long as a compilation may take."""
HELD = (5, 32, 33)
"""Windows' errors where another program has a file open: access denied, sharing violation, lock violation.

Source: Microsoft, "System Error Codes (0-499)".
"""
WAITS = tuple(0.01 * 2**k for k in range(8))
"""Pauses in s between attempts, 2.6 s in all: virus scanners and indexers leave a fresh file within a second or two."""
LONGEST_ON_WINDOWS = 248
"""Characters of a path from which on Windows may refuse it: 260 with the final zero, less 12 for a name in a folder.

Source: Microsoft, "Maximum Path Length Limitation".
"""
_NOT_FOUND, _PATH_NOT_FOUND, _NAME_TOO_LONG = 2, 3, 206
_REFUSED = re.compile(r'[<>:"/\\|?*\x00-\x1f\x7f]')
_DEVICES = re.compile(r"(con|prn|aux|nul|conin\$|conout\$|(com|lpt)[0-9¹²³])(?=\s*(\.|$))", re.IGNORECASE)
"""Names that stand for devices of Windows, with any ending.

Source: Microsoft, "Naming Files, Paths, and Namespaces".
"""
HAS_OWNERS = hasattr(os, "getuid")
"""Whether files have an owner, a group and permissions; Windows hands those of a folder down by itself."""
_T = TypeVar("_T")


def is_file(path: Path) -> bool:
    """Whether there is such a file; False for names that the system refuses, such as names that are too long."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def file_name(text: str) -> str:
    """A text as the name of a file that all three systems take: what one of them refuses becomes ``_``.

    These are the characters ``<>:"/\\|?*``, control characters, dots and spaces at the end; a name that Windows keeps
    for a device, such as ``aux`` or ``com1.csv``, gets a ``_`` behind it.
    """
    name = _REFUSED.sub("_", text)
    stripped = name.rstrip(". ")
    name = stripped + "_" * (len(name) - len(stripped))
    return _DEVICES.sub(lambda device: f"{device[0]}_", name, count=1) if _DEVICES.match(name) else name or "_"


def owner(path: Path) -> str:
    """The user to whom a file belongs; "" if the system does not know."""
    try:
        return path.owner()
    except KeyError:  # a user of another machine, or of none
        return f"user {path.stat().st_uid}"
    except (OSError, NotImplementedError):
        return ""


def made(folder: Path) -> Path:
    """A folder, made if absent with the permissions of the one it lies in, which decide who shares it."""
    if not folder.is_dir():
        folder.parent.mkdir(parents=True, exist_ok=True)
        with suppress(FileExistsError):
            folder.mkdir()
            follow(folder, folder.parent)
    return folder


def follow(path: Path, folder: Path) -> None:
    """Give a file or folder the permissions of a folder in which it lies."""
    if not HAS_OWNERS:
        return
    with suppress(OSError):  # some file systems have none
        before = path.stat().st_mode
        wanted = _handed_down(folder)
        if not stat.S_ISDIR(before):
            wanted &= 0o777 if before & stat.S_IXUSR else 0o666
        if stat.S_IMODE(before) != wanted:
            path.chmod(wanted)


def _handed_down(folder: Path) -> int:
    """The permissions that a folder hands down: a group writes only where it shares it (setgid), others never."""
    found = folder.stat().st_mode
    return found & (0o2775 if found & stat.S_ISGID else 0o755)


def file_permissions(folder: Path) -> int:
    """The permissions of a file that is shared as its folder is."""
    return _handed_down(folder) & 0o666


def patiently(operation: Callable[[], _T]) -> _T:
    """Do something with a file, again and again where Windows refuses it because another program has it open."""
    for pause in WAITS:
        try:
            return operation()
        except PermissionError as error:
            if getattr(error, "winerror", None) not in HELD:
                raise
        time.sleep(pause)
    return operation()


def is_too_long(error: OSError) -> bool:
    """Whether Windows has refused a path for its length; for most programs it then does not exist."""
    code = getattr(error, "winerror", None)
    length = max(len(str(name or "")) for name in (error.filename, error.filename2))
    return code == _NAME_TOO_LONG or (code in (_NOT_FOUND, _PATH_NOT_FOUND) and length >= LONGEST_ON_WINDOWS)


def advice(error: OSError, otherwise: str, *, place: str = "another folder") -> str:
    """The next step where a file cannot be written: a shorter path where that is the reason."""
    if not is_too_long(error):
        return otherwise
    return f"The path is too long for Windows (260 characters): name {place} with a short path, such as C:\\fmu."


def _partial_name() -> str:
    """A name that says on which machine which process is writing, so that what a killed one left is known."""
    return f"{PARTIAL}{_machine()}-{os.getpid()}-{secrets.token_hex(4)}"


@cache
def _machine() -> str:
    """A short name of this machine that any file system takes."""
    return hashlib.sha256(socket.gethostname().encode()).hexdigest()[:6]


def is_running(process: int) -> bool:
    """Whether a process of this machine runs; True where the system does not tell."""
    if sys.platform == "win32":
        return True  # where asking for it as below would end it
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        pass  # of another user
    return True


def partial_folder(parent: Path) -> Path:
    """A new folder to fill; the umask and the folder it lies in decide who may read it."""
    path = parent / _partial_name()
    path.mkdir()
    return path


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A file to write, which then takes the place of ``path``: no reader finds half of it.

    The umask and the folder decide who may read it.
    """
    temporary = path.with_name(f"{_partial_name()}{path.suffix}")
    temporary.touch(exist_ok=False)
    try:
        yield temporary
        sync(temporary)
        patiently(lambda: temporary.replace(path))
    finally:
        with suppress(PermissionError):  # held by another program: stale one day
            temporary.unlink(missing_ok=True)


def _is_given_up(path: Path) -> bool:
    """Whether a process of this machine was writing it that runs no more."""
    machine, _, rest = path.name.removeprefix(PARTIAL).partition("-")
    process = rest.partition("-")[0]
    return machine == _machine() and process.isdecimal() and not is_running(int(process))


def sync(path: Path) -> None:
    """Bring what was written to a file, or the names in a folder, to the disk; a power cut then does not empty it."""
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
    """Remove what killed processes left half written in a folder: of this machine at once, of others when it is old."""
    for path in folder.glob(f"{PARTIAL}*"):
        with suppress(OSError):
            if not _is_given_up(path) and time.time() - path.stat().st_mtime < STALE:
                continue
            if path.is_dir():
                shutil.rmtree(path)
            else:
                path.unlink()
