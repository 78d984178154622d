"""The cause of the end of a process, from its exit status."""

from __future__ import annotations

import signal

_KILLED = 9
"""SIGKILL: how a system without memory left ends a process."""
_FIRST_STATUS = 0x80000000
"""Exit statuses from here on are errors of Windows, by which it ends a process; others are the process's own."""
_STATUSES = {
    0x80000003: "breakpoint",
    0xC0000005: "access violation",
    0xC0000006: "a page of memory could not be read",
    0xC0000017: "no memory left",
    0xC000001D: "illegal instruction",
    0xC0000025: "an exception that cannot be continued",
    0xC000008C: "array bounds exceeded",
    0xC000008E: "floating-point division by zero",
    0xC0000090: "invalid floating-point operation",
    0xC0000091: "floating-point overflow",
    0xC0000094: "integer division by zero",
    0xC0000096: "privileged instruction",
    0xC00000FD: "stack overflow",
    0xC000012D: "no memory left",
    0xC0000135: "a DLL was not found",
    0xC0000139: "a function was not found in a DLL",
    0xC000013A: "Ctrl-C",
    0xC0000142: "a DLL could not be initialised",
    0xC0000374: "the heap is damaged",
    0xC0000409: "the stack is damaged, or abort() was called",
    0xC0000417: "an invalid argument of a C function",
    0xE06D7363: "a C++ exception that nothing has caught",
}
"""Their meanings. Sources: Microsoft, "[MS-ERREF] NTSTATUS Values"; the last one is of Microsoft's C++ compiler."""
_FROM_OUTSIDE = (0xC0000017, 0xC000012D, 0xC000013A)
"""Those of them that the process is not to blame for: a machine without memory left, an interruption."""


def crash_name(code: int | None) -> str:
    """Name of the crash or signal that ended a process; "" if it ended by itself or runs.

    Args:
        code: a signal as a negative number, a status of Windows, or what the process ended with.
    """
    if code is None or 0 <= code < _FIRST_STATUS:
        return ""
    if code > 0:
        return f"0x{code:08X}, {_STATUSES.get(code, 'an error of Windows')}"
    try:
        return f"{signal.Signals(-code).name}, {signal.strsignal(-code)}"
    except ValueError:
        return f"signal {-code}"


def is_from_outside(code: int | None) -> bool:
    """Whether the process is not to blame for its end."""
    return code == -_KILLED or code in _FROM_OUTSIDE
