"""Campaigns whose runner is killed, or that two runners share: nothing is lost, nothing is run again."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pytest
import yaml
from pyarrow import parquet

from fmu_didim.base import files
from fmu_didim.campaigns.campaign import campaign
from fmu_didim.campaigns.reporting.results import Results
from fmu_didim.campaigns.running.store import ROW, Journal, Store, read_lines
from tests.campaigns.helpers import CASE
from tests.helpers import ROOT
from tests.patience import patience, wait_until

CONTENT = {
    "name": "resumed", "case": str(CASE), "noise": {"relative": 0.05}, "seeds": 6,
    "vary": {"train.torque.rate_hz": [20, 10]},
}  # fmt: skip


def begun(file: Path, out: Path, *options: str) -> subprocess.Popen[bytes]:
    """A runner in a process of its own."""
    options = options or ("--workers", "2")
    command = [sys.executable, "-m", "fmu_didim.cli.main", "campaign", "run", str(file), "--out", str(out), *options]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)


def raw_rows(out: Path) -> Iterator[dict[str, Any]]:
    """All rows of all journals and parts, as often as they are there."""
    for path in (out / "parts").glob("*.parquet"):
        yield from parquet.read_table(path).to_pylist()
    for path in (out / "journal").glob("*.jsonl"):
        yield from read_lines(path)


def rows_in(out: Path) -> int:
    """How many runs have a row."""
    return len({(row["id"], row["started"]) for row in raw_rows(out)})


def table(out: Path) -> pd.DataFrame:
    """What was found, apart from times."""
    found = Results(Store(out)).to_frame()
    return found.drop(columns=["seconds", "cpu_seconds", "started", "host"]).sort_values("id", ignore_index=True)


def killed_and_resumed(tmp_path: Path, kills: int, seeds: int, *, early: float) -> None:
    """Kill the runner so often, after the first to the third row of its own or, with the probability ``early``, at any
    moment of the time that a whole campaign takes."""
    file = tmp_path / "campaign.yaml"
    file.write_text(yaml.safe_dump({**CONTENT, "seeds": seeds}))
    start = time.monotonic()
    campaign(file, tmp_path / "undisturbed").run(workers=2)
    whole = time.monotonic() - start
    out, rng = tmp_path / "killed", random.Random(kills)
    done = []
    for _ in range(kills):
        before, wanted = rows_in(out), rng.randrange(1, 4)
        runner = begun(file, out)
        assert runner.stdout is not None
        if rng.random() < early:
            time.sleep(whole * rng.random())
        else:
            wait_until(lambda: runner.poll() is not None or rows_in(out) >= before + wanted, "row")  # noqa: B023
            done.append(rows_in(out))
        runner.send_signal(signal.SIGKILL)
        runner.wait()
        runner.stdout.close()
    runner = begun(file, out)
    said = runner.communicate(timeout=patience(300))[0].decode()
    assert runner.returncode == 0, said
    count = 2 * seeds
    assert f"{count} of {count} runs done ({count} valid)" in said
    runs = {(row["id"], row["started"]) for row in raw_rows(out)}
    assert len(runs) == len({id_ for id_, _ in runs}) == count
    assert any(0 < rows < count for rows in done)
    pd.testing.assert_frame_equal(table(out), table(tmp_path / "undisturbed"))


@pytest.mark.slow
def test_killed_and_resumed(tmp_path: Path) -> None:
    killed_and_resumed(tmp_path, 1, 4, early=0.0)


@pytest.mark.slow
def test_killed_at_twenty_moments_and_resumed(tmp_path: Path) -> None:
    killed_and_resumed(tmp_path, 20, 30, early=0.2)


@pytest.mark.slow
def test_two_runners_on_one_folder(tmp_path: Path) -> None:
    file = tmp_path / "campaign.yaml"
    file.write_text(yaml.safe_dump(CONTENT))
    runners = [begun(file, tmp_path / "run") for _ in range(2)]
    for runner in runners:
        said = runner.communicate(timeout=patience(300))[0].decode()
        assert runner.returncode == 0, said
    assert len(table(tmp_path / "run")) == 12
    assert (table(tmp_path / "run")["status"] == "answered").all()


def row(id_: str, **entries: Any) -> dict[str, Any]:
    return {"id": id_, "status": "answered", "verdict": "valid", "attempt": 1, "started": "2026", **entries}


def test_what_was_cut_off_is_skipped(tmp_path: Path) -> None:
    """A torn line, a line without its end, one that is no row, a file that is no Parquet: all else is read."""
    journal = Journal(tmp_path)
    for name in "ab":
        journal.write(row(name))
    journal.close()
    path = next((tmp_path / "journal").iterdir())
    with path.open("ab") as stream:
        stream.write(json.dumps(row("c")).encode()[:30] + b"\n" + b'["no row"]\n' + b"\xff\xfe\n")
        stream.write(json.dumps(row("d")).encode())
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "half.parquet").write_bytes(b"PAR1 half")
    assert sorted(Store(tmp_path).rows()["id"].to_pylist()) == ["a", "b"]


@pytest.mark.parametrize(
    ("rows", "kept"),
    [
        ([row("a", seed=1), row("a", seed=2, started="2027")], 2),
        ([row("a", seed=1, attempt=2), row("a", seed=2)], 1),
        ([row("a", seed=1), row("a", seed=2, status="crashed", attempt=3)], 1),
        ([row("a", seed=1, status="failed"), row("a", seed=2, status="crashed", attempt=2)], 2),
        ([row("a", seed=1, status="failed", attempt=9), row("a", seed=2, status="refused")], 2),
    ],
)
def test_which_of_two_rows_counts(rows: list[dict[str, Any]], kept: int, tmp_path: Path) -> None:
    for each in rows:
        journal = Journal(tmp_path)
        journal.write(each)
        journal.seal() if each["attempt"] == 1 else journal.close()
    assert Store(tmp_path).rows()["seed"].to_pylist() == [kept]


def test_a_long_journal_becomes_a_part(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fmu_didim.campaigns.running.store.PART_ROWS", 3)
    journal = Journal(tmp_path)
    for number in range(7):
        journal.write(row(str(number), parameters=[{"name": "p", "value": 0.1 + number}], reasons=["late"]))
        journal.end_chunk()
    assert len(list((tmp_path / "parts").iterdir())) == 2
    assert len(list((tmp_path / "journal").iterdir())) == 1
    journal.close()
    found = Store(tmp_path).rows()
    assert found.schema == pa.schema([ROW.field(name) for name in ROW.names])
    values = [entry[0]["value"] for entry in found["parameters"].to_pylist()]
    assert sorted(values) == [0.1 + number for number in range(7)]


@pytest.fixture
def sealed_while_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Store:
    """A folder with three rows, whose journal becomes a part."""
    monkeypatch.setattr("fmu_didim.campaigns.running.store.PART_ROWS", 3)
    monkeypatch.setattr(files.time, "sleep", lambda pause: None)
    return Store(tmp_path)


def held(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    """Have an operation on journals fail as on Windows where another program has the file open."""
    real = getattr(Path, name)

    def refused(self: Path, *arguments: Any, **options: Any) -> Any:
        if self.suffix == ".jsonl":
            error = PermissionError(13, "The process cannot access the file")
            error.winerror = 32  # type: ignore[attr-defined, unused-ignore]
            raise error
        return real(self, *arguments, **options)

    monkeypatch.setattr(Path, name, refused)


def three_rows(folder: Path) -> Journal:
    journal = Journal(folder)
    for id_ in "abc":
        journal.write({"id": id_, "status": "answered", "started": "1"})
    return journal


def test_a_journal_that_another_reads_stays_and_counts_once(
    sealed_while_read: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = sealed_while_read.folder
    journal = three_rows(folder)
    held(monkeypatch, "unlink")
    journal.end_chunk()
    journal.write({"id": "d", "status": "answered", "started": "1"})
    journal.close()
    assert len(list((folder / "journal").glob("*.jsonl"))) == 2 and len(list((folder / "parts").glob("*"))) == 1
    assert sorted(sealed_while_read.rows()["id"].to_pylist()) == ["a", "b", "c", "d"]


def test_a_journal_that_is_about_to_go_is_read_from_its_part(
    sealed_while_read: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Windows refuses to open a file that is removed once its last reader has closed it."""
    journal = three_rows(sealed_while_read.folder)
    monkeypatch.setattr(Path, "unlink", lambda self, missing_ok=False: None)
    journal.end_chunk()
    held(monkeypatch, "open")
    assert sorted(sealed_while_read.rows()["id"].to_pylist()) == ["a", "b", "c"]
    next((sealed_while_read.folder / "parts").glob("*.parquet")).rename(sealed_while_read.folder / "away")
    with pytest.raises(PermissionError):
        sealed_while_read.rows()


def test_no_row_is_missed_while_a_journal_becomes_a_part(
    sealed_while_read: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It does so between the two looks: at the journals and at the parts."""
    journal, real = three_rows(sealed_while_read.folder), Store._lines

    def meanwhile(self: Store) -> Iterator[dict[str, Any]]:
        paths = sorted((self.folder / "journal").glob("*.jsonl"))
        journal.end_chunk()
        with monkeypatch.context() as earlier:
            earlier.setattr(Path, "glob", lambda path, pattern: paths)
            yield from real(self)

    monkeypatch.setattr(Store, "_lines", meanwhile)
    assert sorted(sealed_while_read.rows()["id"].to_pylist()) == ["a", "b", "c"]
