"""A small file that states very many values is refused before memory is taken for them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmu_didim.base.errors import InputError
from fmu_didim.data.tables import read_table
from fmu_didim.data.tables.readers.size import MOST_VALUES

h5py = pytest.importorskip("h5py", reason="needs h5py")
pyarrow = pytest.importorskip("pyarrow", reason="needs pyarrow")
from pyarrow import parquet  # noqa: E402


def sparse(path: Path, *shapes: tuple[int, ...], kind: object = "f8") -> Path:
    with h5py.File(path, "w") as file:
        for i, shape in enumerate(shapes):
            file.create_dataset(f"a{i}", shape=shape, dtype=kind, chunks=True)
    return path


def repeated(path: Path, rows: int, *, groups: int = 1) -> Path:
    table = pyarrow.table({"t": pyarrow.array(np.zeros(rows, np.int8)), "s": pyarrow.array([""] * rows)})
    with parquet.ParquetWriter(path, table.schema, compression="zstd") as writer:
        for _ in range(groups):
            writer.write_table(table)
    return path


RECORD = np.dtype([("t", "f4"), ("q", "f4"), ("w", "f4"), ("many", "f4", (64,))])
BOMBS = {
    "one.h5": lambda path: sparse(path, (300_000_000,)),
    "bytes.h5": lambda path: sparse(path, (300_000_000,), kind="u1"),
    "many.h5": lambda path: sparse(path, *[(MOST_VALUES // 8 + 1,)] * 8),
    "records.h5": lambda path: sparse(path, (MOST_VALUES // 32,), kind=RECORD),
    "rows.parquet": lambda path: repeated(path, 1_000_000, groups=MOST_VALUES // 1_000_000 + 1),
}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.gate] if name == "rows.parquet" else []) for name in BOMBS]
)
def test_very_many_values_are_refused_before_they_are_read(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        pytest.fail("it was read")

    own = h5py.Dataset.__getitem__

    def dataset(self: Any, key: Any) -> Any:
        return own(self, key) if self.size < MOST_VALUES // 4 else refuse()

    path = BOMBS[name](tmp_path / name)
    assert path.stat().st_size < 10_000_000
    monkeypatch.setattr(parquet.ParquetFile, "read", refuse)
    monkeypatch.setattr(h5py.Dataset, "__getitem__", dataset)
    with pytest.raises(InputError, match="more values than are read at once") as caught:
        read_table(path)
    assert "next:" in str(caught.value)


def test_columns_that_are_no_numbers_neither_count_nor_are_read(tmp_path: Path) -> None:
    assert list(read_table(repeated(tmp_path / "a.parquet", 1000)).columns) == ["t"]
