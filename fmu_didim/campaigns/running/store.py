"""The folder of a campaign: the plan, and the rows of the finished runs.

Each worker appends to its own journal, one JSON line a run, so that no finished run is lost, whatever ends the worker.
A long journal becomes a Parquet file, which is written atomically. A truncated line is skipped and its run repeated; a
row that occurs twice counts once. Several runners may therefore work on one folder, on one machine or many.
"""

from __future__ import annotations

import json
import logging
import os
import socket
import time
import uuid
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import pyarrow as pa
from pyarrow import parquet

from fmu_didim.base.errors import InputError
from fmu_didim.base.files import advice, patiently, remove_stale, sync, whole_file
from fmu_didim.base.version import __version__

if TYPE_CHECKING:
    from fmu_didim.campaigns.planning.plan import Plan

PART_ROWS = 1000
"""[rows] A journal with this many rows becomes a Parquet file: 100 000 runs are a hundred files, read in a second."""
ALIVE_S = 60.0
"""[s] A runner that did not announce itself for this long counts as ended."""

_OF_PARAMETER = ("value", "std", "low", "high", "true", "didim_value", "didim_std", "paper_std")
_PARAMETER = pa.struct([
    ("name", pa.string()), ("unit", pa.string()), *((name, pa.float64()) for name in _OF_PARAMETER),
])  # fmt: skip
_TEXTS = (
    "id", "design", "data", "status", "verdict", "message", "answer", "named", "hidden", "findings", "host", "started",
)  # fmt: skip
_NUMBERS = (
    "seconds", "cpu_seconds", "error_percent", "held_out_percent", "condition_number", "gap_before", "gap_after",
)  # fmt: skip
ROW = pa.schema([
    *((name, pa.string()) for name in _TEXTS), *((name, pa.float64()) for name in _NUMBERS),
    *((name, pa.int64()) for name in ("seed", "attempt", "iterations", "finish_iterations")),
    *((name, pa.list_(pa.string())) for name in ("reasons", "conditions")), ("parameters", pa.list_(_PARAMETER)),
])  # fmt: skip
"""The columns of a row."""
_PLANNED = pa.schema([
    *((name, pa.string()) for name in ("id", "design", "data")), ("seed", pa.int64()), ("settings", pa.string()),
])  # fmt: skip
"""The columns of a planned run."""
_HEAD = {
    "campaign": dict, "file": str | None, "folder": str, "code": str, "version": str, "planned": str, "count": int,
    "paths": list,
}  # fmt: skip
"""What the file of a campaign holds."""
BRIEF = ("id", "status", "verdict", "attempt", "seconds", "started")
PLAN_FILE, RUNS_FILE = "campaign.json", "plan.parquet"
JOURNALS, PARTS, FILES, RUNNERS = "journal", "parts", "runs", "runners"
ANSWERED, REFUSED, FAILED = "answered", "refused", "failed"
CRASHED, TIME_LIMIT, MEMORY_LIMIT = "crashed", "time limit", "memory limit"
FAILURES = (FAILED, CRASHED, TIME_LIMIT, MEMORY_LIMIT)
"""Statuses of runs with neither an answer nor a refusal."""
_log = logging.getLogger(__name__)


