"""What FMUs print by themselves, kept out of tables and pipes: some tools write pages of it for each simulation."""

from __future__ import annotations

import ctypes
import io
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

SHOWN = 10
"""[lines] Of what was printed, that are shown where a command fails: the last ones, which may say why."""
STDOUT = 1
"""Number of the standard output."""

LastLines = Callable[[], list[str]]


@contextmanager
def kept_apart() -> Iterator[LastLines]:
    """Let what C code prints go to a file of its own; gives what returns its last lines.

    Python's own output goes on where it went. Nothing is done where Python does not write to the standard output
    itself, as in a notebook or a test, and on Windows, where each library has an output of its own.
    """
    own = sys.stdout
    if os.name != "posix" or own is not sys.__stdout__ or not isinstance(own, io.TextIOWrapper) or not _is_standard():
        yield list
        return
    own.flush()
    with tempfile.NamedTemporaryFile(prefix="fmu_didim_printed_") as file:
        kept = os.dup(STDOUT)
        terminal = os.fdopen(
            kept, "w", encoding=own.encoding, errors=own.errors, buffering=1 if os.isatty(kept) else -1
        )  # fmt: skip
        os.dup2(file.fileno(), STDOUT)
        sys.stdout = terminal

        def last_lines() -> list[str]:
            _flush()
            return Path(file.name).read_text(encoding="utf-8", errors="replace").splitlines()[-SHOWN:]

        try:
            yield last_lines
        finally:
            _flush()
            sys.stdout = own
            with suppress(BrokenPipeError):
                terminal.flush()
            os.dup2(kept, STDOUT)
            with suppress(BrokenPipeError):
                terminal.close()


def _is_standard() -> bool:
    try:
        return sys.stdout.fileno() == STDOUT
    except (OSError, ValueError):
        return False


def _flush() -> None:
    """Write out what C code has printed and its library still holds."""
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).fflush(None)
