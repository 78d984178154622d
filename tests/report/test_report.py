"""The printed table (golden text) and the page."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Literal

import numpy as np
import pytest

from fmu_didim import identify
from fmu_didim.base.errors import InputError
from fmu_didim.checks.judgement import DiagnosticResult
from fmu_didim.checks.plant.consistency import ColumnResult
from fmu_didim.checks.validation import Validation
from fmu_didim.report import result_table, write_report
from fmu_didim.report.drawing.charts import decimated
from fmu_didim.report.identification.sections import result_html
from fmu_didim.report.numbers import loop_lines, pretty_unit, rounding, significant
from fmu_didim.results.result import (
    ConsistencyResult,
    ErrorResult,
    ExperimentResult,
    InitialStateResult,
    IterationResult,
    ParameterResult,
    ResultDocument,
    StageResult,
    save_result,
)

ERRORS: dict[Literal["estimation", "validation"], ErrorResult] = {
    "estimation": ErrorResult(total=4.831, per_joint=[4.831]),
    "validation": ErrorResult(total=5.1, per_joint=[5.1]),
}


def document(**changes: object) -> ResultDocument:
    """A small result made by hand."""
    parameters = {
        "ZZ1R": ParameterResult(
            value=3.4058, std=0.01784, rel_std_percent=0.5238, interval=(3.3704, 3.4412), unit="kg.m2", standard="ZZ1"
        ),
        "Fv1": ParameterResult(
            value=0.0457,
            std=0.0523,
            rel_std_percent=114.4,
            interval=(-0.0581, 0.1495),
            unit="N.m.s/rad",
            standard="Fv1",
        ),
        "delay": ParameterResult(
            value=0.404,
            std=0.0213,
            rel_std_percent=5.27,
            interval=(0.3618, 0.4462),
            unit="1",
            standard="",
            of="delay",
        ),
    }
    history = [
        IterationResult(
            stage="didim", number=1, relative_error_percent=None, change=None, condition_number=None,
            parameters={"ZZ1R": 0.034, "Fv1": 0.0}, note="The closed loop diverged; restarted",
            restarts=True,
        ),
        IterationResult(
            stage="didim", number=2, relative_error_percent=4.83, change=0.01, condition_number=3.4,
            parameters={"ZZ1R": 3.4, "Fv1": 0.04}, note="",
        ),
    ]  # fmt: skip
    content = dict(
        name="Two joints", description="A test", verdict="valid", reasons=[], status="converged", advice="Converged.",
        estimator="didim",
        iterations=2, finish_iterations=3, parameters=parameters,
        stages={"didim": StageResult(value={"ZZ1R": 3.41}, std={"ZZ1R": 0.018}, formulas={"paper": {"ZZ1R": 0.017}})},
        regrouping=["ZZ1R = ZZ1 + Ia1"], correlations=[("ZZ1R", "Fv1", -0.953)], condition_number=3.392,
        noise_std=[0.1712], torque_unit=["N.m"],
        experiments={
            label: ExperimentResult(
                role=label, samples=100, rate_hz=10.0, noise_std=[0.1712], relative_error_percent=error, own=[],
                agreement=None,
            )
            for label, error in ERRORS.items()
        },
        relative_error_percent=ERRORS,
        integration_error=2.9e-10, history=history, loop={"step_size_s": 0.005, "order": ["controller", "plant"]},
        signals={"estimation": "torque_estimation.csv"}, checks=["M(q) positive definite"],
        remarks=["Something to know."], provenance={"versions": {"python": "3"}},
    )  # fmt: skip
    return ResultDocument.model_validate(content | changes)


def refused() -> ResultDocument:
    return document(
        verdict="refused", status="refused", advice="The identified model is not physical.\n  next:  check the sign",
        parameters={}, stages={}, correlations=[], condition_number=None, noise_std=[], experiments={},
        relative_error_percent={}, integration_error=None, signals={},
    )  # fmt: skip


def unsettled() -> ResultDocument:
    return document(verdict="not_settled", status="maximum_iterations", advice="Increase maximum_iterations.")


GOLDEN = """\
Two joints (didim, 3 parameters)
A test

