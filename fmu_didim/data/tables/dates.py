"""Dates in the names of files."""

from __future__ import annotations

import re
from datetime import datetime

_DATE = re.compile(
    r"(?<!\d)(\d{4})(-?)(\d{2})\2(\d{2})(?:[T _-]?(\d{2})[:.h-]?(\d{2})(?:[:.m-]?(\d{2}))?)?(?!\d)", re.IGNORECASE
)
"""A date by ISO 8601, extended or basic, with or without a time, also as file names may have it (``14-30-00``)."""


def dates_in(name: str) -> list[datetime]:
    """The different dates in the name of a file, in their order."""
    return list(dict.fromkeys(found for match in _DATE.finditer(name) if (found := _of(match)) is not None))


def _of(match: re.Match[str]) -> datetime | None:
    """The date of a match; None of digits that are none."""
    year, _, month, day, hour, minute, second = match.groups()
    try:
        return datetime(int(year), int(month), int(day), int(hour or 0), int(minute or 0), int(second or 0))
    except ValueError:
        return None
