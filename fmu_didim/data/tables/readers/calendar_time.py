"""Stamps that are dates or times of day, as loggers write them, in seconds from a midnight.

``2026-11-22T13:45:01.123Z``, ``2026-11-22 13:45:01,123``, ``22.11.2026 13:45:01``, ``13:45:01.123``. All stamps of a
file count from 0:00 of the day of its first one, so that files of one day share a clock. Dates with slashes are not
read: the day or the month may come first.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from datetime import date

DAY = 86_400.0
SLASHES = re.compile(r"(?:^|[;,|\t])\s*\d{1,4}/\d{1,2}/\d{1,4}\b")
"""A cell that begins with such a date."""
_DATE = r"(?:(?P<y>\d{4})-(?P<m>\d\d)-(?P<d>\d\d)|(?P<d2>\d{1,2})\.(?P<m2>\d{1,2})\.(?P<y2>\d{4}))"
_TIME = r"(?P<hour>\d{1,2}):(?P<minute>\d\d):(?P<second>\d\d(?:[.,]\d+)?)(?P<zone>Z|[+-]\d\d:?\d\d)?"
_STAMP = re.compile(rf"{_DATE}(?:[T ]\s*{_TIME})?|{_TIME.replace('?P<', '?P<only_')}")


@dataclass
class Calendar:
    """The origin of the calendar stamps of one file, which takes the day from the first stamp that has one.

    Attributes:
        day: from whose 0:00 they count, None before a stamp with a date; columns: places of the columns of stamps.
    """

    day: date | None = None
    columns: set[int] = field(default_factory=set)

    def seconds(self, text: str) -> float | None:
        """Seconds of a stamp from 0:00 of the day, in UTC where it states a zone; None if it is no stamp."""
        match = _STAMP.fullmatch(text.strip())
        if match is None:
            return None
        part = {name.removeprefix("only_"): value for name, value in match.groupdict().items() if value is not None}
        hour, minute = int(part.get("hour", 0)), int(part.get("minute", 0))
        second = float(part.get("second", "0").replace(",", "."))
        if hour > 23 or minute > 59 or second >= 61.0:
            return None
        try:
            at = date(*(int(part.get(n, part.get(f"{n}2", 0))) for n in "ymd")) if "y" in part or "y2" in part else None
        except ValueError:  # the 31st of February
            return None
        if at is not None and self.day is None:
            self.day = at
        days = (at - self.day).days if at is not None and self.day is not None else 0
        return days * DAY + 3600.0 * hour + 60.0 * minute + second - _zone(part.get("zone", ""))

    @property
    def note(self) -> str:
        """How the clock is described where there are such stamps."""
        return f"calendar times, counted in s from {f'{self.day} ' if self.day else ''}0:00" if self.columns else ""


def _zone(text: str) -> float:
    """Seconds that a zone is ahead of UTC."""
    digits = text.replace(":", "")
    if len(digits) != 5:
        return 0.0
    return (-1.0 if digits[0] == "-" else 1.0) * (3600.0 * int(digits[1:3]) + 60.0 * int(digits[3:]))
