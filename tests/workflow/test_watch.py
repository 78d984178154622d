"""A folder of logs: their order, what is kept of them, and what is said of a machine that changes."""

from __future__ import annotations

import json
import os
import shutil
import sys
from collections.abc import Mapping
from datetime import date, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from fmu_didim import InputError, Watched, load_case, watch
from fmu_didim.case import Log
from fmu_didim.cli.main import main
from fmu_didim.results.watch import load_watch
from fmu_didim.workflow.watch.logs import dated_logs, split
from fmu_didim.workflow.watch.store import Place, Store
from tests.discovery.change.pairs import NOISE, log_of, write_case

STORE = sys.modules["fmu_didim.workflow.watch.store"]
RATE = 20.0
FIRST = date(2024, 5, 1)


def write_log(folder: Path, name: str, log: Log) -> Path:
    folder.mkdir(exist_ok=True)
    path = folder / name
    rows = np.column_stack([log.time, log.torque])
    np.savetxt(path, rows, fmt="%.9g", delimiter=",", header="t,tau1,tau2", comments="")
    return path


def write_logs(folder: Path, count: int, changed: Mapping[int, Mapping[str, Any]]) -> None:
    for k in range(count):
        log = log_of(RATE, 500 + k, **changed.get(k, {}))
        write_log(folder, f"axis_{FIRST + timedelta(days=k)}.csv", log)


@pytest.mark.parametrize(
    ("names", "order"),
    [
        (["b_2024-05-02.csv", "a_2024-05-03.csv", "20240501.csv"], [2, 0, 1]),
        (["x 2024-05-01T10-30-00.csv", "x 2024-05-01T09-30.csv"], [1, 0]),
        (["2024-05-01_b.csv", "2024-05-01_a.csv"], [1, 0]),
        (["run17_2023-12-31.csv", "run2_2024-01-01.csv"], [0, 1]),
    ],
)
def test_logs_are_in_order_of_the_dates_in_their_names(tmp_path: Path, names: list[str], order: list[int]) -> None:
    for name in names:
        (tmp_path / name).write_text("t", encoding="utf-8")
    (tmp_path / "notes.md").write_text("x", encoding="utf-8")
    found = dated_logs(tmp_path, by_time=False)
    assert [log.path.name for log in found] == [names[k] for k in order]


@pytest.mark.parametrize(
    "name", ["first.csv", "run_2024-13-40.csv", "2024-05-01_to_2024-06-01.csv", "170012024050112.csv"]
)
def test_a_log_without_one_date_is_refused_by_its_name(tmp_path: Path, name: str) -> None:
    for each in ("2024-05-02.csv", name):
        (tmp_path / each).write_text("t", encoding="utf-8")
    with pytest.raises(InputError, match="The name of this log has") as error:
        dated_logs(tmp_path, by_time=False)
    assert error.value.where == name
    assert "--by-time" in error.value.next_step
    os.utime(tmp_path / name, (1e9, 1e9))
    assert [log.path.name for log in dated_logs(tmp_path, by_time=True)] == [name, "2024-05-02.csv"]


def test_folders_without_logs_and_references_without_or_with_all_of_them_are_refused(tmp_path: Path) -> None:
    for folder, match in ((tmp_path / "none", "does not exist"), (tmp_path, "no log in this folder")):
        with pytest.raises(InputError, match=match):
            dated_logs(folder, by_time=False)
    for k in range(3):
        (tmp_path / f"2024-05-0{k + 1}.csv").write_text("t", encoding="utf-8")
    logs = dated_logs(tmp_path, by_time=False)
    assert dated_logs(tmp_path, by_time=False, beside=[logs[0].path]) == logs[1:]
    assert split(logs, count=None, until=date(2024, 5, 2), default=10) == 2
    assert split(logs, count=1, until=None, default=10) == 1
    with pytest.raises(InputError, match="none is left to be judged"):
        split(logs, count=None, until=None, default=10)
    with pytest.raises(InputError, match="no reference"):
        split(logs, count=None, until=date(2024, 4, 30), default=10)


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("case") / "case.yaml"
    write_case(path, log_of(RATE, 1))
    return path


def test_cases_whose_log_another_cannot_stand_for_are_refused(case: Path) -> None:
    one = load_case(case, require_torque=False)
    train = one.content["train"]
    several = one.with_(train=None, experiments={"a": train, "b": train})
    with pytest.raises(InputError, match="fits several experiments"):
        Place.of(several)
    with pytest.raises(InputError, match="names none, or several"):
        Place.of(one.with_(train={"torque": log_of(RATE, 1)}))


