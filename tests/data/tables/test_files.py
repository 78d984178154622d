"""Files of signals as loggers write them: what is found out about them, what is told, what is refused."""

from __future__ import annotations

import csv as csv_module
import math
from collections import Counter
from collections.abc import Callable, Iterator
from math import nan
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.io import savemat

from fmu_didim.base.errors import InputError
from fmu_didim.data.tables import READER_OF, CsvLayout, read_table, read_trajectory
from tests.conftest import package

NO_HEADER = "no header line, so that its columns are numbered from 1"
N = 40
T = np.arange(N) * 0.005
Q = np.column_stack([np.sin(3 * T), np.cos(2 * T)])


def csv(path: Path, text: str, encoding: str = "utf-8") -> Path:
    path.write_bytes(text.encode(encoding))
    return path


@pytest.mark.parametrize(
    ("text", "columns", "units", "notes"),
    [
        ("t,q1\n0,1\n0.5,2\n", {"t": [0, 0.5], "q1": [1, 2]}, {}, ()),
        ("t;q1\n0,0;1,5\n0,5;2\n", {"t": [0, 0.5], "q1": [1.5, 2]}, {}, ("semicolon-separated", "decimal comma")),
        # A comma that comes only in a late row is a decimal comma all the same.
        ("t;q1\n" + "0;1\n" * 999 + "1;2,5\n", {"q1": [1] * 999 + [2.5]}, {}, ("semicolon-separated", "decimal comma")),
        ("t\tq1\n0\t1e-3\n1\t2\n", {"q1": [0.001, 2]}, {}, ("tab-separated",)),
        ("  t   q1\n  0   1\n  1  -2\n", {"t": [0, 1], "q1": [1, -2]}, {}, ("space-separated",)),
        ("x\n0,5\n1\n", {"x": [0.5, 1]}, {}, ("decimal comma",)),
        ("t;q;\n0;1;\n1;2;\n", {"t": [0, 1], "q": [1, 2]}, {}, ("semicolon-separated",)),
        (
            "t,q1\ns,deg\n0,1\n1,2\n",
            {"q1": [1, 2]},
            {"t": "s", "q1": "deg"},
            ("a row of units under the header (s, deg)",),
        ),
        (
            "t,q1,n\n[s],[°],-\n0,1,1\n1,2,1\n",
            {"q1": [1, 2]},
            {"q1": "°", "n": ""},
            ("a row of units under the header (s, °, -)",),
        ),
        (
            "Logger 3;\nDatum;01.05.2026;x\n\nZeit [ms];Achse1 [°]\n0;1\n5;2\n",
            {"Zeit [ms]": [0, 5], "Achse1 [°]": [1, 2]},
            {"Achse1 [°]": "°"},
            ("semicolon-separated", "lines before the header that were left out: 2"),
        ),
        ("0;1,5\n1;2,5\n", {"1": [0, 1], "2": [1.5, 2.5]}, {}, ("semicolon-separated", "decimal comma", NO_HEADER)),
        ("# t,q1\n0,1\n1,2\n", {"t": [0, 1], "q1": [1, 2]}, {}, ()),
        # The unit of a name that is none: an index, a word.
        ("t,q[1],x (left side)\n0,1,1\n1,2,1\n", {"q[1]": [1, 2]}, {"q[1]": "", "x (left side)": ""}, ()),
    ],
)
def test_what_is_found_out(
    tmp_path: Path, text: str, columns: dict[str, list[float]], units: dict[str, str], notes: tuple[str, ...]
) -> None:
    table = read_table(csv(tmp_path / "a.csv", text))
    for name, expected in columns.items():
        assert table.columns[name].tolist() == expected
    assert {name: table.unit(name) for name in units} == units
    assert table.notes == notes


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        # A decimal comma in a file that is separated by commas.
        ("t,q1\n0,00,1,50\n0,01,1,60\n", r"4 comma-separated[\s\S]*as many names|not a row of numbers"),
        # Two columns of integers, or one with a decimal comma: nobody can know.
        ("0,1\n1,2\n", r"several ways[\s\S]*2 columns by comma, decimal point; 1 columns by line, decimal comma"),
        ("t;q1\n0;1.234,5\n1;2\n", r"not a row of numbers[\s\S]*line 2[\s\S]*1\.234,5"),
        ("t,q1\n0,1\n1,2,3\n", r"line 3"),
        # The 5th of January or the 1st of May.
        ("t,q1\n05/01/2026 12:00:00,1\n05/01/2026 12:00:01,2\n", r"day or with the month[\s\S]*05/01/2026"),
        ("t,q1\n2026-02-31 12:00:00,1\n2026-02-31 12:00:01,2\n", r"no rows of numbers|not a row of numbers"),
        ("t,q1\n01:00:00 PM,1\n01:00:01 PM,2\n", r"no rows of numbers|not a row of numbers"),
        # A column is of stamps or of numbers.
        ("t,q1\n12:00:00,1\n5,2\n", r"line 3"),
        ("t,q1\n1,1\n12:00:00,2\n", r"line 3"),
        ("t,q1\n0,1_0\n1,2\n", r"not a row of numbers|no rows"),
    ],
)
def test_what_nobody_can_know_is_refused(tmp_path: Path, text: str, problem: str) -> None:
    with pytest.raises(InputError, match=problem) as caught:
        read_table(csv(tmp_path / "a.csv", text))
    assert "a.csv" in str(caught.value)


