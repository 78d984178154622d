"""MATLAB files: version 4 by SciPy, version 5 (6, 7), version 7.3, which is HDF5, by h5py."""

from __future__ import annotations

from pathlib import Path

from fmu_didim.base.errors import InputError, loading
from fmu_didim.data.tables.readers.hdf5_file import read_hdf5
from fmu_didim.data.tables.readers.level5 import contents, is_level_5
from fmu_didim.data.tables.readers.nested import as_columns, leaves
from fmu_didim.data.tables.table import SignalTable

HDF5_MARK = b"MATLAB 7.3 MAT-file"


def read_mat(path: Path) -> SignalTable:
    """Columns of the variables of a MAT file: vectors, matrices (``q(1)``) and fields of structs (``log.q``).

    Raises:
        InputError: it holds nothing but objects of MATLAB, such as timetables.
    """
    with path.open("rb") as stream:
        if stream.read(len(HDF5_MARK)) == HDF5_MARK:
            return read_hdf5(path, separator=".")
    raw = path.read_bytes()
    if is_level_5(raw):
        named = contents(raw)
    else:
        with loading("scipy"):
            from scipy.io import loadmat

        named = {name: value for name, value in loadmat(path).items() if not name.startswith("__")}
    columns = as_columns(leaves(named))
    if not columns:
        raise InputError(
            "The MAT file holds no arrays of numbers.", where=str(path), got=", ".join(map(str, named)) or "nothing",
            valid="vectors, matrices and structs of these",
            next_step="Save timetables and timeseries as arrays: t = seconds(T.Time); q = T.Variables; save('log.mat', "
            "'t', 'q').",
        )  # fmt: skip
    return SignalTable(columns, source=str(path))
