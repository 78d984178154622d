"""What a command does with memory: that which it has freed, and objects that nobody needs any more."""

from __future__ import annotations

import atexit
import ctypes
import gc
import platform
from collections.abc import Iterator
from contextlib import contextmanager

KEPT_BYTES = 64 << 20
"""[bytes] That are kept at most for the next tables, where the C library would give back what was freed and ask for it
anew: a fault for each page, a twentieth of the time of an identification of six joints."""
LARGE_BYTES = 32 << 20
"""[bytes] Tables from this size on are given back in any case."""
_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
"""Numbers of these settings of ``mallopt``."""


def keep_freed_memory() -> bool:
    """Let the C library keep what is freed for what is asked for next; says whether it can, which glibc does."""
    if platform.libc_ver()[0] != "glibc":
        return False
    settings = {_MMAP_THRESHOLD: LARGE_BYTES, _TRIM_THRESHOLD: KEPT_BYTES}
    return all(ctypes.CDLL(None).mallopt(name, size) == 1 for name, size in settings.items())


@contextmanager
def loading() -> Iterator[None]:
    """Modules are imported, which make hundreds of thousands of objects that stay: they are not looked through for
    cycles of what is needed no more, now or with the next new objects."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.unfreeze()  # both together: all are old
        gc.enable()


def end_at_once() -> None:
    """At the end of the process, leave its memory to the system, which takes it back as a whole: Python would look for
    cycles in all of it first, and free one object after the other, for which a user waits.

    What has to be closed, as instances of FMUs and their processes, is closed before that: ``weakref.finalize`` and
    ``atexit`` call it.
    """
    atexit.register(gc.freeze)
