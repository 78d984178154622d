"""What a command does with memory that it has freed."""

from __future__ import annotations

import ctypes
import platform

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
