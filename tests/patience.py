"""Work that is counted, and how long to wait on a machine of any speed, however busy it is."""

from __future__ import annotations

import math
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

ROOT = Path(__file__).parents[1]
USUAL_S = 0.3
"""What a Python process takes that imports the package's components and ends, where nothing else runs."""
AGE_S = 60.0
"""After which a machine is measured again: others may have begun to work on it."""
_measured: list[tuple[float, float]] = []  # when, s, and how many times as long as usually


def patience(seconds: float) -> float:
    """Seconds to wait for what takes a tenth of ``seconds`` on an idle machine: more on one that is slower or busy.

    For two things only: to end a test that hangs, and as the limit that a test needs to be passed by something that
    hangs, and by nothing else. What a test is about is counted.
    """
    if not _measured or time.monotonic() - _measured[-1][0] > AGE_S:
        begun = time.monotonic()
        subprocess.run([sys.executable, "-c", "import fmu_didim.components"], cwd=ROOT, check=True)
        end = time.monotonic()
        _measured.append((end, (end - begun) / USUAL_S))
    return math.ceil(10 * seconds * max(1.0, *(factor for _, factor in _measured[-2:]))) / 10


def wait_until(holds: Callable[[], object], what: str = "end of the wait") -> None:
    """Return as soon as it holds; fails where that has not come for very long."""
    end = time.monotonic() + patience(60.0)
    while not holds():
        assert time.monotonic() < end, f"no {what}"
        time.sleep(0.02)


def is_running(pid: int) -> bool:
    """Whether there is a process of this number that has not ended (``/proc``)."""
    try:
        return "\nState:\tZ" not in Path(f"/proc/{pid}/status").read_text(encoding="utf-8")
    except OSError:
        return False


class Calls:
    """Counts the calls of functions, of Python's and of C's, that a block makes in this thread: its work.

    Attributes:
        count: so many until now.
    """

    def __init__(self) -> None:
        self.count = 0

    def __enter__(self) -> Calls:
        self._before = sys.getprofile()
        sys.setprofile(self._see)
        return self

    def __exit__(self, *error: object) -> None:
        sys.setprofile(self._before)

    def _see(self, frame: FrameType, event: str, argument: Any) -> None:
        self.count += event in ("call", "c_call")
