"""What has changed between two results, and all that could mislead about it."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmu_didim import Case, InputError, compare
from fmu_didim.cli.main import main
from fmu_didim.results.comparison import ComparisonDocument, load_comparison
from fmu_didim.workflow.output.result import Result
from tests.discovery.change.pairs import identified, log_of, write_case

RATE = 20.0


@pytest.fixture(scope="module")
def before() -> Result:
    return identified(log_of(RATE, 1))


@pytest.fixture(scope="module")
def again() -> Result:
    return identified(log_of(RATE, 2))


def codes(document: ComparisonDocument) -> set[str]:
    return {reason.code for reason in document.reasons}


def other(result: Result, **changes: Any) -> Result:
    """A result whose document says something else."""
    return replace(result, document=result.document.model_copy(update=changes))


def moved(result: Result, **values: float) -> Result:
    """A result with other values, as if the machine had them."""
    found = {
        name: p.model_copy(update={"value": p.value + values.get(name, 0.0)}) for name, p in result.parameters.items()
    }
    return other(result, parameters=found)


def test_nothing_has_changed(before: Result, again: Result) -> None:
    found = compare(before, again)
    assert (found.answer, found.exit_code, found.causes) == ("unchanged", 0, [])
    assert not any(p.moved for p in found.document.parameters.values())
    assert "Provided that no change is smaller than these data show" in found.summary()
    assert max(map(len, found.summary().splitlines())) <= 100
    assert "seen from" in found.summary().splitlines()[2]  # one table
    assert found.to_frame().loc["MX2", "least_seen"] > 3 * before.parameters["MX2"].std


def test_files_command_line_and_python_say_the_same(
    before: Result, again: Result, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folders = [tmp_path / name for name in ("spring", "autumn")]
    before.save(folders[0])
    moved(again, MX2=0.03).save(folders[1])
    out = tmp_path / "out"
    assert main(["compare", *map(str, folders), "--out", str(out)]) == 5
    printed = capsys.readouterr().out
    assert "CHANGED: MX2 alone" in printed
    saved = load_comparison(out)
    assert (out / "compare.html").is_file()
    assert saved.causes[0].parts[0].title == "MX2 alone"
    assert main(["compare", *(str(folder / "result.json") for folder in folders), "--out", str(out), "--json"]) == 5
    shown = json.loads(capsys.readouterr().out)
    python = compare(*folders).document.model_dump(mode="json")
    for document in (shown, python):
        document["provenance"].pop("made")
    assert shown == python
    before.save(tmp_path / "copy")
    assert main(["compare", str(folders[0]), str(tmp_path / "copy"), "--out", str(out), "--json"]) == 1
    assert "same log" in json.loads(capsys.readouterr().out)["error"]


@pytest.mark.gate
def test_a_payload_is_found_with_its_mass_and_place(before: Result) -> None:
    found = compare(before, identified(log_of(RATE, 3, mass=(0.3, 0.2, 0.05))))
    assert found.causes == ["payload on the last link"]
    amounts = {a.name: a for a in found.document.causes[0].parts[0].amounts}
    for name, truth in {"mass": 0.3, "cx": 0.2, "cy": 0.05}.items():
        assert amounts[name].std is not None
        assert abs(amounts[name].value - truth) < 4 * amounts[name].std
    assert found.exit_code == 5


def test_a_small_second_change_beside_a_large_one_is_doubted_and_named(before: Result, again: Result) -> None:
    sigma = {name: p.std for name, p in before.parameters.items()}
    one = compare(before, moved(again, Fc2=150 * sigma["Fc2"])).document
    assert (one.verdict, [c.parts[0].title for c in one.causes]) == ("valid", ["friction of joint 2"])
    two = compare(before, moved(again, Fc2=150 * sigma["Fc2"], ZZ2=12 * sigma["ZZ2"])).document
    assert [c.parts[0].title for c in two.causes] == ["friction of joint 2"]
    assert codes(two) == {"change-rest"}
    assert "second one: friction of joint 2" in two.reasons[0].text
    assert "ZZ2 alone" in two.reasons[0].text


def test_a_doubtful_result_hands_its_doubts_on(before: Result, again: Result) -> None:
    doubted = other(again, verdict="doubtful", reasons=[])
    found = compare(before, doubted)
    assert (found.answer, found.exit_code) == ("unchanged", 4)
    assert codes(found.document) == {"change-result-doubted"}
    assert found.document.conditions == []
    assert compare(before, moved(doubted, MX2=0.03)).exit_code == 5


@pytest.mark.parametrize("verdict", ["refused", "not_settled"])
def test_values_that_have_not_settled_are_not_compared(before: Result, again: Result, verdict: str) -> None:
    with pytest.raises(InputError, match="without settled values"):
        compare(before, other(again, verdict=verdict))


@pytest.mark.gate
def test_the_same_log_is_refused_at_another_rate_and_without_tables(before: Result) -> None:
    with pytest.raises(InputError, match="come from the same log"):
        compare(before, before)
    with pytest.raises(InputError, match="come from the same log"):
        compare(before, identified(log_of(RATE, 1, every=2)))
    record = before.document.provenance
    bare = replace(
        other(before, provenance={**record, "files": {"log.csv": "1", "case.yaml": "2"}}), validations=()
    )  # fmt: skip
    with pytest.raises(InputError, match="come from the same log"):
        compare(bare, bare)
    apart = {"estimation": {**record["experiments"]["estimation"], "first_s": 100.0, "last_s": 110.0}}
    later = other(bare, provenance={**bare.document.provenance, "experiments": apart})
    assert compare(bare, later).answer == "unchanged"  # two parts of one file


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"regrouping": ["ZZ1R = ZZ1 + Ia1"]}, "ZZ1R = ZZ1"),
        ({"geometry": None}, "frames"),
        ({"torque_unit": ["N.m"]}, "joint 1"),
    ],
)
def test_results_of_other_models_are_refused(before: Result, again: Result, changes: dict[str, Any], why: str) -> None:
    with pytest.raises(InputError, match="different models") as error:
        compare(before, other(again, **changes))
    assert why in str(error.value.got)


def test_another_unit_is_another_model(before: Result, again: Result) -> None:
    found = dict(again.parameters)
    found["ZZ2"] = found["ZZ2"].model_copy(update={"unit": "g.m2"})
    with pytest.raises(InputError, match="different models"):
        compare(before, other(again, parameters=found))


def test_a_value_that_only_one_has_identified_is_told(before: Result, again: Result) -> None:
    kept = {name: p for name, p in again.parameters.items() if name != "Fv1"}
    places = [k for k, name in enumerate(again.parameters) if name != "Fv1"]
    covariance = np.array(again.document.covariance)[np.ix_(places, places)].tolist()
    found = compare(before, other(again, parameters=kept, covariance=covariance)).document
    assert found.left_out == {"Fv1": "is identified before only"}
    assert "change-held" in codes(found)
    assert "Fv1" not in found.parameters


def test_values_held_at_others_are_told(before: Result, again: Result) -> None:
    record = {**again.document.provenance, "shape_parameters": {"v0_1": 0.02, "v0_2": 0.05}}
    found = compare(before, other(again, provenance=record)).document
    assert [r.text for r in found.reasons] == ["Held at different values before and after: v0_2 0.02 and 0.05."]


def test_values_of_one_experiment_are_not_compared(before: Result, again: Result) -> None:
    own = dict(again.parameters)
    own["Fv1"] = own["Fv1"].model_copy(update={"experiment": "estimation"})
    found = compare(before, other(again, parameters=own)).document
    assert "values of its own" in found.left_out["Fv1"]
    assert any("Fv1 has values of its own" in remark for remark in found.remarks)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (lambda loop: {**loop, "step_size_s": 0.004}, "step_size_s"),
        (lambda loop: {**loop, "components": {**loop["components"], "controller": {"sha256": "1"}}}, "controller"),
    ],
)
def test_another_loop_is_told(
    before: Result, again: Result, change: Callable[[dict[str, Any]], dict[str, Any]], named: str
) -> None:
    found = compare(before, other(again, loop=change(again.document.loop))).document
    assert codes(found) == {"change-loop"}
    assert named in found.reasons[0].text


@pytest.mark.gate
def test_a_residual_that_grew_is_told_though_no_value_moved(before: Result) -> None:
    found = compare(before, identified(log_of(RATE, 4, noise=1.6)))
    assert found.exit_code == 4
    assert codes(found.document) == {"change-residual"}
    assert [r.changed for r in found.document.residual] == [True, True]
    assert "but the residual of joint 1, joint 2 is not as large as before" in found.document.text
    assert "VALUES UNCHANGED, BUT NOT THE RESIDUAL, WITH DOUBTS" in found.summary()


def test_another_motion_is_a_condition(before: Result, again: Result) -> None:
    record = json.loads(json.dumps(again.document.provenance))
    record["experiments"]["estimation"]["reference_sha256"] = "1"
    found = compare(before, other(again, provenance=record)).document
    assert any("two motions" in condition for condition in found.conditions)
    assert any("motions of the two logs differ" in remark for remark in found.remarks)


def test_without_a_robot_single_parameters_are_named_and_that_is_said(before: Result, again: Result) -> None:
    bare = [replace(result, described={}) for result in (before, moved(again, MX2=0.03))]
    found = compare(*bare)
    assert found.causes == ["MX2 alone"]
    assert any("Without a robot description" in remark for remark in found.document.remarks)


def test_a_change_of_everything_is_unknown(before: Result, again: Result) -> None:
    rng, far = np.random.default_rng(0), {}
    for name, p in again.parameters.items():
        far[name] = float(15 * p.std * rng.choice([-1, 1]))
    found = compare(before, moved(again, **far))
    assert (found.answer, found.causes, found.exit_code) == ("unknown", [], 5)
    assert "no cause that was tried explains that" in found.document.text


def test_one_case_twice_is_refused_before_it_is_identified(monkeypatch: pytest.MonkeyPatch) -> None:
    verb = sys.modules["fmu_didim.workflow.compare.verb"]
    monkeypatch.setattr(verb, "identify", lambda case: pytest.fail("identified"))
    with pytest.raises(InputError, match="one file twice"):
        compare("examples/scara/identify.yaml", Path("examples/scara").resolve() / "identify.yaml")


def test_a_case_that_cannot_be_identified_is_told_with_its_place(
    before: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(case: Case) -> Result:
        raise InputError("No values.", got="nothing", next_step="Try again.")

    monkeypatch.setattr(sys.modules["fmu_didim.workflow.compare.verb"], "identify", refused)
    write_case(tmp_path / "spring.yaml", log_of(RATE, 1))
    with pytest.raises(InputError, match="The log after gives no values to compare") as error:
        compare(before, tmp_path / "spring.yaml")
    assert error.value.where == str(tmp_path / "spring.yaml")


def test_a_folder_without_a_result_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no result"):
        compare(tmp_path, tmp_path / "other")


def test_effects_that_were_not_looked_for_are_told(before: Result, again: Result, tmp_path: Path) -> None:
    found = compare(before, again).document
    assert any("give the two cases" in remark for remark in found.remarks)
    before.save(tmp_path)
    with pytest.raises(InputError, match="holds no loop"):
        compare(Result.load(tmp_path), again, effects=True)


@pytest.mark.gate
def test_two_cases_are_identified_and_a_late_clock_is_told_beside_a_payload(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spring, autumn = tmp_path / "spring.yaml", tmp_path / "autumn.yaml"
    write_case(spring, log_of(RATE, 1))
    write_case(autumn, log_of(RATE, 3, mass=(0.3, 0.2, 0.05), late_s=0.01))
    out = tmp_path / "out"
    assert main(["compare", str(spring), str(autumn), "--out", str(out)]) == 5
    printed = capsys.readouterr().out
    assert "identifying the log after" in printed
    saved = load_comparison(out)
    parts = {part.kind: part for part in saved.causes[0].parts}
    assert set(parts) == {"log_time_shift", "payload"}
    assert parts["log_time_shift"].title == "time shift of the torque log, new"
    for kind, name, truth in (("log_time_shift", "log_shift", 0.01), ("payload", "mass", 0.3)):
        amount = next(a for a in parts[kind].amounts if a.name == name)
        assert amount.std is not None
        assert abs(amount.value - truth) < 4 * amount.std
    assert [amount.unit for amount in parts["log_time_shift"].amounts] == ["s"]
    assert "change-residual" not in codes(saved)  # the shift explains it
    assert main(["compare", str(spring), str(autumn), "--out", str(out), "--no-effects", "--json"]) == 5
    values = json.loads(capsys.readouterr().out)
    assert [part["kind"] for part in values["causes"][0]["parts"]] == ["payload"]
    assert "change-residual" in {reason["code"] for reason in values["reasons"]}


@pytest.mark.gate
def test_where_effects_cannot_be_looked_for_values_are_compared_and_that_is_said(tmp_path: Path) -> None:
    paths = [tmp_path / name for name in ("spring.yaml", "autumn.yaml")]
    for seed, path in enumerate(paths):
        write_case(path, log_of(RATE, seed + 1), low_pass={"cutoff_hz": 5})
    found = compare(*paths)
    assert any("not looked for: before, the case has a low_pass." in remark for remark in found.document.remarks)
    with pytest.raises(InputError, match="effects cannot be looked for"):
        compare(*paths, effects=True)