@pytest.mark.gate
def test_logs_of_a_model_hold_inputs_and_measurements(tmp_path: Path) -> None:
    house = Path("examples/house")
    with pytest.raises(InputError, match="reads another file of the same run"):
        Place.of(load_case(house / "identify.yaml", require_torque=False))
    weather, room = (np.loadtxt(house / f"{name}.csv", delimiter=",", skiprows=1) for name in ("weather", "room"))
    content = yaml.safe_load((house / "identify.yaml").read_text(encoding="utf-8"))
    content |= {"model": str((house / "house.fmu").resolve()), "train": {"inputs": "a.csv", "measured": "a.csv"}}
    del content["validation"]
    (tmp_path / "logs").mkdir()
    for seed, name in enumerate(("a.csv", "logs/2024-01-01.csv", "logs/2024-01-02.csv")):
        noise = 0.1 * np.random.default_rng(seed).normal(size=len(room))
        table = np.column_stack([weather, room[:, 1] + noise])
        np.savetxt(tmp_path / name, table, delimiter=",", header="t,T_out,T_beside,T", comments="")
    (tmp_path / "case.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    found = watch(tmp_path / "logs", tmp_path / "case.yaml", tmp_path / "out", reference=1)
    assert [log.state for log in found.logs] == ["reference", "unchanged"]
    assert list(found.document.values) == ["R1", "R2"]


def test_what_is_kept_depends_on_log_case_and_program(
    case: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    one = load_case(case, require_torque=False)
    known = Store.of(tmp_path, one).known
    assert Store.of(tmp_path, one.with_(name="other")).known == known
    assert Store.of(tmp_path, one.with_(torque_std=[0.1, 0.1])).known != known
    monkeypatch.setattr(STORE, "code_digest", lambda: "other")
    assert Store.of(tmp_path, one).known != known


@pytest.mark.slow
def test_a_machine_that_changes_is_seen_named_and_dated_and_nothing_is_identified_twice(
    case: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    logs, out = tmp_path / "logs", tmp_path / "out"
    payload = {"mass": (0.4, 0.2, 0.05)}
    write_logs(logs, 8, {6: payload, 7: payload})
    broken = logs / f"axis_{FIRST + timedelta(days=8)}.csv"
    broken.write_text("t,tau1,tau2\n0,1,x\n", encoding="utf-8")
    shutil.copy(logs / "axis_2024-05-08.csv", logs / "axis_2024-05-10.csv")
    arguments = ["watch", str(logs), "--case", str(case), "--out", str(out), "--until", "2024-05-05"]
    assert main(arguments) == 5
    printed = capsys.readouterr().out
    assert "identifying axis_2024-05-01.csv" in printed
    assert "a lasting change, first in axis_2024-05-07.csv" in " ".join(printed.split())
    assert max(map(len, printed[printed.index("SCARA") :].splitlines()[:20])) <= 100
    saved = load_watch(out)
    states = [log.state for log in saved.logs]
    assert states == ["reference"] * 5 + ["unchanged"] + ["changed"] * 2 + ["not_judged"] * 2
    assert [log.causes for log in saved.logs[6:8]] == [["payload on the last link"]] * 2
    assert "could not be identified" in saved.logs[8].text
    assert saved.logs[9].text == "it is the same log as axis_2024-05-08.csv"
    assert {reason.code for reason in saved.reasons} == {"watch-log-not-sure"}
    assert (out / saved.logs[0].result / "report.html").is_file()
    page = (out / "watch.html").read_text(encoding="utf-8")
    assert "History of the values" in page

    identified = list[str]()
    monkeypatch.setattr(STORE, "identify", lambda one, out: identified.append(one.name))
    broken.unlink()
    assert main([*arguments, "--json"]) == 5
    assert identified == []
    *lines, answer = map(json.loads, capsys.readouterr().out.splitlines())
    assert [line["state"] for line in lines] == states[:8] + states[9:]
    assert not any(line["new"] for line in lines)
    assert (answer["answer"], answer["onset"]["log"]) == ("changed", "axis_2024-05-07.csv")


@pytest.mark.slow
def test_an_effect_that_has_come_is_named_and_dated_though_no_value_says_so(case: Path, tmp_path: Path) -> None:
    logs, late = tmp_path / "logs", {"late_s": 0.01}
    write_logs(logs, 8, {6: late, 7: late})
    found = watch(logs, case, tmp_path / "out", reference=5)
    assert [log.state for log in found.logs[5:]] == ["unchanged", "changed", "changed"]
    assert [log.causes for log in found.logs[6:]] == [["time shift of the torque log, new"]] * 2
    assert "clock-late" in found.logs[7].text
    assert found.onset is not None
    assert (found.onset.kind, found.onset.log) == ("step", "axis_2024-05-07.csv")
    assert not any("not among these causes" in remark for remark in found.document.remarks)
    alone = watch(logs, case, tmp_path / "out", reference=5, effects=False)
    assert "time shift of the torque log, new" not in str(alone.document)
    assert all(log.state != "unchanged" for log in alone.logs[6:])


@pytest.mark.parametrize(
    ("options", "match"),
    [
        (["logs"], "needs the case"),
        (["case.yaml"], "One result is compared with another"),
        (["logs", "logs", "--case", "case.yaml", "--reference", "3"], "This option is for one folder"),
        (["a.yaml", "b.yaml", "--by-time"], "This option is for folders"),
        (["logs", "logs", "--case", "case.yaml", "--out", "out"], "is there twice"),
    ],
)
def test_compare_says_which_options_fit_folders(
    case: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch,
    options: list[str], match: str,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    write_logs(tmp_path / "logs", 2, {})
    for file in case.parent.iterdir():
        shutil.copy(file, tmp_path)
    assert main(["compare", *options]) == 1
    assert match in capsys.readouterr().err


@pytest.mark.gate
def test_two_folders_and_few_logs(case: Path, tmp_path: Path) -> None:
    write_logs(tmp_path / "before", 2, {})
    write_log(tmp_path / "after", "2024-08-01.csv", log_of(RATE, 600, noise=2.5))
    arguments = ["compare", str(tmp_path / "before"), str(tmp_path / "after"), "--case", str(case)]
    assert main([*arguments, "--out", str(tmp_path / "out"), "--quiet"]) == 4
    found = watch(tmp_path / "before", case, tmp_path / "out", after=tmp_path / "after")
    assert not any(log.new for log in found.logs)
    assert isinstance(found, Watched)
    assert found.exit_code == 4
    assert {reason.code for reason in found.reasons} == {"watch-few-references", "watch-log-not-sure"}
    assert found.logs[-1].state == "doubtful"
    frame = found.to_frame()
    assert list(frame["state"]) == ["reference"] * 2 + ["doubtful"]
    assert frame.loc["2024-08-01.csv", "Fc2 std"] > 0
    assert NOISE.size == 2
