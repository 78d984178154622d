"""The ways to run an FMU again."""

from __future__ import annotations

from dataclasses import dataclass

AUTO, RESET, STATE, AGAIN, PROCESS = "auto", "reset", "state", "re-instantiate", "fresh process"
STRATEGIES = (AUTO, RESET, STATE, AGAIN, PROCESS)


@dataclass(frozen=True)
class Rerun:
    """How to run an FMU again, and why; isolated: only in a process of its own."""

    strategy: str
    reason: str
    isolated: bool = False
