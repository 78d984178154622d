"""CSV files as loggers write them: delimiter, decimal comma, lines before the header and a row of units are recognised.

Every delimiter with every decimal sign is tried on the whole file; that one counts with which each line after the
header is a row of as many numbers as the header has names. Where two of them give different numbers, or none does, the
file is refused: nothing is guessed from its first lines.
"""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from fmu_didim.base.documents import Strict
from fmu_didim.base.errors import InputError
from fmu_didim.data.signals import Array
from fmu_didim.data.tables.readers.calendar_time import SLASHES, Calendar
from fmu_didim.data.tables.table import SignalTable
from fmu_didim.data.units import known_unit

WORDS = {";": "semicolon", "\t": "tab", ",": "comma", "|": "bar", " ": "space"}
NONE = "\0"
"""Stands for the delimiter of a file with one column."""
MOST_LINES_BEFORE = 500
_COMMA = re.compile(r"[+-]?(\d+(,\d+)?|,\d+)([eE][+-]?\d+)?|[+-]?(nan|inf)", re.IGNORECASE)
_DELIMITERS = frozenset(WORDS) - {" "}
"""Between which no cell is lost when two stand side by side."""
_NO_UNIT = ("", "-", "--")
LIMIT = 2**27
"""Longest field of a CSV file that is read, in characters."""


class CsvLayout(Strict):
    """How a CSV file is written, where that cannot be recognised.

    Attributes:
        delimiter: one character between the cells; decimal: the decimal sign.
        skip_lines: lines before the header that are left out.
    """

    delimiter: str | None = Field(default=None, min_length=1, max_length=1)
    decimal: Literal[".", ","] | None = None
    skip_lines: int = Field(default=0, ge=0)


@dataclass(frozen=True)
class _Parsed:
    delimiter: str
    decimal: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    data: Array
    lines_before: int
    calendar: Calendar

    def same(self, other: _Parsed) -> bool:
        return self.names == other.names and np.array_equal(self.data, other.data, equal_nan=True)


class _MisfitError(Exception):
    """With this layout a line is no row of numbers."""

    def __init__(self, line: int, cells: list[str], count: int, delimiter: str, decimal: str) -> None:
        super().__init__(line)
        self.line, self.count, self.delimiter, self.decimal = line, count, delimiter, decimal
        self.text = delimiter.join(cells)[:80]


def read_csv(path: Path, layout: CsvLayout | None = None) -> SignalTable:
    """The table in a CSV file; its notes state what had to be recognised.

    Raises:
        InputError: no layout fits the file, or several do.
    """
    layout = layout or CsvLayout()
    text, encoding = _text(path)
    lines = text.splitlines()[layout.skip_lines :]
    found, misfits = list[_Parsed](), list[_MisfitError]()
    for delimiter, decimal in _layouts(layout, text):
        try:
            parsed = _parsed(lines, delimiter, decimal, layout.skip_lines)
        except _MisfitError as misfit:
            misfits.append(misfit)
        else:
            if parsed is not None and not any(parsed.same(other) for other in found):
                found.append(parsed)
    _refuse_if_unclear(path, lines, found, misfits)
    only = found[0]
    notes = list(_notes(only, layout, encoding))
    names = only.names or tuple(str(i + 1) for i in range(only.data.shape[1]))
    doubled = sorted(name for name, count in Counter(names).items() if count > 1)
    if doubled:
        raise InputError(
            "The CSV file has columns of the same name.", where=str(path), got=", ".join(doubled)[:200],
            next_step="Rename them in its first line.",
        )  # fmt: skip
    stamps = [names[k] for k in sorted(only.calendar.columns)]
    units = dict(zip(names, only.units, strict=False)) | dict.fromkeys(stamps, "s")
    return SignalTable(
        columns={name: only.data[:, i] for i, name in enumerate(names)},
        units={name: unit for name, unit in units.items() if unit not in _NO_UNIT},
        notes=tuple(notes), source=str(path), has_header=bool(only.names), calendar=tuple(stamps),
    )  # fmt: skip


def _text(path: Path) -> tuple[str, str]:
    raw = path.read_bytes()
    if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return raw.decode("utf-16"), "UTF-16"
    try:
        return raw.decode("utf-8-sig"), ""
    except UnicodeDecodeError:
        return raw.decode("cp1252"), "Windows-1252, because it is not UTF-8"


