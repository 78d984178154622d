"""Files of signals: CSV, MAT, HDF5, Parquet and MF4 tables, and how their columns become signals in SI units."""

from fmu_didim.data.tables.clock import clock_column, instants
from fmu_didim.data.tables.columns import Column, TimeColumn
from fmu_didim.data.tables.csv_file import CsvLayout
from fmu_didim.data.tables.read import READERS, read_table, read_trajectory
from fmu_didim.data.tables.select import Selected, selected
from fmu_didim.data.tables.table import SignalTable

__all__ = [
    "READERS", "Column", "CsvLayout", "Selected", "SignalTable", "TimeColumn", "clock_column", "instants",
    "read_table", "read_trajectory", "selected",
]  # fmt: skip
