"""Parquet files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from fmu_didim.base.errors import loading
from fmu_didim.data.signals import Array
from fmu_didim.data.tables.readers.size import check_size
from fmu_didim.data.tables.table import SignalTable


def read_parquet(path: Path) -> SignalTable:
    """The numeric columns of a Parquet file; units from the entry ``unit`` in the metadata of a column."""
    with loading("pyarrow"):
        from pyarrow import parquet, types  # type: ignore[import-not-found,import-untyped,unused-ignore]
    with parquet.ParquetFile(path) as file:  # ``read_table`` imports data sets, and with them pandas
        fields = [f for f in file.schema_arrow if types.is_floating(f.type) or types.is_integer(f.type)]
        check_size(file.metadata.num_rows * len(fields), path)
        table = file.read(columns=[f.name for f in fields])
    units = {f.name: (f.metadata or {}).get(b"unit", b"").decode(errors="replace") for f in fields}
    return SignalTable(
        {f.name: _values(table[f.name]) for f in fields},
        {name: unit for name, unit in units.items() if unit}, source=str(path),
    )  # fmt: skip


def _values(column: Any) -> Array:
    """A column as floats, nulls as NaN; without pandas, which pyarrow's own ``to_numpy`` imports (0.3 s)."""
    numbers = column.cast("float64", safe=False).combine_chunks()
    return np.array(np.from_dlpack(numbers.fill_null(np.nan) if numbers.null_count else numbers))
