"""Trajectories: what is read, written and refused."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from fmu_didim.base.errors import InputError, UnknownNameError
from fmu_didim.data.signals import EXACT_DIGITS, MANY_LINES, Trajectory, Variable, trajectory, write_csv
from fmu_didim.data.tables import read_trajectory
from fmu_didim.data.tables.readers.level5 import contents
from tests.patience import Calls


def write(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def two_columns() -> Trajectory:
    time = 0.1 + np.arange(50) * 0.005
    return trajectory(time, {"q1": np.sin(time), "tau1": 1e5 * np.cos(time)}, {"q1": "rad"})


def test_csv_is_read(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", "q1, t ,tau1\n1.5,0,-2\n\n2.5,0.1,1e-3\n")
    got = read_trajectory(path)
    assert got.names == ("q1", "tau1")
    assert got.time.tolist() == [0.0, 0.1]
    assert got.values.tolist() == [[1.5, -2.0], [2.5, 1e-3]]
    assert got.source == str(path)


def test_csv_with_byte_order_mark_and_named_time(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("stamp,q\n0,1\n2,3\n", encoding="utf-8-sig")
    assert read_trajectory(path, time="stamp").time.tolist() == [0.0, 2.0]
    with pytest.raises(InputError, match=r"no time column[\s\S]*stamp, q[\s\S]*valid: t, time"):
        read_trajectory(path)


def test_mat_is_read(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    t = np.arange(5) * 0.25
    savemat(path, {"time": t[:, None], "q": t[None, :] ** 2, "rate": 4.0, "note": "text", "other": np.arange(3.0)})
    got = read_trajectory(path)
    assert got.names == ("q",)
    np.testing.assert_array_equal(got.time, t)
    np.testing.assert_array_equal(got.values[:, 0], t**2)


def test_written_csv_is_read_back(tmp_path: Path) -> None:
    before = two_columns()
    write_csv(before, tmp_path / "a.csv")
    after = read_trajectory(tmp_path / "a.csv")
    assert (tmp_path / "a.csv").read_text().splitlines()[0] == "t,q1,tau1"
    assert after.names == before.names
    np.testing.assert_allclose(after.time, before.time, rtol=1e-8)
    np.testing.assert_allclose(after.values, before.values, rtol=1e-8)
    # Nothing more is lost the second time.
    write_csv(after, tmp_path / "b.csv")
    assert read_trajectory(tmp_path / "b.csv").digest() == after.digest()


def test_many_lines_are_read_back_to_the_last_bit(tmp_path: Path) -> None:
    """Whatever the size of a number, from the smallest to the largest."""
    rng = np.random.default_rng(0)
    time = np.cumsum(rng.uniform(1e-3, 2e-3, MANY_LINES))
    values = rng.normal(size=time.size) * 10.0 ** rng.integers(-300, 300, time.size)
    values[:4] = 0.0, -0.0, np.finfo(float).max, np.finfo(float).tiny
    before = trajectory(time, {"q1": values})
    write_csv(before, tmp_path / "a.csv", digits=EXACT_DIGITS)
    after = read_trajectory(tmp_path / "a.csv")
    assert (tmp_path / "a.csv").read_text().splitlines()[0] == "t,q1"
    np.testing.assert_array_equal(after.time, before.time)
    np.testing.assert_array_equal(after.values[:, 0], values)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("t,q\n0,1\n1,2,3\n", r"not a row of numbers[\s\S]*bad\.csv, line 3[\s\S]*1,2,3[\s\S]*2 comma-separated"),
        ("t,q\n0,1\n\n1\n", r"line 4"),
        ("t,q\n0,1\n1,x\n", r"line 3[\s\S]*1,x"),
        ("a,q\n0,1\n", r"no time column"),
        ("t,q\n", r"no rows"),
        ("", r"no rows"),
        ("t\n0\n1\n", r"no signal"),
        ("t,q\n0,1\n1,nan\n2,3\n3,inf\n", r"not finite numbers[\s\S]*2 rows, the first one is row 1 .from 0., in q"),
        ("t,q\n0,1\nnan,1\n", r"not finite[\s\S]*in time"),
        ("t,q\n0,1\n1,2\n1,3\n", r"Time does not increase[\s\S]*row 2: t = 1 s after 1 s"),
        ("t,q\n0,1\n2,2\n1,3\n", r"row 2: t = 1 s after 2 s"),
        ("t,q\n0,1\n1,1_0\n", r"not a row of numbers[\s\S]*line 3[\s\S]*1_0"),
        ("t,q\n0,1\n1," + "9" * 200_000 + "\n", "not finite"),
        ("t,q\n0,1\n1,\0\n", r"line 3|NUL"),
    ],
)
def test_bad_csv_is_refused(tmp_path: Path, text: str, problem: str) -> None:
    path = write(tmp_path / "bad.csv", text)
    with pytest.raises(InputError, match=problem) as caught:
        read_trajectory(path)
    assert "bad.csv" in str(caught.value)


def test_missing_file_and_unknown_format(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"does not exist[\s\S]*nowhere\.csv"):
        read_trajectory(tmp_path / "nowhere.csv")
    with pytest.raises(InputError, match=r"not read[\s\S]*\.xls[\s\S]*\.csv[\s\S]*\.mat, \.parquet, \.h5"):
        read_trajectory(write(tmp_path / "a.xls", "t,q\n0,1\n"))


def test_broken_mat_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError):
        read_trajectory(write(tmp_path / "a.mat", "no matrix " * 50))


def test_doubled_columns_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError):
        read_trajectory(write(tmp_path / "a.csv", "t,q,q\n0,1,2\n1,3,4\n"))


def test_what_no_encoding_fits_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(b"t,temp\x81rature\n0,1\n1,2\n")
    with pytest.raises(InputError, match=r"a\.csv"):
        read_trajectory(tmp_path / "a.csv")


def test_tables_that_do_not_fit_are_refused() -> None:
    with pytest.raises(InputError, match=r"time \(3,\), values \(3, 2\), 1 names"):
        Trajectory(np.arange(3.0), np.zeros((3, 2)), (Variable("q"),))
    with pytest.raises(InputError, match="does not fit"):
        Trajectory(np.arange(4.0), np.zeros((3, 1)), (Variable("q"),))


def test_columns_by_name() -> None:
    signals = two_columns()
    assert [v.unit for v in signals.variables] == ["rad", ""]
    got = signals.select(["tau1", "q1"])
    np.testing.assert_array_equal(got[:, 0], 1e5 * np.cos(signals.time))
    np.testing.assert_array_equal(got[:, 1], np.sin(signals.time))
    with pytest.raises(UnknownNameError, match=r"no column named 'tau_1'[\s\S]*Did you mean 'tau1'\?"):
        signals.select(["q1", "tau_1"])


def test_digest_follows_the_content() -> None:
    base = two_columns()
    assert base.digest() == two_columns().digest()
    changed = base.values.copy()
    changed[7, 1] = np.nextafter(changed[7, 1], np.inf)
    others = [
        Trajectory(base.time, changed, base.variables),
        Trajectory(base.time + 1e-9, base.values, base.variables),
        Trajectory(base.time, base.values, (Variable("q1"), Variable("tau2"))),
    ]
    assert len({base.digest(), *(o.digest() for o in others)}) == 4


def test_integers_become_floats() -> None:
    got = trajectory(np.array([0, 1, 2]), {"q": np.array([1, 2, 3])})
    assert got.values.dtype == float
    assert got.time.dtype == float


@pytest.mark.gate
def test_a_table_of_very_many_columns_takes_no_longer_for_each(tmp_path: Path) -> None:
    each: dict[int, float] = {}
    for count in (2_000, 20_000):
        names = [f"column_{i}" for i in range(count)]
        rows = [",".join(["t", *names]), *(",".join([value] * (count + 1)) for value in "01")]
        path = write(tmp_path / f"{count}.csv", "\n".join(rows))
        with Calls() as calls:
            signals = read_trajectory(path)
            with pytest.raises(UnknownNameError, match=rf"column_0, .* and {count - 60} others") as caught:
                signals.select(["q1"])
        each[count] = calls.count / count
        assert len(str(caught.value)) < 3000
    assert each[20_000] < 1.1 * each[2_000]


def matlab(folder: Path, content: Mapping[str, object], **options: object) -> Path:
    savemat(folder / "a.mat", content, **options)
    return folder / "a.mat"


@pytest.mark.parametrize("options", [{}, {"do_compression": True}, {"format": "4"}], ids=str)
def test_matlab_files_are_read_as_scipy_does(tmp_path: Path, options: dict[str, object]) -> None:
    random = np.random.default_rng(1)
    content: dict[str, object] = {"t": np.arange(7.0)[:, None] / 8, "q1": random.normal(size=7), "n": np.arange(7)}
    if not options.get("format"):
        content |= {
            "single": random.normal(size=(1, 7)).astype(np.float32), "bits": np.arange(7, dtype=np.uint8),
            "long": np.arange(7) * 2**40, "text": "left out", "s": {"a": 1.0}, "c": np.array([1, "x"], dtype=object),
            "z": random.normal(size=7) + 1j, "one": 5.0, "table": random.normal(size=(7, 2)),
        }  # fmt: skip
    path = matlab(tmp_path, content, **options)
    known = {k: v for k, v in loadmat(path).items() if isinstance(v, np.ndarray)}
    known = {k: v for k, v in known.items() if v.size == 7 and v.dtype.kind in "fiu"}
    signals = read_trajectory(path)
    assert {"t", *signals.names} - {"table(1)", "table(2)"} == set(known) >= {"t", "q1", "n"}
    for name in known.keys() - {"t"}:
        np.testing.assert_array_equal(signals.column(name), np.ravel(known[name]))
    np.testing.assert_array_equal(signals.time, np.arange(7) / 8)


def test_a_table_in_a_matlab_file_has_the_order_of_its_rows(tmp_path: Path) -> None:
    table = np.arange(6.0).reshape(3, 2)
    raw = matlab(tmp_path, {"table": table}).read_bytes()
    np.testing.assert_array_equal(contents(raw)["table"], table)


DAMAGED = {
    "an unknown type": (b"\x09\0\0\0\x38\0\0\0", b"\x7f\0\0\0\x38\0\0\0", "the values of a matrix are of the type 127"),
    "too long": (b"\x09\0\0\0\x38\0\0\0", b"\x09\0\0\0\xff\xff\0\0", "reaches beyond its end"),
    "less than it says": (b"\x07\0\0\0\x01\0\0\0", b"\x09\0\0\0\x01\0\0\0", r"of \[9, 1\] holds 7 numbers"),
    "no flags": (b"\x06\0\0\0\x08\0\0\0", b"\x05\0\0\0\x08\0\0\0", "does not begin with its flags"),
    "complex by a turned bit": (b"\x06\0\0\0\0\0\0\0", b"\x06\x08\0\0\0\0\0\0", "no time column"),
}
"""What is replaced in a sound file, by what, and what is told; SciPy's reader crashes on the first and the last."""


