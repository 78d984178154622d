"""Reading a file of signals by its suffix."""

from __future__ import annotations

import warnings
from pathlib import Path

from fmu_didim.base.errors import FmuDidimError, InputError
from fmu_didim.base.files import is_file
from fmu_didim.data.signals import Trajectory
from fmu_didim.data.tables.columns import TimeColumn
from fmu_didim.data.tables.readers import READER_OF
from fmu_didim.data.tables.readers.csv_file import CsvLayout, read_csv
from fmu_didim.data.tables.select import selected
from fmu_didim.data.tables.table import SignalTable


def read_table(path: Path | str, *, layout: CsvLayout | None = None) -> SignalTable:
    """The columns of a file, as they stand there.

    Args:
        layout: how a CSV file is written, where that cannot be recognised.

    Raises:
        InputError: the file is missing, has another format, is damaged or cannot be understood; LibraryError: what
            reads it does not work as it is installed.
    """
    path = Path(path)
    if not is_file(path):
        raise InputError("The data file does not exist.", where=str(path), next_step="Check the path in the case file.")
    reader = READER_OF.get(path.suffix.lower())
    if reader is None:
        raise InputError(
            "This file format is not read.", where=str(path), got=path.suffix, valid=READER_OF,
            next_step="Export it as one of these; CSV is the simplest.",
        )  # fmt: skip
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what matters is reported in our own words
            return read_csv(path, layout) if reader.read is read_csv else reader.read(path)
    except FmuDidimError:
        raise
    except Exception as error:
        raise InputError(
            "The data file cannot be read.", where=str(path), got=f"{type(error).__name__}: {str(error)[:200]}",
            next_step="Convert it to CSV, UTF-8.",
        ) from error  # fmt: skip


def read_trajectory(path: Path | str, *, time: str | None = None) -> Trajectory:
    """All signals of a file that have the length of its time column, under the names that they have there.

    Units that the file states (``Achse1 [°]``, a row of units, attributes, those of channels) become SI units.

    Args:
        path: a file in a format of ``READERS``; its suffix says which.
        time: name of the time column; by default ``t`` or ``time``.

    Raises:
        InputError: the file is missing, has another format, or holds no such time column.
    """
    return selected(read_table(path), time=TimeColumn(name=time)).signals