def _layouts(layout: CsvLayout, text: str) -> Iterator[tuple[str, str]]:
    """Delimiters and decimal signs that are tried: those that are stated, else every delimiter that the text has."""
    for delimiter in (layout.delimiter,) if layout.delimiter else (*(d for d in WORDS if d in text), NONE):
        for decimal in (layout.decimal,) if layout.decimal else (".", ","):
            if decimal != delimiter:
                yield delimiter, decimal


def _parsed(lines: list[str], delimiter: str, decimal: str, skipped: int) -> _Parsed | None:
    """The table by one layout; None where it holds no rows of numbers."""
    before: list[tuple[int, list[str]]] = []
    data: list[list[float]] = []
    rest: Array | None = None
    count = 0
    calendar = Calendar()
    for number, cells in _rows(lines, delimiter):
        if not data:
            calendar = Calendar()  # text above the numbers is not one of their stamps
            count = len(_closed(cells))
            if len(cells) > count and _opens_a_cell(lines, delimiter, len(cells), before):
                count += 1
        cells = cells[:-1] if len(cells) == count + 1 and not cells[-1] else cells
        numbers = _numbers(cells, decimal, calendar if calendar.columns or not data else None)
        if not data and numbers is None:
            before.append((number + skipped, _closed(cells)))
            if len(before) > MOST_LINES_BEFORE:
                return None
            continue
        if numbers is None or len(numbers) != count:
            raise _MisfitError(number + skipped, cells, count, delimiter, decimal)
        data.append(numbers)
        if len(data) == 1 and not calendar.columns and delimiter in _DELIMITERS and decimal == ".":
            rest = _plain(lines[number:], delimiter, count)
            if rest is not None:
                break
    if not data or (delimiter == NONE) != (count == 1):
        return None
    if delimiter == NONE and any(_DELIMITERS & set(cells[0]) for _, cells in before):
        return None
    names, units = _header(before, count, delimiter, decimal)
    used = bool(names) + bool(units)
    table = np.array(data) if rest is None else np.vstack([data, rest])
    return _Parsed(delimiter, decimal, names, units, table, len(before) - used, calendar)


def _plain(lines: list[str], delimiter: str, count: int) -> Array | None:
    """(N, count) of lines that hold so many numbers each and nothing else, read at once; None where any does not."""
    while lines and not lines[-1].strip():
        lines = lines[:-1]
    if not lines:
        return np.zeros((0, count))
    try:
        rows = np.loadtxt(lines, delimiter=delimiter, comments=None, ndmin=2)
    except ValueError:
        return None
    return rows if rows.shape == (len(lines), count) else None


def _rows(lines: list[str], delimiter: str) -> Iterator[tuple[int, list[str]]]:
    """Line number and cells of the lines that are not empty."""
    if delimiter == NONE:
        yield from ((i, [line.strip()]) for i, line in enumerate(lines, start=1) if line.strip())
        return
    csv.field_size_limit(LIMIT)
    rows = csv.reader(StringIO("\n".join(lines)), delimiter=delimiter, skipinitialspace=True)
    for row in rows:
        cells = [cell.strip() for cell in row]
        if any(cells):
            yield rows.line_num, cells


def _closed(cells: list[str]) -> list[str]:
    """The cells without one that a delimiter at the end of the line opens."""
    return cells[:-1] if len(cells) > 1 and not cells[-1] else cells


def _opens_a_cell(lines: list[str], delimiter: str, count: int, before: list[tuple[int, list[str]]]) -> bool:
    """Whether the delimiter at the end of the first row of numbers, of so many cells, opens an empty one: the line of
    names above has a name for it, or without such a line some other row has a number there."""
    if before:
        return any(len(names) == count for _, names in before[-2:])  # the last one may have the units
    return any(len(cells) == count and cells[-1] for _, cells in _rows(lines, delimiter))


def _numbers(cells: list[str], decimal: str, calendar: Calendar | None = None) -> list[float] | None:
    """The numbers of a row, NaN where a cell is empty; None if it is not a row of numbers.

    Args:
        calendar: where cells may be its stamps, in the same columns as before, and beside at least one number.
    """
    plain = [cell or "nan" for cell in cells]
    if decimal == ",":
        plain = [cell.replace(",", ".") if _COMMA.fullmatch(cell) else "" if cell else "nan" for cell in cells]
    if not any(cells):
        return None
    if any("_" in cell for cell in cells):  # 1_0 is not ten
        return None
    try:
        found, stamps = [float(cell) for cell in plain], set[int]()
    except ValueError:
        if calendar is None:
            return None
        values = [_number(cell) for cell in plain]
        stamps = {k for k, value in enumerate(values) if value is None}
        values = [calendar.seconds(cells[k]) if k in stamps else value for k, value in enumerate(values)]
        found = [value for value in values if value is not None]
        if len(found) < len(cells) or len(stamps) == len(cells):
            return None
    if calendar is not None and stamps != calendar.columns:
        if calendar.columns:
            return None
        calendar.columns = stamps
    return found


