"""Recording: two small cases for real, going on where it stopped, one version a folder, and the fixed cases."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from fmu_didim.base.version import __version__
from tests.helpers import ROOT
from tests.tools.blind.__main__ import main as make
from tests.tools.regression import cases, record
from tests.tools.regression.__main__ import main
from tests.tools.regression.cases import Job, blind_jobs, chosen, example_jobs
from tests.tools.regression.record import this_project


def test_every_example_is_there() -> None:
    assert all(job.path.is_file() for job in example_jobs())
    # An example that is not listed is a case that no comparison sees.
    verbs = ("identify", "discover", "two_payloads", "prior")
    there = {path for verb in verbs for path in (ROOT / "examples").glob(f"*/{verb}*.yaml")}
    assert {job.path for job in example_jobs()} == there


def test_fixed_cases_are_a_hundred(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    orders: list[Any] = []
    monkeypatch.setattr("tests.tools.blind.campaign.make_order", orders.append)
    assert cases.make_fixed_cases(tmp_path) == 100
    assert len(orders) == 50
    assert all([rate for _, rate in order.folders] == [100, 20] for order in orders)
    assert sum(not order.effects for order in orders) == 13


def job(name: str) -> Job:
    return Job(name, "discover", Path(name))


@pytest.mark.parametrize(
    ("only", "names"),
    [
        ((), ["blind one", "blind two", "identify one"]),
        (("one",), ["blind one", "identify one"]),
        (("two", "identify"), ["blind two", "identify one"]),
    ],
)
def test_chosen_by_a_text_of_the_name(only: tuple[str, ...], names: list[str]) -> None:
    jobs = [job(name) for name in ("blind one", "blind two", "identify one")]
    assert [found.name for found in chosen(jobs, only)] == names


def test_no_case_and_two_of_one_name_are_refused() -> None:
    with pytest.raises(ValueError, match="no case has three"):
        chosen([job("one")], ["three"])
    with pytest.raises(ValueError, match="two cases have the name one"):
        chosen([job("one"), job("one")], [])


def test_each_third_case_of_a_folder(tmp_path: Path) -> None:
    for number in range(7):
        (tmp_path / f"c{number}").mkdir()
        (tmp_path / f"c{number}" / "case.yaml").touch()
    assert [found.name for found in blind_jobs([tmp_path], every=3)] == ["blind c0", "blind c3", "blind c6"]


@pytest.mark.gate
def test_two_small_cases_recorded_and_compared(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, records = tmp_path / "cases", tmp_path / "records"
    make(["make", str(folder), "--seeds", "1", "--rates", "20", "--effects", "torque_offset", "--clean", "0",
          "--robots", "development"])  # fmt: skip
    command = ["record", str(records), "--cases", str(folder), "--only", "scara/identify_200hz", "blind"]
    assert main(command) == 0
    files = {file.name: json.loads(file.read_text(encoding="utf-8")) for file in records.iterdir()}
    assert set(files) == {"identify__scara_identify_200hz.json", "blind__b0001_20hz.json"}
    identified, discovered = files.values() if "scara" in next(iter(files)) else reversed(files.values())
    assert identified["result"]["status"] == "converged"
    assert "truth.yaml" not in discovered["inputs"]
    assert discovered["options"] == {"plant": "model"}
    assert [f["effect"] for f in discovered["result"]["findings"]] == ["torque_offset"]
    for content in files.values():
        assert content["project"] == vars(this_project())
        assert content["project"]["version"] == __version__
        assert "case.yaml" in content["inputs"] or "identify_200hz.yaml" in content["inputs"]
        assert content["seconds"] > 0
    capsys.readouterr()
    assert main(["compare", str(records), str(records), "--limit", "0", "--sigma", "0"]) == 0
    assert "2 of them the same parameters to the last bit" in capsys.readouterr().out


def failing(job: Job, work: Path) -> dict[str, Any]:
    raise AssertionError("it ran")


def test_goes_on_where_it_stopped_and_keeps_versions_apart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    broken = tmp_path / "broken.yaml"
    broken.write_text("schema: 1\n")
    jobs, records = [Job("identify broken", "identify", broken)], tmp_path / "records"
    said: list[str] = []
    assert record.record(records, jobs, tmp_path, progress=said.append) == 1
    content = json.loads((records / "identify__broken.json").read_text())
    assert content["result"] is None
    assert content["error"].startswith("InputError")
    assert "1/1 identify broken: InputError" in said[0]
    monkeypatch.setattr(record, "run", failing)
    assert record.record(records, jobs, tmp_path, progress=said.append) == 0
    assert said[-1] == "1 of 1 are recorded already"
    monkeypatch.setattr(record, "_source", lambda: "another")
    with pytest.raises(record.OtherProjectError, match="record into another folder"):
        record.record(records, jobs, tmp_path)
    assert list(records.glob("*.part")) == []
