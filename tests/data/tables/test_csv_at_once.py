"""Rows of a CSV file that are read at once are what they are one by one, whatever else stands in it."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pytest

from fmu_didim.base.errors import InputError
from fmu_didim.data.tables.readers import csv_file
from fmu_didim.data.tables.table import SignalTable

ODD = [
    "nan",
    "inf",
    "",
    " 4",
    "5 ",
    "1_0",
    "x",
    "0x10",
    "1,5",
    "٣",
    "+7",
    "1e400",
    '"8"',
    "#",
    "- 1",
    "1d3",
    "12:30:00",
]
"""Cells that some readers take for numbers and others do not."""


def drawn(seed: int) -> str:
    """A small file: some with odd cells, rows of other lengths, empty lines or a delimiter at the end of each."""
    rng = random.Random(seed)
    count, delimiter, odd = rng.randint(1, 4), rng.choice(",;\t| "), rng.choice([0.0, 0.05])

    def cell() -> str:
        return rng.choice(ODD) if rng.random() < odd else f"{rng.uniform(-9, 9):.6g}"

    rows = [delimiter.join(cell() for _ in range(count + (rng.random() < 0.01))) for _ in range(rng.randint(1, 12))]
    if rng.random() < 0.2:
        rows.insert(rng.randrange(len(rows) + 1), rng.choice(["", " ", delimiter * count]))
    if rng.random() < 0.2:
        rows = [row + delimiter for row in rows]
    head = [delimiter.join(f"c{i}" for i in range(count))] if rng.random() < 0.8 else []
    return "\n".join(head + rows) + rng.choice(["", "\n", "\n\n", "\n "])


def read(path: Path) -> SignalTable | str:
    try:
        return csv_file.read_csv(path)
    except InputError as error:
        return str(error)


def test_rows_at_once_are_those_one_by_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, at_once, plain = tmp_path / "log.csv", 0, csv_file._plain
    for seed in range(400):
        path.write_text(drawn(seed), encoding="utf-8")
        monkeypatch.setattr(csv_file, "_plain", plain)
        found = read(path)
        monkeypatch.setattr(csv_file, "_plain", lambda *_: None)
        one_by_one = read(path)
        if isinstance(found, str) or isinstance(one_by_one, str):
            assert found == one_by_one, drawn(seed)
            continue
        at_once += 1
        assert (found.units, found.notes, found.calendar) == (one_by_one.units, one_by_one.notes, one_by_one.calendar)
        assert list(found.columns) == list(one_by_one.columns)
        for name, column in found.columns.items():
            np.testing.assert_array_equal(column, one_by_one.columns[name], err_msg=drawn(seed))
    assert at_once > 100
