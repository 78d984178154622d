"""Parquet files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fmu_didim.base.errors import loading
from fmu_didim.data.tables.table import SignalTable


def read_parquet(path: Path) -> SignalTable:
    """The numeric columns of a Parquet file; units from the entry ``unit`` in the metadata of a column."""
    with loading("pyarrow"):
        from pyarrow import parquet, types  # type: ignore[import-not-found,import-untyped,unused-ignore]
    table = parquet.read_table(path)
    fields = [f for f in table.schema if types.is_floating(f.type) or types.is_integer(f.type)]
    units = {f.name: (f.metadata or {}).get(b"unit", b"").decode(errors="replace") for f in fields}
    return SignalTable(
        {f.name: np.asarray(table[f.name].to_numpy(), dtype=float) for f in fields},
        {name: unit for name, unit in units.items() if unit}, source=str(path),
    )  # fmt: skip