def test_a_layout_that_does_not_fit_is_left_early(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A long log is read once, not once for each layout."""
    rows, read = 5000, Counter[str]()

    class Counting:
        def __init__(self, *arguments: Any, **options: Any) -> None:
            self.own, self.delimiter = reader(*arguments, **options), options["delimiter"]

        def __iter__(self) -> Iterator[list[str]]:
            for row in self.own:
                read[self.delimiter] += 1
                yield row

        @property
        def line_num(self) -> int:
            return int(self.own.line_num)

    reader = csv_module.reader
    monkeypatch.setattr(csv_module, "reader", Counting)
    text = "axis 1|2, as\tit ran\nt;a;b\n" + "".join(f"{k};{k}.5;\n" for k in range(rows))
    assert read_table(csv(tmp_path / "a.csv", text)).columns["a"].size == rows
    assert read.pop(";") < 3 * rows
    assert max(read.values()) < rows // 4  # 500 lines without numbers, with either decimal sign


EMPTY = [
    "t,a,b\n0,1,10\n1,2,\n2,,30\n",
    "t,a,b,\n0,1,10,\n1,2,,\n2,,30,\n",  # a delimiter at the end of each line
    "t,a,b\n0,1,10,\n1,2,,\n2,,30,\n",  # or of those with numbers
    "t;a;b\n0;1;10\n1;2;\n2;;30\n",
    "t\ta\tb\n0\t1\t10\n1\t2\t\n2\t\t30\n",
    "s,V,A\n0,1,10\n1,2,\n2,,30\n",
]


@pytest.mark.parametrize("text", EMPTY)
def test_an_empty_cell_is_no_number(tmp_path: Path, text: str) -> None:
    (tmp_path / "log.csv").write_text(text, encoding="utf-8")
    columns = list(read_table(tmp_path / "log.csv").columns.values())
    np.testing.assert_array_equal(columns, [[0, 1, 2], [1, 2, np.nan], [10, np.nan, 30]])


@pytest.mark.parametrize(
    ("text", "columns"),
    [
        ("t,a,b\n0,1,\n1,2,3\n", [[0, 1], [1, 2], [np.nan, 3]]),  # the first row ends in an empty cell
        ("0,1,\n1,2,3\n", [[0, 1], [1, 2], [np.nan, 3]]),
        ("0,1,\n1,2,\n", [[0, 1], [1, 2]]),
        ("t,a\n[s],[V]\n0,\n1,2\n", [[0, 1], [np.nan, 2]]),
    ],
)
def test_what_the_last_delimiter_of_the_first_row_means(tmp_path: Path, text: str, columns: list[list[float]]) -> None:
    (tmp_path / "log.csv").write_text(text, encoding="utf-8")
    np.testing.assert_array_equal(list(read_table(tmp_path / "log.csv").columns.values()), columns)


@pytest.mark.parametrize(
    ("text", "seconds", "note"),
    [
        ("t,q1\n2026-05-01 12:00:00.5,1\n2026-05-01 12:00:01,2\n", [43200.5, 43201], "2026-05-01 0:00"),
        ("t;q1\n01.05.2026 12:00:00,5;1,5\n01.05.2026 12:00:01;2\n", [43200.5, 43201], "2026-05-01 0:00"),
        # Over midnight; a zone counts.
        ("t,q1\n2026-05-01T23:59:59Z,1\n2026-05-02T02:00:01+02:00,2\n", [86399, 86401], "2026-05-01 0:00"),
        ("t,q1\n23:59:58.25,1\n23:59:59,2\n", [86398.25, 86399], "0:00"),
        # A date above the table is none of its stamps; date and time may be columns of their own.
        ("Datum;30.04.2026;x\nDatum;t;q1\n01.05.2026;0:00:10;1\n01.05.2026;0:00:11;2\n", [10, 11], "2026-05-01 0:00"),
    ],
)
def test_calendar_stamps_are_seconds_of_the_day(tmp_path: Path, text: str, seconds: list[float], note: str) -> None:
    table = read_table(csv(tmp_path / "a.csv", text))
    assert table.columns["t"].tolist() == seconds
    assert table.unit("t") == "s"
    assert f"calendar times, counted in s from {note}" in table.notes
    assert_array_equal(table.columns["q1"][-1], 2)
    assert read_trajectory(tmp_path / "a.csv", time="t").time.tolist() == seconds


def test_times_of_day_do_not_go_on_over_midnight_unseen(tmp_path: Path) -> None:
    path = csv(tmp_path / "a.csv", "t,q1\n23:59:59.5,1\n0:00:00,2\n0:00:00.5,3\n")
    with pytest.raises(InputError, match=r"Time does not increase[\s\S]*86399"):
        read_trajectory(path)


def test_layout_may_be_stated(tmp_path: Path) -> None:
    path = csv(tmp_path / "a.csv", "0,1\n1,2\n")
    assert read_table(path, layout=CsvLayout(delimiter=",")).columns["2"].tolist() == [1, 2]
    with pytest.raises(InputError, match=r"not a row of numbers|no rows"):
        read_table(path, layout=CsvLayout(delimiter=";"))
    path = csv(tmp_path / "b.csv", "1;2\nt;q\n0;1\n1;2\n")
    assert list(read_table(path, layout=CsvLayout(skip_lines=1)).columns) == ["t", "q"]


@pytest.mark.parametrize(("encoding", "told"), [("utf-8-sig", False), ("cp1252", True), ("utf-16", True)])
def test_encodings(tmp_path: Path, encoding: str, told: bool) -> None:
    table = read_table(csv(tmp_path / "a.csv", "t,Größe [°]\n0,1\n1,2\n", encoding))
    assert table.columns["Größe [°]"].tolist() == [1, 2]
    assert any("read as" in note for note in table.notes) is told


def mat5(path: Path) -> None:
    log = {"t": T, "q": Q, "info": {"n": 3.0, "who": "x"}}
    more = np.array([(T,), (2 * T,)], dtype=[("v", object)])
    savemat(path, {"log": log, "rate": 200.0, "note": "text", "tau": Q.T, "more": more})


def mat73(path: Path) -> None:
    h5py = package("h5py")
    with h5py.File(path, "w", userblock_size=512) as file:  # as MATLAB does: HDF5 behind a block of text, transposed
        file["log/t"], file["log/q"], file["tau"], file["rate"] = T[None, :], Q.T, Q, [[200.0]]
        file["more(1)/v"], file["more(2)/v"] = T[None, :], 2 * T[None, :]
    with path.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512))


@pytest.mark.parametrize("write", [mat5, mat73])
def test_mat_files(tmp_path: Path, write: Callable[[Path], None]) -> None:
    write(tmp_path / "a.mat")
    table = read_table(tmp_path / "a.mat")
    assert set(table.columns) == {"log.t", "log.q(1)", "log.q(2)", "tau(1)", "tau(2)", "more(1).v", "more(2).v"}
    for i in range(2):
        assert_array_equal(table.columns[f"log.q({i + 1})"], Q[:, i])
        assert_array_equal(table.columns[f"tau({i + 1})"], Q[:, i])
    assert_array_equal(table.columns["more(2).v"], 2 * T)


def test_side_of_a_matrix_that_is_time(tmp_path: Path) -> None:
    """Three samples of forty signals: the vectors of the file tell, not the longer side."""
    savemat(tmp_path / "a.mat", {"t": np.arange(3.0), "q": np.arange(120.0).reshape(3, 40)})
    table = read_table(tmp_path / "a.mat")
    assert table.columns["q(40)"].tolist() == [39, 79, 119]


def test_hdf5_groups_units_and_records(tmp_path: Path) -> None:
    h5py = package("h5py")
    record = np.zeros(N, dtype=[("t", float), ("pos", "f4")])
    record["t"], record["pos"] = T, Q[:, 0]
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["run/q"] = np.degrees(Q)
        file["run/q"].attrs["unit"] = "deg"
        file["rec"] = record
    table = read_table(tmp_path / "a.h5")
    assert table.unit("run/q(2)") == "deg"
    assert_allclose(table.columns["run/q(2)"], np.degrees(Q[:, 1]))
    assert_allclose(table.columns["rec/pos"], Q[:, 0], rtol=1e-6)
    signals = read_trajectory(tmp_path / "a.h5", time="rec/t")
    assert_allclose(signals.column("run/q(2)"), Q[:, 1])


def test_parquet(tmp_path: Path) -> None:
    import pyarrow as pa
    from pyarrow import parquet

    schema = pa.schema(
        [pa.field("time", pa.float64()), pa.field("q1", pa.float32(), metadata={"unit": "deg"}), ("who", pa.string())]
    )
    table = pa.table([T, np.degrees(Q[:, 0]).astype("f4"), ["x"] * N], schema=schema)
    parquet.write_table(table, tmp_path / "a.parquet")
    signals = read_trajectory(tmp_path / "a.parquet")
    assert signals.names == ("q1",)
    assert_allclose(signals.column("q1"), Q[:, 0], rtol=1e-6)


def mf4(path: Path, every: int = 1) -> None:
    """Two groups of channels: positions at 200 Hz, a current ``every`` times as slow."""
    asammdf = package("asammdf")
    signal = asammdf.Signal
    file = asammdf.MDF(version="4.10")
    file.append([signal(np.degrees(Q[:, j]), T, "deg", f"Achse{j + 1}") for j in range(2)])
    file.append([signal(5 * Q[::every, 0], T[::every], "A", "Strom")])
    file.save(path, overwrite=True)
    file.close()


def test_mf4_channels_keep_their_own_instants(tmp_path: Path) -> None:
    mf4(tmp_path / "a.mf4", every=4)
    table = read_table(tmp_path / "a.mf4")
    assert_allclose(table.columns["Achse2"], np.degrees(Q[:, 1]))
    assert table.unit("Strom") == "A"
    assert table.times == {"Achse1": "time 0", "Achse2": "time 0", "Strom": "time 1"}
    assert_allclose(table.columns["time 1"], T[::4])


def test_nothing_is_resampled_unasked(tmp_path: Path) -> None:
    mf4(tmp_path / "a.mf4", every=4)
    with pytest.raises(InputError, match=r"different instants[\s\S]*time 0: 40 rows, time 1: 10 rows[\s\S]*resampled"):
        read_trajectory(tmp_path / "a.mf4")


@pytest.mark.parametrize("suffix", [".bag", ".mcap", ".db3"])
def test_ros_topics_by_field_and_joint(tmp_path: Path, suffix: str) -> None:
    """Some messages name the joints in another order; a list without names is counted; an image is no signal."""
    package("rosbags")
    from tests.bags import ARRIVAL_NS, written

    path, both = tmp_path / f"a{suffix}", {"elbow": Q[:, 1], "shoulder": Q[:, 0]}
    efforts = {name: 3 * q for name, q in both.items()}
    written(path, T, both, efforts=efforts, commands=(Q[:, 0], T), turned_every=3, picture_of=1000)
    table = read_table(path)
    for name, q in both.items():
        assert_allclose(table.columns[f"/joint_states.position.{name}"], q)
        assert_allclose(table.columns[f"/joint_states.effort.{name}"], 3 * q)
        assert table.times[f"/joint_states.effort.{name}"] == "time /joint_states"
    assert_allclose(table.columns["/command.data.2"], T)
    assert not [name for name in table.columns if "picture" in name or "velocity" in name]
    late = table.columns["time /command"] - table.columns["time /joint_states"]
    assert_allclose(late, 0, atol=1e-9)  # stamps of the one, arrival of the other
    assert table.columns["time /command"][0] == pytest.approx(0, abs=2e-9 * ARRIVAL_NS)
    notes = " ".join(table.notes)
    assert "instants of /command: those of arrival" in notes and "not read: /picture" in notes


@pytest.mark.parametrize(
    ("stamped", "offset_s", "told"), [(True, 0.0, ""), (False, 0.0, "arrival"), (True, -500.0, "another clock")]
)
def test_ros_stamps(tmp_path: Path, stamped: bool, offset_s: float, told: str) -> None:
    package("rosbags")
    from tests.bags import written

    written(tmp_path / "a.mcap", T, {"q1": Q[:, 0]}, is_stamped=stamped, stamp_offset_s=offset_s)
    table = read_table(tmp_path / "a.mcap")
    assert_allclose(np.diff(table.columns["time /joint_states"]), np.diff(T), atol=1e-9)
    assert told in " ".join(table.notes) and bool(told) is bool(table.notes)


def test_units_of_a_file_are_applied(tmp_path: Path) -> None:
    path = csv(tmp_path / "a.csv", "Zeit [ms];q1 [°];n [U/min]\n0;180;60\n5;90;30\n")
    signals = read_trajectory(path)
    assert_allclose(signals.time, [0, 0.005])
    assert_allclose(signals.column("q1"), [math.pi, math.pi / 2])
    assert_allclose(signals.column("n"), [2 * math.pi, math.pi])


@pytest.mark.parametrize("suffix", READER_OF)
def test_damaged_files_are_refused(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    path.write_bytes(b"no signals " * 50)
    with pytest.raises(InputError, match=rf"a\{suffix}"):
        read_table(path)


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("t,a,b\n0,1,2\n1,,3\n2,4,\n3,,\n", [[0, 1, 2], [1, nan, 3], [2, 4, nan], [3, nan, nan]]),
        ("t,a\n0,\n1,5\n", [[0, nan], [1, 5]]),
        ("t;a;b\n0;1,5;\n1;;2\n", [[0, 1.5, nan], [1, nan, 2]]),
        ("t,a,\n0,1,\n1,,\n", [[0, 1], [1, nan]]),  # a delimiter ends each line
        ("# log,,\nt,a,b\n0,,1\n", [[0, nan, 1]]),
    ],
)
def test_empty_cells_are_no_numbers(tmp_path: Path, text: str, wanted: list[list[float]]) -> None:
    path = tmp_path / "log.csv"
    path.write_text(text, encoding="utf-8")
    table = read_table(path)
    np.testing.assert_array_equal(np.column_stack(list(table.columns.values())), np.array(wanted, dtype=float))
