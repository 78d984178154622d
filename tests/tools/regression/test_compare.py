"""The comparison of two records: what counts as the same, how far parameters are apart, and what fails."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from tests.tools.regression.__main__ import main
from tests.tools.regression.compare import (
    Difference,
    Limits,
    Record,
    Value,
    compare,
    difference,
    read_record,
    row_of,
    text,
)

PROJECT = {"version": "0.1.0", "commit": "0123456789abcdef", "changed": False, "source": "fedcba9876543210"}


@pytest.mark.parametrize(
    ("a", "b", "expected"),
    [
        (Value(2.0, 0.1), Value(2.0, 0.3), None),
        (Value(2.0, 0.1), Value(2.5, 0.3), Difference("p", 0.2, 5.0)),
        (Value(2.5, 0.1), Value(2.0, 0.3), Difference("p", 0.2, 5.0)),
        (Value(-1.0, 0.5), Value(1.0, 0.1), Difference("p", 2.0, 4.0)),
        (Value(0.0, 1.0), Value(0.25, 1.0), Difference("p", 1.0, 0.25)),
        (Value(2.0), Value(1.0, 0.1), Difference("p", 0.5, None)),
        (Value(2.0, 0.0), Value(1.0, 0.1), Difference("p", 0.5, None)),
        (Value(None), Value(None), None),
        (Value(None), Value(1.0), Difference("p", math.inf, None)),
        (Value(1.0, 0.1), Value(None), Difference("p", math.inf, None)),
        (None, Value(1.0, 0.1), Difference("p", math.inf, None)),
        (Value(1.0, 0.1), None, Difference("p", math.inf, None)),
        (Value(None), None, Difference("p", math.inf, None)),
    ],
)
def test_difference_of_a_parameter(a: Value | None, b: Value | None, expected: Difference | None) -> None:
    assert difference("p", a, b) == expected


def record(**changes: Any) -> Record:
    """Discovery that named one effect."""
    values = {"Fc1": Value(2.0, 0.125), "stribeck@1 Fs1": Value(0.5, 0.25)}
    plain = Record(
        "blind one", "0.1.0", {"plant": "model"}, {"case.yaml": "12"}, "named", ("stribeck@1",), values, 9.0, 4.0
    )
    return replace(plain, **changes)


def moved(**values: float) -> Record:
    """The same with other values of base parameters."""
    return record(values={**record().values, **{name: Value(value, 0.125) for name, value in values.items()}})


@pytest.mark.parametrize(
    ("b", "limits", "problem", "relative", "sigma"),
    [
        (record(), Limits(0.0, 0.0), "", None, None),
        (record(seconds=90.0), Limits(0.0, 0.0), "", None, None),
        (moved(Fc1=2.5), Limits(), "", 0.2, 4.0),
        (moved(Fc1=2.5), Limits(relative=0.2), "", 0.2, 4.0),
        (moved(Fc1=2.5), Limits(relative=0.19), "beyond the limit", 0.2, 4.0),
        (moved(Fc1=2.5), Limits(sigma=4.0), "", 0.2, 4.0),
        (moved(Fc1=2.5), Limits(sigma=3.9), "beyond sigma", 0.2, 4.0),
        (moved(Fc1=2.5), Limits(relative=1.0, sigma=3.9), "beyond sigma", 0.2, 4.0),
        (moved(Fv1=1.0), Limits(), "other parameters", math.inf, None),
        (record(values={**record().values, "Fc1": Value(None)}), Limits(), "other parameters", math.inf, None),
        (record(values={"Fc1": Value(2.0)}), Limits(), "other parameters", math.inf, None),
        (record(verdict="named_with_remainder"), Limits(), "other verdict", None, None),
        (record(names=("stribeck@2",)), Limits(), "other names", None, None),
        (record(verdict="nothing", names=()), Limits(), "other names", None, None),
        (record(inputs={"case.yaml": "13"}), Limits(), "other input", None, None),
        (record(options={"plant": "fmu"}), Limits(), "other options", None, None),
    ],
)
def test_what_is_wrong_with_a_case(
    b: Record, limits: Limits, problem: str, relative: float | None, sigma: float | None
) -> None:
    row = row_of(record(), b, limits)
    assert row.problem == problem
    assert (row.relative and row.relative.relative) == relative
    assert (row.sigma and row.sigma.sigma) == sigma
    found = compare({"one": record()}, {"one": b}, limits)
    assert found.passed is (not problem)
    assert problem.upper() in text(found)


def test_the_largest_differences_may_be_of_two_parameters() -> None:
    a, b = (record(values={"small": Value(s, 1.0), "sure": Value(t, 0.001)}) for s, t in ((0.01, 5.0), (0.02, 5.1)))
    row = row_of(a, b, Limits())
    assert row.relative is not None and row.sigma is not None
    assert (row.relative.parameter, row.sigma.parameter) == ("small", "sure")
    assert "named: stribeck@1; small, sure" in text(compare({"one": a}, {"one": b}, Limits()))


def test_parameters_of_other_names_are_not_compared() -> None:
    row = row_of(record(), record(names=(), values={"Fc1": Value(9.0, 0.1)}), Limits())
    assert row.relative is None
    assert not row.is_same


def test_order_and_cases_of_one_side() -> None:
    a = {name: record(case=name) for name in ("same", "apart", "other", "alone")}
    b = {name: record(case=name) for name in ("same", "new")}
    b |= {"apart": replace(moved(Fc1=2.5), case="apart"), "other": record(case="other", names=("spring@1",))}
    found = compare(a, b, Limits())
    assert [row.a.case for row in found.rows] == ["other", "apart", "same"]
    assert (found.only_a, found.only_b) == (("alone",), ("new",))
    lines = text(found).splitlines()
    assert lines[4].endswith("named: stribeck@1 -> named: spring@1; OTHER NAMES")
    assert lines[5].split()[:5] == ["apart", "2.0e-01", "4.0e+00", "4.0", "4.0"]
    assert "2 of 3 cases have the same names and verdict, 1 of them the same parameters to the last bit" in lines
    assert "1 only in A: alone" in lines
    times = "A 12 s, B 12 s, in the median 1.00 times as long; by the clock 27 s, 27 s"
    assert lines[-1] == f"time of the processor: {times}"


def test_no_common_case_is_no_agreement() -> None:
    found = compare({"one": record()}, {"two": record()}, Limits())
    assert not found.passed
    assert "no case is in both" in text(found)


def content(verb: str, result: Mapping[str, Any] | None, error: str = "") -> dict[str, Any]:
    return {
        "case": "c", "project": PROJECT, "verb": verb, "options": {}, "inputs": {}, "result": result, "error": error,
        "seconds": 1.5, "cpu_seconds": 1.25,
    }  # fmt: skip


def test_records_of_both_verbs_and_of_a_failure() -> None:
    parameter = {"value": 1.0, "std": 0.1}
    found = read_record(content("identify", {"status": "converged", "parameters": {"Fv1": parameter}}))
    assert (found.outcome, found.values) == ("converged", {"Fv1": Value(1.0, 0.1)})
    finding = {"effect": "stribeck", "joint": 2, "parameters": [{"name": "Fs2", "value": 3.0, "std": None}]}
    result = {"verdict": "named", "findings": [finding], "base_parameters": [{"name": "Fv1", **parameter}]}
    found = read_record(content("discover", result))
    assert found.outcome == "named: stribeck@2"
    assert found.values == {"Fv1": Value(1.0, 0.1), "stribeck@2 Fs2": Value(3.0)}
    found = read_record(content("discover", None, "InputError: no torque\n  where: here"))
    assert (found.outcome, found.values) == ("error: InputError: no torque", {})
    assert found.project == "0.1.0, commit 0123456789ab (source fedcba98)"


def test_command_line_tells_by_its_exit_code(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name, value in (("a", 1.0), ("b", 1.1)):
        result = {"status": "converged", "parameters": {"Fv1": {"value": value, "std": 0.1}}}
        (tmp_path / name).mkdir()
        (tmp_path / name / "c.json").write_text(json.dumps(content("identify", result)))
    folders = [str(tmp_path / "a"), str(tmp_path / "b")]
    assert main(["compare", *folders]) == 0
    assert main(["compare", *folders, "--sigma", "2"]) == 0
    assert main(["compare", *folders, "--limit", "0.01"]) == 1
    assert "BEYOND THE LIMIT" in capsys.readouterr().out
    with pytest.raises(SystemExit) as raised:
        main(["compare", folders[0], str(tmp_path)])
    assert raised.value.code == 2
