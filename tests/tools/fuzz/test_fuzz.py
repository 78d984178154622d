"""Some inputs of each kind, as ``python -m tests.tools.fuzz`` reads them by the thousand."""

from __future__ import annotations

from pathlib import Path

import pytest

from fmu_didim.data.tables.readers import READERS, Reader
from tests.conftest import package
from tests.tools.fuzz.__main__ import fuzz
from tests.tools.fuzz.targets import KINDS, make

NOT_FUZZED = {
    "MF4": "asammdf may come to no end with a damaged file, as docs/trust.md says",
    "ROS": "rosbags takes what memory a damaged file states, as docs/trust.md says",
}
"""Formats of data files, with the reason."""


def read(kind: str, folder: Path, monkeypatch: pytest.MonkeyPatch, *, seed: int, count: int) -> None:
    if kind == "hdf5":
        package("h5py")
    monkeypatch.setenv("FMU_DIDIM_FUZZ", str(folder))
    found = fuzz(kind, seed, count, folder)
    assert not found.wrong, found.wrong
    assert found.counts["taken"] + found.counts["refused"] == count
    assert found.counts["refused"]


@pytest.mark.gate
@pytest.mark.parametrize(
    "kind",
    [pytest.param(k, marks=() if k in {"case", "csv", "fmu-xml"} else pytest.mark.slow) for k in KINDS if k != "ssp"],
)
def test_few_inputs(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read(kind, tmp_path, monkeypatch, seed=1, count=20)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_many_inputs(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read(kind, tmp_path, monkeypatch, seed=2, count=1000)


@pytest.mark.gate
@pytest.mark.parametrize("kind", ["case", "robot", "controller", "csv", "mat", "fmu-xml", "fmu-archive"])
def test_inputs_are_the_same_again(kind: str) -> None:
    made = [make(kind, 0, number) for number in range(200)]
    assert made[:20] == [make(kind, 0, number) for number in range(20)]
    assert len(set(made)) > 100


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_each_format_of_data_files_is_fuzzed(reader: Reader) -> None:
    fuzzed = any(kind.suffix in reader.suffixes for kind in KINDS.values())
    assert fuzzed is not (reader.name in NOT_FUZZED), "add a row to KINDS in tests/tools/fuzz/targets.py"