parameter  value      σ      %σ  unit       95 % interval
---------------------------------------------------------
ZZ1R       3.406  0.018    0.52  kg·m²       3.370  3.441
Fv1 *      0.046  0.052  110     N·m·s/rad  -0.058  0.149
-- the loop ---------------------------------------------
delay      0.404  0.021    5.3   samples     0.362  0.446
* not significantly different from zero
delay = (0.404 ± 0.021) samples = (2.02 ± 0.11) ms at a step of 5 ms

Torque   estimation %  validation %   noise σ
total            4.83          5.10
joint 1          4.83          5.10  0.17 N·m

Condition number    3.39
Iterations          2 + 3 (main + finish)
Correlations > 0.9  ZZ1R-Fv1 -0.953
Integration error   2.90e-08 % of the torque

Regrouping
  ZZ1R = ZZ1 + Ia1

Remarks
  Something to know.

VALID: converged in 2 + 3 iterations; M(q) positive definite; simulated torque 4.83 % off on
  estimation, 5.10 % on validation
"""


def test_table_is_this_text() -> None:
    assert result_table(document()) == GOLDEN


def consistency(**changes: object) -> ConsistencyResult:
    column = ColumnResult(difference=3e-7, cosine=1.0, size=1.0, joint=1)
    content = dict(
        agrees=True, worst=3.2e-7, points=20, torque_difference=[1e-9], columns={"ZZ1R": column}, method="probed",
        acceleration="output of the plant", warnings=[],
    )  # fmt: skip
    return ConsistencyResult.model_validate(content | changes)


def test_table_tells_whether_the_plant_agrees() -> None:
    text = result_table(document(consistency=consistency()))
    assert "Plant's equations   the plant agrees with the robot description to 3.2e-07 (20 instants)" in text
    unlike = consistency(agrees=False, worst=1.2, warnings=["Fc2: the column differs most at joint 2 (cosine 0.2)"])
    assert "Plant's equations   the plant differs from the robot description, by up to 1.2" in result_table(
        document(consistency=unlike)
    )
    unknown = consistency(agrees=False, worst=None, points=0, columns={}, warnings=["The plant could not be compared"])
    assert "the plant was not compared" in result_table(document(consistency=unknown))


def test_loop_in_words() -> None:
    components = {
        "controller": {"kind": "control", "source": "mine.py:pd", "origin": "mine.py:pd", "law": None},
        "plant": {"kind": "fmu", "source": "a/arm.fmu", "fmi_version": "3.0", "interface": "model-exchange",
                  "solver": "cvode", "reset": "re-instantiate"},
    }  # fmt: skip
    loop = {"order": ["controller", "plant"], "step_size_s": 0.004, "algorithm": "Jacobi", "components": components,
            "delay_samples": {"controller": 0.0, "plant": 1.25}}  # fmt: skip
    assert loop_lines(document(loop=loop).loop) == [
        "controller: mine.py:pd, python-control",
        "plant: arm.fmu, FMI 3.0 model-exchange, integrated by cvode, run again by re-instantiate",
        "250 Hz, Jacobi, delay: plant 1.25 samples",
    ]
    assert loop_lines(document().loop) == []


def test_table_of_a_refusal_gives_reasons_and_no_values() -> None:
    text = result_table(refused())
    assert "REFUSED: The identified model is not physical." in text
    assert "check the sign" in text
    assert "The closed loop diverged; restarted" in text
    assert "3.41" not in text


def test_table_of_an_unsettled_result_says_so_last() -> None:
    text = result_table(
        document(verdict="not_settled", status="maximum_iterations", advice="Increase maximum_iterations.")
    )
    assert text.rstrip().splitlines()[-1] == "NOT SETTLED: Increase maximum_iterations."


REASONS = [
    DiagnosticResult(
        code="worse-on-held-out", place="validation: joint 2", text="The torque error is 2.1 times that of the fit.",
        value=2.1, bound=1.25, unit="1", next_step="Run fmu-didim discover case.yaml.",
    ),
    DiagnosticResult(code="at-limit", place="", text="b < a.", value=None, bound=None, unit="", next_step=""),
]  # fmt: skip


def test_reasons_stand_last_in_the_table_and_in_the_banner_of_the_page(tmp_path: Path) -> None:
    doubtful = document(verdict="doubtful", reasons=REASONS)
    text = result_table(doubtful)
    head = text.index("DOUBTFUL: converged in 2 + 3 iterations")
    assert text[head:].splitlines()[2:] == [
        "  1. validation: joint 2: The torque error is 2.1 times that of the fit. [worse-on-held-out]",
        "     Next: Run fmu-didim discover case.yaml.",
        "  2. b < a. [at-limit]",
    ]
    page = write_report(saved(tmp_path, doubtful)).read_text(encoding="utf-8")
    banner = page[page.index('<div class="banner doubtful">') : page.index('<div class="cards">')]
    assert "worse-on-held-out" in banner
    assert "b &lt; a." in banner
    assert "Next: Run fmu-didim discover case.yaml." in banner
    assert "worse-on-held-out" in result_html(doubtful)


@pytest.mark.parametrize(
    ("conditions", "line"),
    [
        ([], ""),
        (["b is right"], "Provided that b is right."),
        (["b is right", "c is < 2"], "Provided that b is right; and that c is < 2."),
        (["b", "c is < 2", "d", "e"], "Provided that b; and that c is < 2; and that 2 more hold (Remarks)."),
    ],
)  # fmt: skip
def test_what_a_valid_verdict_rests_on_stands_below_its_line(conditions: list[str], line: str, tmp_path: Path) -> None:
    result = document(conditions=conditions)
    text = result_table(result)
    assert " ".join(text[text.index("VALID: ") :].split()).endswith(f"5.10 % on validation {line}".strip())
    page = write_report(saved(tmp_path, result)).read_text(encoding="utf-8")
    banner = page[page.index('<div class="banner good">') : page.index('<div class="cards">')]
    assert line.replace("<", "&lt;") in banner
    assert ("Provided that" in banner) == bool(line) == ("Provided that" in result_html(result))


def test_table_stays_within_100_columns() -> None:
    names = {f"a_very_long_parameter_name_{i}" * 3: document().parameters["Fv1"] for i in range(3)}
    text = result_table(document(parameters=names, remarks=["word " * 60]))
    assert max(len(line) for line in text.splitlines()) <= 100


@pytest.mark.parametrize(
    ("value", "std", "texts"),
    [
        (3.4058, 0.01784, ("3.406", "0.018")),
        (0.0996, 0.0996, ("0.10", "0.10")),
        (95174.0, 98.8, ("95174", "99")),
        (123456.0, 2345.0, ("123500", "2300")),
        (-0.001, 0.02, ("-0.001", "0.020")),
        (1.5e-7, 2.5e-9, ("1.500e-07", "0.025e-07")),
    ],
)
def test_rounding_follows_the_standard_deviation(value: float, std: float, texts: tuple[str, str]) -> None:
    digits = rounding(value, std)
    assert (digits.text(value), digits.deviation(std)) == texts


def test_units_and_significant_digits() -> None:
    assert pretty_unit("kg.m2") == "kg·m²"
    assert [pretty_unit(unit) for unit in ("degC", "degF", "J/degC", "deg/s", "degree")] == [
        "°C", "°F", "J/°C", "deg/s", "degree",
    ]  # fmt: skip
    assert pretty_unit("1") == ""
    assert significant(4.831) == "4.83"
    assert significant(None) == "–"


def saved(folder: Path, result: ResultDocument, *, count: int = 200) -> Path:
    time = np.linspace(0, 1, count)
    torque = np.sin(7 * time)[:, None]
    validation = Validation("estimation", "estimation", time, torque, torque + 0.01, 1.0, np.array([1.0]))
    save_result(result, [validation], folder)
    return folder


@pytest.mark.parametrize(
    "result", [document(), refused(), document(verdict="not_settled", status="maximum_iterations")]
)
def test_page_is_self_contained(tmp_path: Path, result: ResultDocument) -> None:
    text = write_report(saved(tmp_path, result)).read_text(encoding="utf-8")
    page = text[: text.index("<script>")]
    assert not re.search(r"<(script|link|img|iframe)[^>]*\b(src|href)=", text[: text.index("<script>")])
    assert "@import" not in page
    assert all(name in page for name in result.parameters)
    assert "The closed loop diverged; restarted" in page
    assert {"good": "VALID", "refused": "REFUSED", "doubtful": "NOT SETTLED"}[
        re.search(r'class="banner (\w+)"', page)[1]  # type: ignore[index]
    ] in page


def test_page_escapes_what_it_shows(tmp_path: Path) -> None:
    evil = "<script>alert(1)</script>"
    history = [document().history[0].model_copy(update={"note": evil})]
    result = document(name=evil, remarks=[evil], history=history, provenance={evil: evil})
    text = write_report(saved(tmp_path, result)).read_text(encoding="utf-8")
    assert "alert(1)" in text
    assert evil not in text


@pytest.mark.gate
def test_long_signals_do_not_swell_the_page(tmp_path: Path) -> None:
    path = write_report(saved(tmp_path, document(), count=200_000))
    assert path.stat().st_size < 2e6


def test_decimation_keeps_extremes_and_ends() -> None:
    time = np.arange(100_000) / 1e3
    values = np.sin(time)
    values[54_321] = 9.0
    values[12_345] = -7.0
    t, v = decimated(time, values, 1000)
    assert v.size <= 1002
    assert v.max() == 9.0
    assert v.min() == -7.0
    assert (t[0], t[-1]) == (time[0], time[-1])


def test_result_of_another_version_is_refused(tmp_path: Path) -> None:
    folder = saved(tmp_path, document())
    path = folder / "result.json"
    path.write_text(
        path.read_text(encoding="utf-8").replace('"schema_version": 3', '"schema_version": 2'), encoding="utf-8"
    )
    with pytest.raises(InputError, match="does not follow the schema"):
        write_report(folder)


def test_parameters_that_are_not_finite_are_saved_and_read(tmp_path: Path) -> None:
    history = [document().history[0].model_copy(update={"parameters": {"ZZ1R": float("nan")}})]
    write_report(saved(tmp_path, document(history=[h.model_dump() for h in history])))


def test_folder_without_a_result_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="There is no result"):
        write_report(tmp_path)


def test_the_start_is_where_the_iterations_began_that_led_to_the_answer(tmp_path: Path) -> None:
    """After a start that failed it is the next one; a remark on a step, or further rounds, begin no new start."""
    values = [0.034, 3.1, 3.3, 3.41]
    steps = [
        document()
        .history[1]
        .model_copy(update={"stage": stage, "number": number, "parameters": {"ZZ1R": value}, **more})
        for value, (stage, number, more) in zip(
            values,
            [
                ("didim", 1, {"restarts": True}),
                ("didim", 2, {"note": "step halved"}),
                ("didim", 3, {}),
                ("finish", 1, {}),
            ],
            strict=True,
        )
    ]
    shown = [document(history=history) for history in (steps, steps[1:])]
    for one in shown:
        page = write_report(saved(tmp_path, one)).read_text(encoding="utf-8")
        row = re.search(r"<tr[^>]*>(?:(?!</tr>).)*ZZ1R.*?</tr>", page, re.DOTALL)
        assert row is not None
        assert "3.100" in row[0]
        assert "0.034" not in row[0]


def test_initial_states_that_are_held_are_on_the_page(tmp_path: Path) -> None:
    plain = document()
    state = InitialStateResult(kind="given", values={"q1": 0.61, "integral1": 0.002})
    experiments = {
        label: e.model_copy(update={"initial_state": state if label == "estimation" else e.initial_state})
        for label, e in plain.experiments.items()
    }
    page = write_report(saved(tmp_path, document(experiments=experiments))).read_text(encoding="utf-8")
    assert "given: q1 = 0.61, integral1 = 0.002" in page
    assert "initial state" not in write_report(saved(tmp_path, plain)).read_text(encoding="utf-8").lower()


def test_a_deviation_below_the_bound_that_stands_before_it_is_explained(tmp_path: Path) -> None:
    """The finish of the SCARA attains its own bound, at other values and another noise: the page says so."""
    found = identify("examples/scara/identify.yaml", tmp_path)
    stages = found.document.stages
    bound, last = stages["didim"].formulas["cramer_rao"], stages["finish"].std
    below = [last[name] / bound[name] for name in last if last[name] < bound[name]]
    assert below and min(below) > 0.99
    page = " ".join((tmp_path / "report.html").read_text(encoding="utf-8").split())
    _, _, shown = page.partition('id="stages"')
    assert "the Cramér-Rao bound is the smallest that an unbiased estimator can have" in shown
    assert "so that its σ can be a little below the one that stands before it" in shown
