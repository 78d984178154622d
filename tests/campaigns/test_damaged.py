"""Campaign folders whose files are damaged, and labels that spreadsheets would run."""

from __future__ import annotations

import csv
import json
import logging
from collections.abc import Callable
from pathlib import Path

import pyarrow as pa
import pytest
from pyarrow import parquet

from fmu_didim.base.errors import InputError
from fmu_didim.campaigns.reporting.page import write_campaign_report
from fmu_didim.campaigns.reporting.results import Results
from fmu_didim.campaigns.running.store import JOURNALS, PARTS, PLAN_FILE, ROW, RUNS_FILE, Journal, Store
from tests.campaigns.helpers import plan_of


def made(folder: Path, *labels: str) -> Store:
    """A campaign of two runs, one of which is done."""
    labels = labels or ("=1+1", "plain")
    plan = plan_of(vary={"train.torque.rate_hz": dict(zip(labels, (10, 20), strict=True))})
    store = Store(folder)
    store.begin(plan)
    journal = Journal(folder)
    journal.write({"id": plan.runs[0].id, "status": "answered", "verdict": "valid", "attempt": 1, "seconds": 1.0})
    journal.close()
    return store


def changed(name: str, **entries: object) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        content = json.loads((folder / name).read_text(encoding="utf-8"))
        content |= entries
        (folder / name).write_text(json.dumps(content), encoding="utf-8")

    return change


def without(name: str, key: str) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        content = json.loads((folder / name).read_text(encoding="utf-8"))
        del content[key]
        (folder / name).write_text(json.dumps(content), encoding="utf-8")

    return change


def content(name: str, text: bytes) -> Callable[[Path], None]:
    return lambda folder: (folder / name).write_bytes(text) and None


def table(**columns: object) -> Callable[[Path], None]:
    return lambda folder: parquet.write_table(pa.table(columns), folder / RUNS_FILE)


FULL = {"id": ["a"], "design": ["b"], "data": ["c"], "seed": [1], "settings": ["{}"]}
DAMAGES = {
    "no JSON": content(PLAN_FILE, b"{"),
    "no text": content(PLAN_FILE, b"\xff\xfe"),
    "empty": content(PLAN_FILE, b""),
    "a list": content(PLAN_FILE, b"[1]"),
    "nested": content(PLAN_FILE, b"[" * 100_000),
    **{f"no {key}": without(PLAN_FILE, key) for key in ("campaign", "folder", "code", "version", "planned", "paths")},
    "campaign without name": changed(PLAN_FILE, campaign={}),
    "paths of another type": changed(PLAN_FILE, paths=3),
    "no Parquet": content(RUNS_FILE, b"PAR1"),
    "plan empty": content(RUNS_FILE, b""),
    "no columns": table(a=[1]),
    "seeds are texts": table(**{**FULL, "seed": ["x"]}),
    "settings are no JSON": table(**{**FULL, "settings": ["{"]}),
    "settings are a list": table(**{**FULL, "settings": ["[]"]}),
    "no ids": table(**{**FULL, "id": pa.array([None], pa.string())}),
    "no plan": lambda folder: (folder / RUNS_FILE).unlink(),
}


@pytest.mark.parametrize("name", DAMAGES)
def test_a_damaged_campaign_is_refused_with_its_file_and_run_again(name: str, tmp_path: Path) -> None:
    store = made(tmp_path)
    DAMAGES[name](tmp_path)
    with pytest.raises(InputError, match=r"A file of the campaign is damaged[\s\S]*next: ") as caught:
        Results(store).to_frame()
    broken = tmp_path / (PLAN_FILE if PLAN_FILE in str(caught.value) else RUNS_FILE)
    assert str(broken) in str(caught.value)
    broken.unlink(missing_ok=True)  # as the message says
    assert list(Results(made(tmp_path)).to_frame()["status"]) == ["answered", "open"]


ROWS = {
    "a status that is no text": {"id": "x", "status": [1]},
    "seconds that are no number": {"id": "x", "status": "answered", "seconds": "long"},
    "parameters that are no list": {"id": "x", "status": "answered", "parameters": 3},
    "a seed that is too large": {"id": "x", "status": "answered", "seed": 2**70},
}


@pytest.mark.parametrize("name", ROWS)
def test_a_damaged_row_is_told_and_counts_as_not_done(
    name: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    store = made(tmp_path)
    (tmp_path / JOURNALS / "other.jsonl").write_text(json.dumps(ROWS[name]) + "\n", encoding="utf-8")
    with caplog.at_level(logging.WARNING, "fmu_didim"):
        found = store.rows(ROW.names)
    assert found["status"].to_pylist() == ["answered"]
    assert "counts as not done" in caplog.text


@pytest.mark.parametrize("part", [{"id": ["x"]}, {name: [[1]] for name in ROW.names}])
def test_a_damaged_part_is_told_and_its_runs_count_as_not_done(
    part: dict[str, object], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    store = made(tmp_path)
    parquet.write_table(pa.table(part), tmp_path / PARTS / "a.parquet")
    with caplog.at_level(logging.WARNING, "fmu_didim"):
        assert store.rows()["status"].to_pylist() == ["answered"]
    assert "a.parquet" in caplog.text


def test_a_part_of_an_earlier_version_lacks_what_that_did_not_write(tmp_path: Path) -> None:
    store = made(tmp_path)
    row = {"id": "x", "status": "answered", "verdict": "valid", "reasons": [], "attempt": 1, "started": "2025"}
    part = pa.Table.from_pylist([row], schema=ROW).drop_columns(["conditions"])
    parquet.write_table(part, tmp_path / PARTS / "a.parquet")
    found = {each["id"]: each for each in store.rows().to_pylist()}
    assert found["x"]["verdict"] == "valid" and found["x"]["conditions"] is None


@pytest.mark.parametrize("label", ["=cmd|' /C calc'!A1", "+1+1", "-2+3", "@SUM(1)"])
def test_no_cell_of_the_tables_is_a_formula(label: str, tmp_path: Path) -> None:
    store = made(tmp_path, label, "-0.5")
    write_campaign_report(Results(store))
    cells = []
    for path in tmp_path.glob("*.csv"):
        with path.open(encoding="utf-8", newline="") as stream:
            cells += [cell for row in csv.reader(stream) for cell in row]
    assert f"'{label}" in cells
    assert "-0.5" in cells, "a number stays one"
    assert not [cell for cell in cells if cell[:1] in "=+@" and cell]
    assert label in parquet.read_table(tmp_path / "runs.parquet")["train.torque.rate_hz"].to_pylist()
