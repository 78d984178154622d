"""How far a search came that is not at its end, in words."""

from __future__ import annotations

from fmu_didim.diagnostics import CATALOGUE, DOUBT, Diagnostic
from fmu_didim.discovery.findings import UnfinishedResult
from fmu_didim.discovery.selection.rounds import Discovery

SEARCH_RUNNING = CATALOGUE(
    "search-running", DOUBT, rank=1,
    meaning="The findings were written while the search went on; if it no longer runs, it was ended from outside.",
    next_step="Wait for it, or run discover once more.",
)  # fmt: skip


def unfinished_result(discovery: Discovery) -> UnfinishedResult | None:
    """How far a search is; None where it came to its end."""
    if not discovery.is_running:
        return None
    count = len(discovery.steps)
    rounds = "no round was" if count == 0 else "1 round was" if count == 1 else f"{count} rounds were"
    text = f"The search was still running when this was written; {rounds} complete"
    found = Diagnostic(SEARCH_RUNNING, f"{text}, and further effects may follow.")
    return UnfinishedResult(code=found.code.name, text=found.text, next_step=found.advice, rounds=count)