class Store:
    """The folder of a campaign; created at the first write."""

    def __init__(self, folder: Path | str) -> None:
        self.folder = Path(folder)

    def begin(self, plan: Plan) -> None:
        """Save the plan in place of an earlier plan of the same campaign.

        Raises:
            InputError: the folder holds another campaign, or cannot be written to.
        """
        before = self.head() if (self.folder / PLAN_FILE).is_file() else None
        if before is not None and before["campaign"]["name"] != plan.document.name:
            raise InputError(
                "The folder holds another campaign.", where=str(self.folder), got=before["campaign"]["name"],
                valid=plan.document.name, next_step="Name another folder by --out.",
            )  # fmt: skip
        head = {
            "campaign": plan.document.model_dump(mode="json", by_alias=True, exclude_unset=True),
            "file": plan.file, "folder": str(plan.folder.resolve()), "code": plan.code, "version": __version__,
            "planned": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()), "count": len(plan.runs),
            "paths": list(plan.paths), "quantity": plan.quantity,
        }  # fmt: skip
        columns = {name: [getattr(run, name) for run in plan.runs] for name in ("id", "design", "data", "seed")}
        columns["settings"] = [json.dumps(run.labels, default=str) for run in plan.runs]
        try:
            for name in (JOURNALS, PARTS, RUNNERS):
                (self.folder / name).mkdir(parents=True, exist_ok=True)
                remove_stale(self.folder / name)
            remove_stale(self.folder)
            with whole_file(self.folder / RUNS_FILE) as temporary:
                parquet.write_table(pa.table(columns), temporary)
            with whole_file(self.folder / PLAN_FILE) as temporary:
                temporary.write_text(json.dumps(head, indent=1, default=str), encoding="utf-8")
        except OSError as error:
            raise unwritable(self.folder, error) from error

    def head(self) -> dict[str, Any]:
        """The campaign, and the code that planned it; raises InputError where there is no campaign."""
        path = self.folder / PLAN_FILE
        if not path.is_file():
            raise InputError(
                "There is no campaign in this folder.", where=str(self.folder),
                next_step="fmu-didim campaign run CAMPAIGN.yaml makes one; the other commands take its folder.",
            )  # fmt: skip
        try:
            found = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError) as error:
            raise _damaged(path, str(error)) from error
        if not isinstance(found, dict):
            raise _damaged(path, type(found).__name__)
        if wrong := [name for name, kind in _HEAD.items() if not isinstance(found.get(name), kind)]:
            raise _damaged(path, f"nothing usable for {', '.join(wrong)}")
        if not isinstance(found["campaign"].get("name"), str):
            raise _damaged(path, "a campaign without a name")
        return found

    def planned(self) -> pa.Table:
        """The runs that were planned: id, design, data, seed, settings."""
        self.head()
        path = self.folder / RUNS_FILE
        try:
            found = parquet.read_table(path, columns=_PLANNED.names).cast(_PLANNED)
            labels = [json.loads(text) for text in found["settings"].to_pylist()]
        except (OSError, ValueError, TypeError, pa.ArrowException) as error:
            raise _damaged(path, str(error)) from error
        if found["id"].null_count or not all(isinstance(label, dict) for label in labels):
            raise _damaged(path, "runs without id or settings")
        return found

    def rows(self, columns: Iterable[str] | None = None) -> pa.Table:
        """One row a finished run, of all plans and versions; of several rows the best and latest."""
        names = list(ROW.names if columns is None else dict.fromkeys((*BRIEF, *columns)))
        schema = pa.schema([ROW.field(name) for name in names])
        # Journals first: one that becomes a part meanwhile is then found among the parts.
        journalled = [{name: row.get(name) for name in names} for row in self._lines()]
        return _best_rows(pa.concat_tables([_as_table(journalled, schema), *self._parts(names, schema)]))

    def _parts(self, names: list[str], schema: pa.Schema) -> Iterator[pa.Table]:
        for path in sorted((self.folder / PARTS).glob("*.parquet")):
            try:
                found = parquet.ParquetFile(path)
                known = [name for name in names if name in found.schema_arrow.names]
                yield _whole(found.read(columns=known), schema)
            except (OSError, KeyError, pa.ArrowException) as error:
                _log.warning("%s cannot be read (%s); its runs count as not done", path, error)

    def _lines(self) -> Iterator[dict[str, Any]]:
        for path in sorted((self.folder / JOURNALS).glob("*.jsonl")):
            try:
                yield from patiently(partial(read_lines, path))
            except FileNotFoundError:
                continue  # it has just become a part
            except PermissionError:  # the same: Windows removes it when its last reader has closed it
                if not _part(self.folder, path).is_file():
                    raise

    def other_runners(self) -> list[str]:
        """Other runners that work on the folder now."""
        now, own = time.time(), _own_runner()
        found = []
        for path in (self.folder / RUNNERS).glob("*"):
            with suppress(OSError):
                if path.name != own and now - path.stat().st_mtime < ALIVE_S:
                    found.append(path.name)
        return found

    def announce(self) -> Path:
        """Show other runners that this one works on the folder; returns the file to be removed at the end."""
        path = self.folder / RUNNERS / _own_runner()
        with suppress(OSError):
            path.touch()
        return path


def _own_runner() -> str:
    return f"{socket.gethostname()}-{os.getpid()}"


