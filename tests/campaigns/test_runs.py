"""Campaigns that run: the same answers as alone, resumed, and whatever becomes of a run, the others go on."""

from __future__ import annotations

import errno
import html
import importlib
import json
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml

from fmu_didim import identify
from fmu_didim.base.errors import InputError
from fmu_didim.campaigns.campaign import Campaign, campaign, opened
from fmu_didim.campaigns.reporting.page import write_campaign_report
from fmu_didim.campaigns.running import runner
from fmu_didim.campaigns.running.runner import Progress
from fmu_didim.campaigns.running.store import Journal, Store
from fmu_didim.cli.main import main
from tests.awkward.build import awkward_fmu
from tests.campaigns.helpers import CASE, sledge_case, small
from tests.patience import patience

TIMES = ["seconds", "cpu_seconds", "started", "host", "attempt"]
"""What is of the moment, not of the run."""


def frame(found: Campaign) -> pd.DataFrame:
    """All that a campaign gave, apart from times."""
    return found.results().to_frame().drop(columns=TIMES).sort_values("id", ignore_index=True)


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    found = small(tmp_path_factory.mktemp("campaign") / "run")
    found.run(workers=2)
    return found


@pytest.mark.gate
def test_rows_are_what_the_runs_give_alone(done: Campaign, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The case written out, with its data in files, gives the row to the last bit: noise and all."""
    runs = frame(done)
    assert list(runs["verdict"].unique()) == ["valid"]
    assert len(runs) == 6
    for row in runs.iloc[[0, 4]].to_dict("records"):
        assert main(["campaign", "show", str(done.out), row["id"][:12], "--files", str(tmp_path / row["id"])]) == 0
        alone = identify(tmp_path / row["id"] / "case.yaml")
        assert {name: row[name] for name in alone.values} == alone.values
        assert row["conditions"] == "; ".join(alone.document.conditions)
        total = alone.document.relative_error_percent["estimation"].total
        assert row["error_percent"] == pytest.approx(total, rel=1e-14)  # norms round as their vectors lie in memory
        assert {row[f"{name}.true"] for name in alone.values} == {3.43, 0.03, 0.82, 0.063, 0.241, 0.014, 0.013, 0.137}
    said = capsys.readouterr().out
    assert "train.torque.rate_hz = " in said
    assert "true 3.43" in said


@pytest.mark.gate
def test_nothing_is_run_twice(done: Campaign) -> None:
    told: list[Progress] = []
    before = {path.name: path.read_bytes() for path in (done.out / "parts").iterdir()}
    assert before
    again = small(done.out)
    again.run(workers=1, progress=told.append)
    assert not told
    assert {path.name: path.read_bytes() for path in (done.out / "parts").iterdir()} == before
    assert list((done.out / "runners").iterdir()) == []


@pytest.mark.slow
def test_a_larger_campaign_runs_what_is_new(done: Campaign, tmp_path: Path) -> None:
    """Rows of another plan stand by, and take no part in any table."""
    out = tmp_path / "run"
    small(out, seeds=[0]).run(workers=1)
    told: list[Progress] = []
    larger = small(out, seeds=[0, 1], vary={"train.torque.rate_hz": [20]})
    results = larger.run(workers=1, progress=told.append)
    assert [p.count for p in told] == [1]
    assert results.status().elsewhere == 1
    assert "further rows belong to another plan, version or file; they are ignored" in "\n".join(results.remarks())
    assert len(results.to_frame()) == 2
    both = frame(larger).merge(frame(done), on="id", suffixes=("", "_other"))
    assert (both["ZZ2"] == both["ZZ2_other"]).all()


@pytest.mark.gate
def test_another_version_or_file_does_not_mix(done: Campaign, monkeypatch: pytest.MonkeyPatch) -> None:
    assert len(done.results().to_frame()) == 6
    monkeypatch.setattr("fmu_didim.campaigns.planning.plan.code_digest", lambda: "another")
    monkeypatch.setattr("fmu_didim.campaigns.campaign.code_digest", lambda: "another")
    with pytest.raises(InputError, match="the code has changed"):
        opened(done.out)
    newer = small(done.out)
    assert len(newer.plan.runs) == 6
    assert not set(newer.plan.by_id) & set(done.results().to_frame()["id"])


@pytest.mark.gate
def test_another_campaign_does_not_take_the_folder(done: Campaign) -> None:
    with pytest.raises(InputError, match="holds another campaign"):
        small(done.out, verb="identify", description="").__class__(
            campaign({"name": "other", "case": done.plan.document.case}).plan, done.out
        ).run(workers=1)


@pytest.mark.slow
def test_each_fault_is_a_row_and_the_rest_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Processes that crash, exit, hang, fill their memory, or are killed from outside, once or always."""
    monkeypatch.syspath_prepend(str(Path(__file__).parent / "faults"))
    monkeypatch.setattr(runner, "execute", importlib.import_module("faulty_run").faulty)
    limit = patience(15)
    entries: dict[str, Any] = {
        "seeds": [0, 11, 12, 13, 14, 15, 16, 1], "vary": {"train.torque.rate_hz": [10]},
        "options": {"prefer": []}, "limits": {"time_s": limit, "memory_mb": 1500},
    }  # fmt: skip
    found = small(tmp_path / "run", **entries)
    monkeypatch.setattr(
        runner, "task_of", lambda plan, run, files=None: with_mark(task_of(plan, run, files), tmp_path / "mark")
    )
    results = found.run(workers=2)
    rows = results.to_frame().set_index("seed")
    assert dict(rows["status"]) == {
        0: "answered", 1: "answered", 14: "answered", 11: "crashed", 12: "time limit", 13: "memory limit",
        15: "crashed", 16: "crashed",
    }  # fmt: skip
    assert "SIGABRT" in rows.loc[11, "message"]
    assert f"within {limit:g} s" in rows.loc[12, "message"]
    assert "more memory" in rows.loc[13, "message"]
    assert "SIGKILL" in rows.loc[15, "message"]
    status = results.status()
    assert (status.open, status.verdicts["valid"], sum(status.failures.values())) == (0, 3, 5)
    assert any("5 of 8 runs gave no answer" in remark for remark in results.remarks())
    assert main(["campaign", "status", str(found.out)]) == 3
    # What has failed is run again on request, and what succeeds then takes the place of the failure.
    monkeypatch.undo()
    assert main(["campaign", "retry", str(found.out), "--workers", "2", "--quiet"]) == 0
    assert "8 of 8 runs done (8 valid)" in capsys.readouterr().out
    assert main(["campaign", "retry", str(found.out)]) == 0
    assert "No run has failed" in capsys.readouterr().out


task_of = runner.task_of


def with_mark(task: Any, mark: Path) -> Any:
    """The task with the path of a file in its options, which an identification does not read."""
    from dataclasses import replace

    return replace(task, content=replace(task.content, options={"mark": str(mark)}))


@pytest.mark.slow
def test_fmus_that_crash_and_hang(tmp_path: Path) -> None:
    """Of three controllers one crashes and one hangs in a step; their runs say so, those of the third are right."""
    sources = [str(awkward_fmu(tmp_path, *macro)) for macro in ((), ("CRASH_IN_STEP",), ("HANG_IN_STEP",))]
    content = {
        "name": "awkward", "case": sledge_case(sources[0], time_limit_s=patience(2.0)), "noise": {"relative": 0.01},
        "seeds": 2, "vary": {"controller.source": sources},
    }  # fmt: skip
    found = campaign(content, tmp_path / "run")
    results = found.run(workers=2)
    rows = results.to_frame(parameters=False)
    good = rows[rows["controller.source"] == "plain"]
    assert list(good["verdict"]) == ["valid", "valid"]
    for name in ("crash_in_step", "hang_in_step"):
        bad = rows[rows["controller.source"] == name]
        assert set(bad["status"]) <= {"failed", "crashed", "time limit"}
        assert bad["message"].str.contains("crashed its process|no answer within").all()
    values = results.parameters().query("parameter == 'M1'")
    assert (np.abs(values["value"] - 2.0) < 4 * values["std"]).all()


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="its licences are locks of Linux")
@pytest.mark.parametrize(("instances", "statuses"), [({}, {"failed"}), ({"licences_2.fmu": 1}, set())])
def test_few_runs_use_an_fmu_at_the_same_time(
    instances: dict[str, int], statuses: set[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two licences, of which a run may take a second one while its FMU is tried: three runs at once are too many."""
    fmu = awkward_fmu(tmp_path, "LICENCES 2")
    fmu.rename(tmp_path / "licences_2.fmu")
    monkeypatch.setenv("SLAVE_LICENCES", str(tmp_path))
    content = {
        "name": "licences", "case": sledge_case("licences_2.fmu"), "noise": {"relative": 0.01}, "seeds": 4,
        "limits": {"instances": instances},
    }  # fmt: skip
    monkeypatch.setattr("fmu_didim.campaigns.running.runner.CHUNK_RUNS", 1)
    rows = campaign(content, tmp_path / "run", folder=tmp_path).run(workers=3).to_frame(parameters=False)
    assert len(rows) == 4
    assert set(rows["status"]) - {"answered"} == statuses


@pytest.mark.slow
def test_a_full_disk_ends_the_campaign_and_loses_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write, written = Journal.write, []

    def full(self: Journal, row: dict[str, Any]) -> None:
        if len(written) == 2:
            line = json.dumps(row).encode()[:40]
            os.write(self._stream.fileno(), line) if self._stream is not None else None
            raise OSError(errno.ENOSPC, "No space left on device")
        written.append(row["id"])
        write(self, row)

    monkeypatch.setattr(Journal, "write", full)
    found = small(tmp_path / "run")
    with pytest.raises(InputError, match=r"cannot be written[\s\S]*No space left[\s\S]*not run again"):
        found.run(workers=1)
    monkeypatch.undo()
    told: list[Progress] = []
    small(tmp_path / "run").run(workers=1, progress=told.append)
    assert told[-1].known == 2
    assert told[-1].count == 4
    rows = Store(tmp_path / "run").rows()
    assert sorted(rows["id"].to_pylist()) == sorted(run.id for run in found.plan.runs)


@pytest.mark.slow
def test_the_page_of_a_campaign_file_says_what_repeats_it(tmp_path: Path) -> None:
    """A study has no file; a retry, which plans anew from what was saved, knows it still."""
    content = {"name": "one run", "case": str(CASE), "noise": {"relative": 0.05}}
    (tmp_path / "my study.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    out = tmp_path / "run"
    for plan in (lambda: campaign(tmp_path / "my study.yaml", out), lambda: opened(out)):
        write_campaign_report(plan().run(workers=1))
        command = html.escape(f"fmu-didim campaign run 'my study.yaml' --out {out}", quote=True)
        page = (out / "report.html").read_text(encoding="utf-8")
        assert command.replace("&#x27;", "&#39;") in page and f"in the folder <code>{tmp_path}</code>" in page
    write_campaign_report(campaign(content, out, folder=tmp_path).run(workers=1))
    assert "repeats it" not in (out / "report.html").read_text(encoding="utf-8")


@pytest.mark.gate
def test_report_and_tables(done: Campaign, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["campaign", "report", str(done.out)]) == 0
    text = (done.out / "report.html").read_text(encoding="utf-8")
    for run in done.plan.runs:
        assert f'href="#run-{run.id}"' in text
        assert f'id="run-{run.id}"' in text
    assert "COMPLETE" in text
    conditions = pd.read_csv(done.out / "runs.csv")["conditions"]
    assert conditions.str.startswith("the data do not hide ").all()
    assert "valid answers rest on what their data do not show" in text and "provided that</th>" in text
    assert "fewer than 20 data" in text
    runs, same = pd.read_csv(done.out / "runs.csv"), pd.read_parquet(done.out / "runs.parquet")
    for name in ("id", "seed", "verdict", "error_percent", "seconds"):
        assert list(runs[name]) == list(same[name])
    assert len(pd.read_parquet(done.out / "parameters.parquet")) == 48
    assert "report.html" in capsys.readouterr().out
