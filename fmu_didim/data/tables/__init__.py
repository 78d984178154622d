"""Files of signals in the formats of ``readers``, and how their columns become signals in SI units."""

from fmu_didim.data.tables.clock import clock_column, instants
from fmu_didim.data.tables.columns import Column, TimeColumn
from fmu_didim.data.tables.read import read_table, read_trajectory
from fmu_didim.data.tables.readers import READER_OF
from fmu_didim.data.tables.readers.csv_file import CsvLayout
from fmu_didim.data.tables.select import Selected, selected
from fmu_didim.data.tables.table import SignalTable

__all__ = [
    "READER_OF", "Column", "CsvLayout", "Selected", "SignalTable", "TimeColumn", "clock_column", "instants",
    "read_table", "read_trajectory", "selected",
]  # fmt: skip