def _number(cell: str) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return None


def _is_value(cell: str) -> bool:
    """Whether a cell is a number, with either decimal sign, or a stamp, so that it cannot be a name."""
    return any(_numbers([cell], sign) is not None for sign in ".,") or Calendar().seconds(cell) is not None


def _header(
    before: list[tuple[int, list[str]]], count: int, delimiter: str, decimal: str
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names and units in the lines before the first row of numbers."""
    if not before:
        return (), ()
    (line, last), *above = reversed(before)
    units: list[str] = []
    if above and len(above[0][1]) == count and len(last) <= count and _is_unit_row(last):
        units = [cell.strip("[]() ") for cell in last]
        line, last = above[0]
    if len(last) != count or any(_is_value(cell) for cell in last):
        raise _MisfitError(line, last, count, delimiter, decimal)
    return tuple(name.lstrip("#%").strip() if i == 0 else name for i, name in enumerate(last)), tuple(units)


def _is_unit_row(cells: list[str]) -> bool:
    bare = [cell.strip("[]() ") for cell in cells]
    stated = [cell for cell in bare if cell not in _NO_UNIT]
    known = [known_unit(cell) for cell in stated]
    of_time = bool(known) and known[0] is not None and known[0].powers == {"s": 1}  # others may be any, such as Inc
    return bool(stated) and (of_time or None not in known)


def _refuse_if_unclear(path: Path, lines: list[str], found: list[_Parsed], misfits: list[_MisfitError]) -> None:
    if len(found) > 1:
        raise InputError(
            "The CSV file can be read in several ways.", where=str(path), got="; ".join(_in_words(f) for f in found),
            next_step='Say which: csv: {delimiter: ";", decimal: ","} beside file:.',
        )  # fmt: skip
    if found:
        return
    slashed = [line for line in lines if SLASHES.search(line)]
    if 2 * len(slashed) > len(lines):
        raise InputError(
            "A date with slashes may begin with the day or with the month.", where=str(path), got=slashed[0][:80],
            valid="2026-05-31 12:00:00.5, 31.05.2026 12:00:00.5 or 12:00:00.5",
            next_step="Let the logger write dates so; or leave them out and count the rows: time: {rate_hz: ...}.",
        )  # fmt: skip
    if not misfits:
        raise InputError(
            "The CSV file holds no rows of numbers.", where=str(path),
            next_step="Check the file; the numbers of a row are separated by comma, semicolon, tab or spaces.",
        )  # fmt: skip
    worst = max(misfits, key=lambda m: (m.line, m.count))
    sign = "point" if worst.decimal == "." else "comma"
    separated = f"{worst.count} {WORDS.get(worst.delimiter, 'line')}-separated numbers"
    raise InputError(
        "A line of the CSV file is not a row of numbers.", where=f"{path}, line {worst.line}", got=worst.text,
        valid=f"{separated}, decimal {sign}, as in the other lines; before them one line with as many names",
        next_step='Fix the line, or say how the file is written: csv: {delimiter: ";", decimal: ",", skip_lines: 0}.',
    )  # fmt: skip


def _in_words(parsed: _Parsed) -> str:
    count = parsed.data.shape[1]
    sign = "point" if parsed.decimal == "." else "comma"
    return f"{count} columns by {WORDS.get(parsed.delimiter, 'line')}, decimal {sign}"


def _notes(parsed: _Parsed, layout: CsvLayout, encoding: str) -> Iterator[str]:
    """How a file that is not plain was read."""
    if parsed.delimiter not in (",", NONE) and layout.delimiter is None:
        yield f"{WORDS[parsed.delimiter]}-separated"
    if parsed.decimal == "," and layout.decimal is None:
        yield "decimal comma"
    if encoding:
        yield f"read as {encoding}"
    if parsed.lines_before:
        yield f"lines before the header that were left out: {parsed.lines_before}"
    if parsed.calendar.note:
        yield parsed.calendar.note
    if parsed.units:
        yield f"a row of units under the header ({', '.join(parsed.units)})"
    if not parsed.names:
        yield "no header line, so that its columns are numbered from 1"
