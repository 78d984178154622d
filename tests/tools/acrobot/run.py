"""Discovery on a case; it never opens a log of the repository."""

from __future__ import annotations

from pathlib import Path

from fmu_didim import discover

RESULT = "result"


def discovered(case: Path, time_limit: float | None = None) -> None:
    """Discovery on a case; what it found is written beside it, without models and page.

    Args:
        time_limit: of the search for a name, in s; windows are told in what it has come to.
    """
    folder = case.parent / RESULT
    folder.mkdir(exist_ok=True)
    document = discover(case, time_limit=time_limit).document
    (folder / "findings.json").write_text(document.model_dump_json(), encoding="utf-8")
