"""The logs of a folder in the order in which they were recorded."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import date, datetime
from pathlib import Path

from fmu_didim.base.errors import InputError
from fmu_didim.data.tables.dates import dates_in
from fmu_didim.data.tables.readers import READER_OF

BY_NAME = "the dates in the names of the files"
BY_TIME = "the times of the last change of the files"
MOST_NAMED = 5
"""[files] That a message names."""


@dataclass(frozen=True)
class DatedLog:
    """A log file and when it was recorded."""

    path: Path
    date: datetime


def dated_logs(folder: Path, *, by_time: bool, beside: Iterable[Path] = ()) -> list[DatedLog]:
    """The data files of a folder in the order of their dates, those of one date in that of their names.

    Args:
        by_time: whether the time of the last change of each file is its date, not its name.
        beside: files that are no logs, such as the reference motion of the case.

    Raises:
        InputError: there is no log, or one without a date.
    """
    if not folder.is_dir():
        raise InputError(
            "The folder of the logs does not exist." if not folder.exists() else "This is no folder of logs.",
            where=str(folder), next_step="Give the folder that the logs are in.",
        )  # fmt: skip
    none = {path.resolve() for path in beside}
    files = sorted(
        path for path in folder.iterdir()
        if path.suffix.lower() in READER_OF and not path.name.startswith(".") and path.is_file()
        and path.resolve() not in none
    )  # fmt: skip
    if not files:
        raise InputError(
            "There is no log in this folder.", where=str(folder), valid=f"files that end in {', '.join(READER_OF)}",
            next_step="Give the folder that the logs are in; folders inside it are not looked into.",
        )  # fmt: skip
    if by_time:
        found = [DatedLog(path, datetime.fromtimestamp(path.stat().st_mtime)) for path in files]
    else:
        found = [DatedLog(path, _date(path)) for path in files]
    return sorted(found, key=lambda log: (log.date, log.path.name))


def _date(path: Path) -> datetime:
    """The date in the name of a file; raises InputError where there is none, or several."""
    dates = dates_in(path.stem)
    if len(dates) == 1:
        return dates[0]
    raise InputError(
        "The name of this log has no date." if not dates else "The name of this log has several dates.",
        where=path.name, got=", ".join(d.isoformat() for d in dates) or path.stem,
        valid="one date by ISO 8601, such as axis1_2024-05-31.csv or 2024-05-31T14-30-00.csv",
        next_step="Rename it, move it out of the folder if it is no log, or take the times of the files "
        "(--by-time).",
    )  # fmt: skip


def split(logs: Sequence[DatedLog], *, count: int | None, until: date | None, default: int) -> int:
    """How many of the logs are the reference: the first ``count``, or those until a date, that day included.

    Raises:
        InputError: none is, or all are.
    """
    number = count if count is not None else default
    if until is not None:
        number = sum(log.date.date() <= until for log in logs)
    if number < 1:
        raise InputError(
            "No log is as early as that, so that there is no reference.", where="until", got=str(until),
            valid=f"from {logs[0].date.date()} to {logs[-1].date.date()}",
            next_step="Give a later date, or a number of logs (--reference N).",
        )  # fmt: skip
    if number >= len(logs):
        raise InputError(
            "All logs are the reference, so that none is left to be judged.", where="reference",
            got=f"{len(logs)} logs, {number} of them the reference",
            valid=f"1 to {len(logs) - 1}" if len(logs) > 1 else "more logs",
            next_step="Take fewer logs as reference (--reference N), or record more.",
        )  # fmt: skip
    return number
