"""Doubts that the user has checked: a right case can be valid, and nobody is misled by it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from fmu_didim import check, identify
from fmu_didim.base.diagnostics import DOUBT, PROBLEM, REMARK, Diagnostic
from fmu_didim.base.errors import InputError, UnknownNameError
from fmu_didim.case import Case, load_case
from fmu_didim.checks.judgement import judgement
from fmu_didim.report import result_table
from fmu_didim.results.result import read_result
from fmu_didim.workflow.acknowledged import acknowledged
from fmu_didim.workflow.reference.codes import all_codes
from fmu_didim.workflow.validate import mistakes
from tests.cases import SCARA
from tests.conftest import ROOT

SENTENCE = "The header of the log is wrong: the amplifier was set to N.m (protocol of 3 May)."
CODE = "unit-contradicts-file"


def overruled(folder: Path, **entries: Any) -> Path:
    """A SCARA whose log states mN.m, and whose case states N.m, which is right."""
    import yaml

    content = yaml.safe_load(SCARA.read_text(encoding="utf-8"))
    here = SCARA.parent.resolve()
    log = (here / "train_10hz.csv").read_text(encoding="utf-8").replace("tau1", "tau1 [mN.m]", 1)
    (folder / "log.csv").write_text(log, encoding="utf-8")
    content["train"]["torque"] = {
        "file": "log.csv", "columns": {"tau1": {"name": "tau1 [mN.m]", "unit": "N.m"}, "tau2": "tau2"},
    }  # fmt: skip
    content["validation"]["torque"]["file"] = str(here / "validation_10hz.csv")
    content |= {"robot": str(ROOT / "fmus/scara/robot.yaml"), "plant": {"kind": "model"}}
    content |= {"controller": {"kind": "model", "source": str(ROOT / "controllers/scara_pd.yaml")}, **entries}
    (folder / "case.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    return folder / "case.yaml"


@pytest.mark.gate
def test_a_right_case_with_a_checked_doubt_is_valid_and_says_so(tmp_path: Path) -> None:
    plain = identify(overruled(tmp_path))
    assert (plain.verdict, [reason.code for reason in plain.reasons]) == ("doubtful", [CODE])
    path = overruled(tmp_path, acknowledged={CODE: SENTENCE})
    found = identify(path, out=tmp_path / "out")
    assert found.verdict == "valid" and not found.reasons
    assert found.values == plain.values
    assert plain.document.power is None and found.document.power is not None
    (condition,) = found.document.conditions  # as of any other valid verdict
    assert condition.startswith("the data do not hide ")
    saved = read_result(tmp_path / "out")
    assert [(each.code, each.sentence) for each in saved.acknowledged] == [(CODE, SENTENCE)]
    told = " ".join(result_table(saved).split())
    assert f"acknowledged in the case: {CODE}" in told
    assert SENTENCE in told
    assert SENTENCE in (tmp_path / "out/report.html").read_text(encoding="utf-8")
    checked = " ".join(check(path).summary().split())
    assert f"Acknowledged in the case: {SENTENCE}" in checked and "with doubts" not in checked
    assert not mistakes(path)


def case_with(**sentences: str) -> Case:
    return load_case(SCARA).with_(acknowledged={k.replace("_", "-"): v for k, v in sentences.items()})


def test_codes_must_exist_be_doubts_and_have_a_sentence() -> None:
    problem = next(code.name for code in all_codes() if code.severity is PROBLEM)
    remark = next(code.name for code in all_codes() if code.severity is REMARK)
    with pytest.raises(UnknownNameError, match=rf"acknowledged\.unit-contradict-file[\s\S]*Did you mean '{CODE}'"):
        acknowledged(case_with(unit_contradict_file=SENTENCE))
    for name in (problem, remark):
        with pytest.raises(InputError, match=r"Only a doubt can be acknowledged[\s\S]*next: "):
            acknowledged(case_with(**{name: SENTENCE}))
    with pytest.raises(InputError, match=r"needs a sentence"):
        acknowledged(case_with(unit_contradicts_file="  "))
    assert acknowledged(case_with(unit_contradicts_file=SENTENCE)) == {CODE: SENTENCE}
    assert acknowledged(load_case(SCARA)) == {}


def diagnostics(*severities: object) -> list[Diagnostic]:
    codes = {code.severity: code for code in all_codes()}
    return [Diagnostic(codes[severity], "text", f"place {i}") for i, severity in enumerate(severities)]  # type: ignore[index]


def test_problems_other_doubts_and_what_has_not_settled_stay() -> None:
    doubt, problem = diagnostics(DOUBT, PROBLEM)
    said = {doubt.code.name: "checked", problem.code.name: "never mind"}
    assert judgement([doubt]).acknowledging(said).verdict == "valid"
    refused = judgement([doubt, problem]).acknowledging(said)
    assert (refused.verdict, refused.reasons) == ("refused", (problem,))
    assert judgement([doubt], settled=False).acknowledging(said).verdict == "not_settled"
    other = next(code for code in all_codes() if code.severity is DOUBT and code is not doubt.code)
    left = judgement([doubt, Diagnostic(other, "text")]).acknowledging(said)
    assert left.verdict == "doubtful" and [d.code for d in left.reasons] == [other]


def test_what_is_not_found_is_told() -> None:
    found = judgement([]).acknowledging({CODE: SENTENCE})
    assert found.verdict == "valid" and not found.acknowledged
    assert found.acknowledged_remarks == [f"Nothing was found of what the case acknowledges as {CODE}: take it out."]
