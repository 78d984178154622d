"""Output of the command line: a terminal, a file or a pipe, of any encoding, that may be closed before the end."""

from __future__ import annotations

import codecs
import errno
import json
import os
import re
import shlex
import sys
import tempfile
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from pathlib import Path
from typing import Any, TextIO, cast

from fmu_didim.base.version import __version__

_CONTROLS = [*range(0x20), *range(0x7F, 0xA0), *range(0x202A, 0x202F), *range(0x2066, 0x206A)]
_SHOWN = {code: f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" for code in _CONTROLS if chr(code) not in "\n\t"}
"""Control characters, by which a name in a file could write over other lines, colour them or turn them round."""


def harmless(text: str) -> str:
    """Text with its control characters written out, so that it cannot control a terminal."""
    return text.translate(_SHOWN)


def quoted(path: Path) -> str:
    """A path in a command to be typed, as the shell of this system takes it."""
    if os.name != "nt":
        return shlex.quote(str(path))
    return f'"{path}"' if set(str(path)) & set(" &()^;,=%!'") else str(path)


_PLAIN = {
    "σ": "sigma", "τ": "tau", "Ω": "Ohm", "µ": "u", "μ": "u", "°": "deg", "·": ".", "⋅": ".", "×": "x", "√": "sqrt",
    "±": "+-", "−": "-", "–": "-", "→": "->", "…": "...", "“": '"', "”": '"', "█": "#", "░": ".", "‰": "per mille",
    "─": "-", "━": "-", "│": "|",
}  # fmt: skip
"""Replacements of characters that an encoding lacks; letters of a name have no replacement."""
_RAISED = dict(zip("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789", strict=True))
_ENCODED = "fmu_didim.plain"


def _plain(error: UnicodeError) -> tuple[str, int]:
    """Signs that an encoding lacks in letters that all have: ``sigma``, ``kg.m^2``; ``?`` for all others."""
    assert isinstance(error, UnicodeEncodeError)
    text = error.object[error.start : error.end]
    text = re.sub(f"[{''.join(_RAISED)}]+", lambda m: "^" + "".join(_RAISED[c] for c in m[0]), text)
    return "".join(c if c.isascii() else _PLAIN.get(c, "?") for c in text), error.end


codecs.register_error(_ENCODED, _plain)


def json_shown(text: str) -> str:
    """JSON as standard output can show it: characters that it lacks or that would control it are escaped."""
    try:
        text.encode(getattr(sys.stdout, "encoding", None) or "utf-8")
        escaped = "[\x7f-\x9f\u202a-\u202e\u2066-\u2069]"
    except UnicodeEncodeError:
        escaped = "[^\x00-\x7e]"
    return re.sub(escaped, lambda found: json.dumps(found[0])[1:-1].replace("\x7f", "\\u007f"), text)


class Encodable:
    """A stream to which all text can be written, whatever its encoding lacks."""

    def __init__(self, stream: TextIO) -> None:
        self._wrapped = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._wrapped, name)

    def write(self, text: str) -> int:
        encoding = getattr(self._wrapped, "encoding", None) or "utf-8"
        self._wrapped.write(text.encode(encoding, _ENCODED).decode(encoding))
        return len(text)


class Printable:
    """A stream that receives only text which it can show and which does not control the terminal.

    Control characters are written out, and what its encoding lacks in plain letters. Once the reader has gone
    (``| head``) or the disk is full, the rest of what is printed is lost, and not the work that goes on.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream, self._is_gone = Encodable(stream), False

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        self._try(lambda: self._stream.write(harmless(text)))
        return len(text)

    def flush(self) -> None:
        self._try(self._stream.flush)

    def _try(self, write: Any) -> None:
        if self._is_gone:
            return
        try:
            write()
        except OSError as error:
            self._is_gone = True
            with suppress(OSError, ValueError):  # what is left in its buffer would be written again at the end
                nowhere = os.open(os.devnull, os.O_WRONLY)
                os.dup2(nowhere, self._stream.fileno())
                os.close(nowhere)
            if error.errno != errno.EPIPE and self._stream._wrapped is not sys.__stderr__:
                sys.stderr.write(f"fmu-didim: the output cannot be written: {error}\n")


@contextmanager
def printable() -> Iterator[None]:
    """Standard output and standard error as :class:`Printable`."""
    with redirect_stdout(cast(TextIO, Printable(sys.stdout))), redirect_stderr(cast(TextIO, Printable(sys.stderr))):
        try:
            yield
        finally:
            sys.stdout.flush()
            sys.stderr.flush()


def unforeseen(error: BaseException) -> str:
    """The message for an unforeseen error, with the path of a log that holds its traceback."""
    text = " ".join(str(error).split())[:300]
    trace = "".join(traceback.format_exception(error))
    said = f"unexpected error: {type(error).__name__}{f': {text}' if text else ''}."
    with suppress(OSError):
        handle, name = tempfile.mkstemp(prefix="fmu-didim-", suffix=".log")
        with os.fdopen(handle, "w", encoding="utf-8", errors="backslashreplace") as stream:
            stream.write(f"fmu_didim {__version__}, Python {sys.version}, {sys.platform}\n{sys.argv}\n{trace}")
        return f"{said}\n  log:   {Path(name)}\n  next:  Report it with that log; --debug shows it here."
    return f"{said}\n  next:  Report it with what --debug shows."
