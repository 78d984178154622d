"""Table and page of a result with several experiments: each of them, the fit over all, and who disagrees."""

from __future__ import annotations

import re
from pathlib import Path

import jsonschema
import pytest

from fmu_didim import Result, ResultDocument, identify, load_case
from fmu_didim.report import result_table, write_report
from fmu_didim.report.experiments import error_rows, parameter_groups, shown_unit
from fmu_didim.report.verdict import verdict
from fmu_didim.results.result import result_schema
from tests.workflow.three_experiments import three_experiments

FREE = {"delay": {"of": "delay"}, "gain": {"of": "controller", "parameter": "Kp2"}, "late": {"of": "log"}}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the result of :func:`outcome` lies."""
    return tmp_path_factory.mktemp("three")


@pytest.fixture(scope="module")
def outcome(folder: Path) -> Result:
    """Parameters that one experiment has for itself, and some of the loop."""
    return identify(three_experiments(identify=FREE), folder)


@pytest.fixture(scope="module")
def unlike() -> ResultDocument:
    """The same data with a payload that the model does not know of."""
    return identify(three_experiments(own=())).document


def block(text: str, head: str) -> list[str]:
    """The lines of a section of the table, from the one that starts with ``head``."""
    return next(part for part in text.split("\n\n") if part.startswith(head)).splitlines()


@pytest.mark.gate
def test_parameters_stand_in_groups(outcome: Result) -> None:
    groups = {group.head: list(group.parameters) for group in parameter_groups(outcome.document)}
    assert list(groups) == ["", "own to payload", "the loop"]
    assert groups["own to payload"] == ["ZZ1R[payload]", "ZZ2[payload]", "MX2[payload]"]
    assert groups["the loop"] == list(FREE)
    text = block(outcome.summary(), "parameter")
    rules = [line for line in text if line.startswith("--")]
    assert [rule.strip("-").strip() for rule in rules] == ["", "own to payload", "the loop"]
    assert len({len(rule) for rule in rules}) == 1
    assert any(re.match(r"delay\b.*\bsamples\b", line) for line in text)
    assert any(re.match(r"gain \(controller\) ", line) for line in text)
    assert any(re.match(r"late\b.* s ", line) for line in text)
    assert re.fullmatch(r"delay = \(.* ± .*\) samples = \(.* ± .*\) ms at a step of 5 ms", text[-1])
    assert {shown_unit(p) for p in outcome.parameters.values()} >= {"samples", "kg·m²", "s"}


@pytest.mark.gate
def test_each_experiment_has_a_line(outcome: Result) -> None:
    head, *lines = block(outcome.summary(), "Experiment")
    assert head.split() == ["Experiment", "role", "samples", "Hz", "agreement", "p", "own"]
    assert lines[0].split()[:4] == ["light", "estimation", "101", "10"]
    assert lines[1].split()[:4] == ["payload", "estimation", "201", "20"]
    assert lines[1].endswith("  ZZ1R, ZZ2, MX2")
    assert lines[2].split() == ["check", "validation", "101", "10", "–"]


def test_errors_of_each_experiment_and_of_the_fit_over_all(outcome: Result) -> None:
    lines = block(outcome.summary(), "Torque")
    assert [line.split("  ")[0] for line in lines[1:5]] == ["light", "payload", "check", "all fitted"]
    assert lines[-1].startswith("noise σ: joint 1 ")
    rows = dict(error_rows(outcome.document))
    document = outcome.document
    assert document.fitted_error_percent is not None
    assert rows["all fitted"] == [document.fitted_error_percent.total, *document.fitted_error_percent.per_joint]
    low, high = sorted(rows[label][0] or 0.0 for label in ("light", "payload"))
    assert low < (rows["all fitted"][0] or 0.0) < high
    words = " ".join(outcome.summary().split())
    assert re.search(r"% off on the 2 fitted experiments, [\d.]+ % on check \(validation\)( Provided that|$)", words)
    assert words.count("VALID: ") == 1


def test_experiment_that_disagrees_is_a_warning(unlike: ResultDocument) -> None:
    text = result_table(unlike)
    words = " ".join(text.split())
    assert "payload: Experiment payload does not agree with the others" in words
    assert "experiments: {payload: {own: [ZZ2]}}" in words
    assert verdict(unlike).head == "DOUBTFUL"
    assert {r.place for r in unlike.reasons if r.code == "experiments-disagree"} == {"light", "payload"}
    marked = [line.split()[0] for line in block(text, "Experiment") if line.endswith(" !")]
    assert marked == ["light", "payload"]
    assert not any("does not agree" in remark for remark in unlike.remarks)


def test_page_shows_experiments_and_warnings(folder: Path, outcome: Result, unlike: ResultDocument) -> None:
    page = (folder / "report.html").read_text(encoding="utf-8")
    page = page[: page.index("<script>")]
    shown = ["own to payload", "the loop", "ZZ1R, ZZ2, MX2", "torque error, all fitted", ">samples<", ">controller<"]
    for text in (*shown, "<h3>Payload (estimation)</h3>", "<h3>Check (validation)</h3>", '<h2 id="experiments">'):
        assert text in page, text
    assert len(re.findall(r'id="chart-torque-\d"', page)) == 3
    assert "does not agree" not in page
    (folder / "unlike").mkdir()
    (folder / "unlike" / "result.json").write_text(
        unlike.model_copy(update={"signals": {}}).model_dump_json(), encoding="utf-8"
    )
    other = write_report(folder / "unlike").read_text(encoding="utf-8")
    assert other.count("[experiments-disagree]") == 2


def test_short_form_stays_compact() -> None:
    text = identify(load_case("examples/scara/identify.yaml")).summary()
    assert not re.search(r"^Experiment", text, re.MULTILINE)
    assert block(text, "Torque")[0].split() == ["Torque", "estimation", "%", "validation", "%", "noise", "σ"]
    assert "all fitted" not in text
    assert len(text.splitlines()) == 47  # four of them: what a valid verdict excludes; eight: what would not show


def test_result_with_experiments_follows_its_schema(outcome: Result) -> None:
    jsonschema.validate(outcome.document.model_dump(mode="json"), result_schema())


def test_many_experiments_and_joints_stay_within_100_columns(outcome: Result) -> None:
    document = outcome.document
    many = {f"a motion with a rather long name, number {k}": document.experiments["payload"] for k in range(12)}
    error = document.relative_error_percent["payload"].model_copy(update={"per_joint": [123.4] * 9})
    wide = document.model_copy(
        update={
            "experiments": many,
            "relative_error_percent": dict.fromkeys(many, error),
            "torque_unit": ["N.m"] * 9,
            "noise_std": [0.1] * 9,
        }
    )
    text = result_table(wide)
    assert max(len(line) for line in text.splitlines()) <= 100
    assert "joint 9 %" in text
