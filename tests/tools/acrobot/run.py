"""Discovery on a case; it never opens a log of the repository."""

from __future__ import annotations

from pathlib import Path

from fmu_didim.workflow import discover

RESULT = "result"


def discovered(case: Path) -> None:
    """Discovery on a case, beside it."""
    discover(case, case.parent / RESULT)
