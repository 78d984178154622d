"""Formats of data files, one per file, and the table of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from fmu_didim.data.tables.readers.csv_file import read_csv
from fmu_didim.data.tables.readers.hdf5_file import read_hdf5
from fmu_didim.data.tables.readers.mat_file import read_mat
from fmu_didim.data.tables.readers.mf4_file import read_mf4
from fmu_didim.data.tables.readers.parquet_file import read_parquet
from fmu_didim.data.tables.readers.ros_file import read_ros
from fmu_didim.data.tables.table import SignalTable


@dataclass(frozen=True)
class Reader:
    """A format of data files.

    Attributes:
        name: as the documentation writes it; suffixes: of its files, in small letters.
        read: from the path of a file that exists to its columns.
    """

    name: str
    suffixes: tuple[str, ...]
    read: Callable[[Path], SignalTable]


READERS = (
    Reader("CSV", (".csv", ".txt", ".tsv"), read_csv),
    Reader("MAT", (".mat",), read_mat),
    Reader("Parquet", (".parquet",), read_parquet),
    Reader("HDF5", (".h5", ".hdf5", ".hdf"), read_hdf5),
    Reader("MF4", (".mf4", ".mdf"), read_mf4),
    Reader("ROS", (".bag", ".mcap", ".db3"), read_ros),
)
READER_OF: Mapping[str, Reader] = {suffix: reader for reader in READERS for suffix in reader.suffixes}
"""By suffix."""
