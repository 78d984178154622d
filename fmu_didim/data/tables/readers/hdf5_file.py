"""HDF5 files, and MAT files of version 7.3: all arrays of numbers in all groups."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from fmu_didim.base.errors import InputError, loading
from fmu_didim.data.tables.readers.nested import as_columns
from fmu_didim.data.tables.readers.size import check_size
from fmu_didim.data.tables.table import SignalTable

UNIT_NAMES = ("unit", "units", "Unit", "Units")


def read_hdf5(path: Path, *, separator: str = "/") -> SignalTable:
    """Columns of the datasets of a file: ``group/q``, of matrices ``group/q(1)``, fields of records ``group/q``.

    Units are read from the attribute ``unit`` or ``units`` of a dataset.

    Args:
        separator: between the names of groups.
    """
    absent = InputError(
        "HDF5 files, and MAT files of version 7.3, need h5py.", where=str(path),
        next_step="pip install fmu_didim[hdf5], or save as MAT version 5 (save -v7) or CSV.",
    )  # fmt: skip
    with loading("h5py", absent=absent):
        import h5py
    named: dict[str, Any] = {}
    units: dict[str, str] = {}
    stated = 0

    def visit(name: str, item: Any) -> None:
        if not isinstance(item, h5py.Dataset) or name.startswith("#") or item.size < 2:
            return
        nonlocal stated
        stated += item.size * max(1, item.dtype.itemsize // 8, len(item.dtype.names or ()))
        check_size(stated, path)
        own = name.replace("/", separator)
        fields = item.dtype.names
        if fields:
            content = item[()]
            named.update({f"{own}{separator}{field}": content[field] for field in fields})
        elif item.dtype.kind in "fiub":
            named[own] = item[()]
            unit = next((item.attrs[key] for key in UNIT_NAMES if key in item.attrs), "")
            units[own] = unit.decode(errors="replace") if isinstance(unit, bytes) else str(unit)

    with h5py.File(path, "r") as file:
        file.visititems(visit)
    columns = as_columns(named.items())
    of_columns = {name: units.get(name, units.get(name.rpartition("(")[0], "")) for name in columns}
    return SignalTable(columns, {name: unit for name, unit in of_columns.items() if unit}, source=str(path))
