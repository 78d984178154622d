"""Each reader of data files: the same signals, written as each format has them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.io import savemat

from fmu_didim.data.tables import READER_OF, read_trajectory

pytestmark = pytest.mark.smoke
T = np.arange(40) * 0.005
Q = np.column_stack([np.sin(3 * T), np.cos(2 * T)])


def text(path: Path, delimiter: str) -> None:
    """Degrees, with the units in the names."""
    header = delimiter.join(["t[s]", "q1[°]", "q2[°]"])
    rows = np.column_stack([T, np.degrees(Q)])
    np.savetxt(path, rows, delimiter=delimiter, header=header, comments="", encoding="utf-8")


def parquet(path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet

    degrees = [pa.field(f"q{j}", pa.float64(), metadata={"unit": "deg"}) for j in (1, 2)]
    schema = pa.schema([pa.field("t", pa.float64()), *degrees])
    pyarrow.parquet.write_table(pa.table([T, *np.degrees(Q).T], schema=schema), path)


def hdf5(path: Path) -> None:
    h5py = pytest.importorskip("h5py", reason="needs the extra hdf5 (h5py)")
    with h5py.File(path, "w") as file:
        for name, values in (("t", T), ("q1", Q[:, 0]), ("q2", Q[:, 1])):
            file[name] = np.degrees(values) if name != "t" else values
            file[name].attrs["unit"] = "deg" if name != "t" else "s"


def mf4(path: Path) -> None:
    asammdf = pytest.importorskip("asammdf", reason="needs the extra mf4 (asammdf)")
    with asammdf.MDF(version="4.10") as file:
        file.append([asammdf.Signal(np.degrees(Q[:, j]), T, "deg", f"q{j + 1}") for j in range(2)])
        file.save(path, overwrite=True)


def ros(path: Path) -> None:
    """The joints in an order of their own."""
    pytest.importorskip("rosbags", reason="needs the extra ros (rosbags)")
    from tests.bags import written

    written(path, T, {"q2": Q[:, 1], "q1": Q[:, 0]})


def mat(path: Path, format_: str = "5") -> None:
    savemat(path, {"t": T[:, None], "q1": Q[:, :1], "q2": Q[:, 1:]}, format=format_)


def mat_of_hdf5(path: Path) -> None:
    """Version 7.3, as MATLAB does: HDF5 behind a block of text."""
    h5py = pytest.importorskip("h5py", reason="needs the extra hdf5 (h5py)")
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in (("t", T), ("q1", Q[:, 0]), ("q2", Q[:, 1])):
            file[name] = values[None, :]
    with path.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")


WRITERS: dict[str, Callable[[Path], None]] = {
    "log.csv": lambda path: text(path, ","), "log.txt": lambda path: text(path, " "),
    "log.tsv": lambda path: text(path, "\t"), "level4.mat": lambda path: mat(path, "4"), "level5.mat": mat,
    "level73.mat": mat_of_hdf5, "log.parquet": parquet, "log.h5": hdf5, "log.hdf5": hdf5, "log.hdf": hdf5,
    "log.mf4": mf4, "log.mdf": mf4, "log.bag": ros, "log.mcap": ros, "log.db3": ros,
}  # fmt: skip
ROS = "/joint_states.position."


@pytest.mark.parametrize("name", WRITERS)
def test_reader(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    WRITERS[name](path)
    if name.endswith(".mdf") and not path.is_file():  # asammdf names files of version 4 so
        path.with_suffix(".mf4").rename(path)
    is_ros = READER_OF[path.suffix].name == "ROS"
    signals = read_trajectory(path, time="time /joint_states" if is_ros else None)
    names = [f"{ROS if is_ros else ''}q{j}" for j in (1, 2)]
    begin = signals.time[0] if is_ros else 0.0  # a recording begins when its first message arrives
    assert_allclose(signals.time - begin, T, atol=1e-9 if is_ros else 1e-12)
    assert_allclose(signals.select(names), Q, rtol=1e-12)


def test_every_suffix_is_tried() -> None:
    assert {Path(name).suffix for name in WRITERS} == set(READER_OF), "WRITERS above has a file of each suffix"