def _best_rows(table: pa.Table) -> pa.Table:
    """One row for each id: answers and refusals before failures, then the last attempt."""
    best: dict[str, tuple[tuple[bool, int, str], int]] = {}
    columns = (table[name].to_pylist() for name in ("id", "status", "attempt", "started"))
    for i, (id_, status, attempt, started) in enumerate(zip(*columns, strict=True)):
        rank = (status not in FAILURES, attempt or 0, started or "")
        if id_ not in best or rank > best[id_][0]:
            best[id_] = rank, i
    return table.take(pa.array([i for _, i in best.values()], type=pa.int64()))


def _whole(found: pa.Table, schema: pa.Schema) -> pa.Table:
    """A table with all columns of a schema: what a version of this project did not write yet is empty, but for what
    every row has."""
    for name in schema.names:
        if name not in found.column_names and name not in BRIEF:
            found = found.append_column(name, pa.nulls(len(found), schema.field(name).type))
    return found.select(schema.names).cast(schema)


def _as_table(rows: list[dict[str, Any]], schema: pa.Schema) -> pa.Table:
    """Rows of journals as a table; those that hold something else than a row has are left out and told."""
    try:
        return pa.Table.from_pylist(rows, schema=schema)
    except (pa.ArrowException, TypeError, ValueError, OverflowError):
        if len(rows) == 1:
            _log.warning("a row of a journal is damaged (%s); its run counts as not done", str(rows[0].get("id"))[:60])
            return schema.empty_table()
    middle = len(rows) // 2
    return pa.concat_tables([_as_table(half, schema) for half in (rows[:middle], rows[middle:])])


def _damaged(path: Path, why: str) -> InputError:
    return InputError(
        "A file of the campaign is damaged.", where=str(path), got=" ".join(why.split())[:200],
        next_step="Remove it and run the campaign again: it is written anew, and finished runs are kept.",
    )  # fmt: skip


def read_lines(path: Path) -> list[dict[str, Any]]:
    """The complete lines of a journal."""
    found = []
    with path.open(encoding="utf-8", errors="replace") as stream:
        for line in stream:
            with suppress(ValueError):  # truncated when the worker or the machine was stopped
                row = json.loads(line)
                if line.endswith("\n") and isinstance(row, dict) and "id" in row and "status" in row:
                    found.append(row)
    return found


def _part(folder: Path, journal: Path) -> Path:
    """The Parquet file that a journal becomes."""
    return folder / PARTS / f"{journal.stem}.parquet"


class Journal:
    """The rows that one worker writes."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._name = folder, f"{_own_runner()}-{uuid.uuid4().hex[:12]}"
        self._count = self._number = 0
        self._stream: IO[bytes] | None = None

    @property
    def _path(self) -> Path:
        return self._folder / JOURNALS / f"{self._name}-{self._number}.jsonl"

    def write(self, row: Mapping[str, Any]) -> None:
        """Append a row; it survives a crash of this process, not yet of the machine."""
        if self._stream is None:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            self._stream = self._path.open("ab", buffering=0)
        line = json.dumps({name: value for name, value in row.items() if value is not None}).encode() + b"\n"
        if self._stream.write(line) != len(line):
            raise OSError("the disk is full: a line was truncated")
        self._count += 1

    def end_chunk(self) -> None:
        """Flush the rows to the disk; a long journal becomes a Parquet file."""
        if self._stream is not None:
            os.fsync(self._stream.fileno())
        if self._count >= PART_ROWS:
            self.seal()

    def close(self) -> None:
        """Close the journal as it is."""
        if self._stream is not None:
            self._stream.close()
            self._stream = None

    def seal(self) -> None:
        """Turn the journal into a Parquet file."""
        if self._stream is None:
            return
        self.close()
        rows = [{name: row.get(name) for name in ROW.names} for row in read_lines(self._path)]
        target = _part(self._folder, self._path)
        target.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(target) as temporary:
            parquet.write_table(pa.Table.from_pylist(rows, schema=ROW), temporary)
        sync(target.parent)
        with suppress(PermissionError):  # Windows, while another process reads it: its rows occur twice and count once
            patiently(self._path.unlink)
        self._count, self._number = 0, self._number + 1


def unwritable(folder: Path, error: OSError) -> InputError:
    """The error of a folder that cannot be written to."""
    step = "Free some space and run the campaign again: finished runs are kept and not run again."
    return InputError(
        "The results cannot be written.", where=str(folder), got=str(error), next_step=advice(error, step)
    )
