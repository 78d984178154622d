"""Discovery on a case; it never opens a log of the repository."""

from __future__ import annotations

from pathlib import Path

from fmu_didim import discover

RESULT = "result"


def discovered(case: Path) -> None:
    """Discovery on a case; what it found is written beside it, without models and page."""
    folder = case.parent / RESULT
    folder.mkdir(exist_ok=True)
    (folder / "findings.json").write_text(discover(case).document.model_dump_json(), encoding="utf-8")
