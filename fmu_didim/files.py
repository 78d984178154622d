"""Files that somebody names."""

from __future__ import annotations

from pathlib import Path


def is_file(path: Path) -> bool:
    """Whether there is such a file; no name that the system refuses, such as one too long, has one."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False