@pytest.mark.parametrize("damage", DAMAGED)
def test_damaged_matlab_files_are_refused(tmp_path: Path, damage: str) -> None:
    old, new, told = DAMAGED[damage]
    path = matlab(tmp_path, {"t": np.arange(7.0)[:, None], "q": np.arange(7.0)[:, None]})
    raw = path.read_bytes()
    assert raw.count(old) == 2
    path.write_bytes(raw.replace(old, new, 1))
    with pytest.raises(InputError, match=told):
        read_trajectory(path)


@pytest.mark.parametrize("digits", [9, 17])
@pytest.mark.parametrize("count", [1, 1000, 2001])
def test_csv_that_is_written_is_that_of_numpy(tmp_path: Path, count: int, digits: int) -> None:
    """To the last character, although many lines are written at once."""
    time = np.arange(count) / 7.0
    values = np.random.default_rng(1).normal(size=(count, 2)) * 10.0 ** np.arange(-9, 9, 18 / count)[:count, None]
    values[0] = 0.0, -0.0
    write_csv(trajectory(time, {"q1": values[:, 0], "100%": values[:, 1]}), tmp_path / "a.csv", digits=digits)
    np.savetxt(
        tmp_path / "b.csv", np.column_stack([time, values]), f"%.{digits}g", ",", header="t,q1,100%", comments="",
        newline="\n",
    )  # fmt: skip
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()
