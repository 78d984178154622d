"""The ladder of an effect from data of known runs: what they allow is climbed, what contradicts is a doubt, and the
experiment that says more is written so that the case takes it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from fmu_didim import discover
from fmu_didim.base.errors import InputError, UnknownNameError
from fmu_didim.case import load_case
from fmu_didim.data.signals import trajectory, write_csv
from fmu_didim.discovery.base_model import prepare
from fmu_didim.discovery.ladder.evidence import evidence_in
from fmu_didim.discovery.ladder.facts import facts_of
from fmu_didim.discovery.ladder.motions import new_part
from fmu_didim.dynamics.effects import EFFECTS
from fmu_didim.report.discovery.sections import discovery_table
from fmu_didim.results.findings import FindingsDocument, load_findings
from tests.discovery.helpers import TRUTH, Run, arm_document, arm_experiments

FRICTION = {"quadratic_viscous": {"Fq": 0.3}}
TRIED = ("quadratic_viscous", "torque_offset", "asymmetric_viscous")
FORBID = tuple(name for name in EFFECTS if name not in TRIED)
HEAVY = {"ZZ1": 2 * TRUTH[0]["ZZ"], "MX1": 2 * TRUTH[0]["MX"]}


def changed(case: Path, entries: Mapping[str, Mapping[str, Any]]) -> Path:
    """The case with further entries in its experiments."""
    document = yaml.safe_load(case.read_text(encoding="utf-8"))
    for label, own in entries.items():
        document["experiments"][label] |= own
    case.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
    return case


def states(document: FindingsDocument) -> dict[str, str]:
    (finding,) = document.findings
    assert (finding.effect, finding.joint) == ("quadratic_viscous", 1)
    return {rung.rung: rung.state for rung in finding.ladder}


def text_of(document: FindingsDocument, rung: str) -> str:
    return next(one.text for one in document.findings[0].ladder if one.rung == rung)


# ---- facts of runs, from their data -----------------------------------------------------------------


def test_facts_are_computed_from_reference_and_torque_not_from_labels(tmp_path: Path) -> None:
    runs = {
        "first": Run(4.0), "again": Run(4.0, role="validation"), "other": Run(5.0, role="validation"),
        "slow": Run(8.0, role="validation"), "heavy": Run(4.4, own=("ZZ1", "MX1"), base=HEAVY),
        "like": Run(4.4, own=("ZZ1", "Fv1")),
    }  # fmt: skip
    case = changed(arm_experiments(tmp_path, runs), {
        "slow": {"gains": {"Kp1": 2000.0}, "unit": "SN2", "date": "2024-06-01"}, "first": {"unit": "SN1"},
        "other": {"gains": {"Kp1": 3100.0}},
    })  # fmt: skip
    found = facts_of(prepare(load_case(case).model).fit)
    assert {label: one.new < 0.5 for label, one in found.items() if one.role == "validation"} == {
        "again": True, "other": False, "slow": False,
    }  # fmt: skip
    assert found["slow"].speed_of(1) == pytest.approx(0.5, rel=0.02)
    assert found["heavy"].load_of(1) > 0.3
    assert found["like"].load_of(1) < 0.1  # a value of its own that is the same, and friction, are no load
    assert found["again"].load_of(1) == 0.0
    assert found["slow"].gains == {"controller.Kp1": pytest.approx(2 / 3)}
    assert found["other"].gains == {}  # 3 % are hardly another controller
    assert (found["slow"].unit, found["first"].unit, found["again"].unit) == ("SN2", "SN1", "")
    assert str(found["slow"].day) == "2024-06-01"


def test_only_what_was_logged_counts_as_a_motion(tmp_path: Path) -> None:
    """Two runs of one reference: what one does before its log begins is not seen."""
    case = arm_experiments(tmp_path, {"one": Run(4.0, 4), "later": Run(4.0, 4, "validation")})
    changed(case, {"one": {"to_s": 8.0}, "later": {"from_s": 8.0}})
    facts = facts_of(prepare(load_case(case).model).fit)
    assert facts["later"].new == 0.0  # two periods more of the same; with one of another motion it would be new
    assert facts["later"].seconds == pytest.approx(8.0, abs=0.02)


def test_a_log_that_is_a_copy_is_seen_whatever_its_label_and_date(tmp_path: Path) -> None:
    case = arm_experiments(tmp_path, {"one": Run(4.0), "two": Run(4.0, 2, "validation"), "three": Run(4.4)})
    changed(case, {"two": {"torque": {"file": "one_torque.csv"}, "date": "2024-06-01"}})
    facts = facts_of(prepare(load_case(case).model).fit)
    assert {label: one.is_copied for label, one in facts.items()} == {"one": False, "two": True, "three": False}


@pytest.mark.parametrize("written", ["2024-06-01", "'2024-06-01'"])
def test_a_date_is_read_with_and_without_quotes(tmp_path: Path, written: str) -> None:
    case = changed(arm_experiments(tmp_path, {"one": Run(4.0)}), {"one": {"date": "DATE"}})
    case.write_text(case.read_text(encoding="utf-8").replace("DATE", written), encoding="utf-8")
    assert str(load_case(case).model.experiments["one"].day) == "2024-06-01"


def test_the_day_is_that_of_the_name_of_the_log_where_it_has_one(tmp_path: Path) -> None:
    case = arm_experiments(tmp_path, {"one": Run(4.0), "two": Run(4.4, role="validation")})
    for label, name in (("one", "axis_2024-05-31.csv"), ("two", "20240531_and_20240601.csv")):
        (tmp_path / f"{label}_torque.csv").rename(tmp_path / name)
        changed(case, {label: {"torque": {"file": name}}})
    experiments = load_case(case).model.experiments
    assert str(experiments["one"].day) == "2024-05-31"
    assert experiments["two"].day is None  # several dates say nothing


@pytest.mark.parametrize(
    ("entry", "error", "text"),
    [
        ({"gains": {"Kp9": 1.0}}, UnknownNameError, "Kp9"),
        ({"gains": {"plant.Fv1": 1.0}}, UnknownNameError, "plant.Fv1"),
        ({"gains": {"motor.Kp1": 1.0}}, UnknownNameError, "motor.Kp1"),
        ({"date": "FILL IN"}, InputError, "date"),
    ],
)
def test_wrong_entries_are_refused(
    tmp_path: Path, entry: Mapping[str, Any], error: type[InputError], text: str
) -> None:
    case = changed(arm_experiments(tmp_path, {"one": Run(4.0)}), {"one": entry})
    with pytest.raises(error, match=text):
        load_case(case)


def test_gains_that_are_identified_are_refused(tmp_path: Path) -> None:
    case = changed(arm_experiments(tmp_path, {"one": Run(4.0)}), {"one": {"gains": {"Kp1": 2000.0}}})
    content = yaml.safe_load(case.read_text(encoding="utf-8")) | {"identify": {"Kp1": {"of": "controller"}}}
    case.write_text(yaml.safe_dump(content), encoding="utf-8")
    with pytest.raises(InputError, match="identified, so that it is one for all"):
        load_case(case)


def test_gains_of_a_run_act_in_it_alone(tmp_path: Path) -> None:
    case = arm_experiments(tmp_path, {"one": Run(4.0), "two": Run(4.0, role="validation")})
    plain = load_case(case).model
    own = load_case(changed(case, {"two": {"gains": {"Kp1": 300.0}}})).model
    assert np.array_equal(own.torque(own.start, "one"), plain.torque(plain.start, "one"))
    assert np.abs(own.torque(own.start, "two") - plain.torque(plain.start, "two")).max() > 0.1


# ---- ladders of discoveries ---------------------------------------------------------------------------


@pytest.fixture(scope="module")
def climbed(tmp_path_factory: pytest.TempPathFactory) -> FindingsDocument:
    runs = {
        "first": Run(5.0, 3), "heavy": Run(4.4, 3, own=("ZZ1", "MX1"), base=HEAVY),
        "fast": Run(3.0, 4, role="validation"),
    }  # fmt: skip
    entries = {
        "first": {"unit": "SN1", "date": "2024-05-31"}, "heavy": {"unit": "SN1", "date": "2024-05-31"},
        "fast": {"unit": "SN1", "date": "2024-06-01"},
    }  # fmt: skip
    case = changed(arm_experiments(tmp_path_factory.mktemp("climbed"), runs, FRICTION), entries)
    return discover(case, forbid=FORBID).document


@pytest.mark.gate
def test_an_effect_climbs_what_the_runs_allow(climbed: FindingsDocument) -> None:
    assert states(climbed) == {
        "fit": "climbed", "held_out": "climbed", "load": "climbed", "gain": "open", "speed": "climbed",
        "unit": "open", "day": "climbed",
    }  # fmt: skip
    assert text_of(climbed, "unit") == "all runs are of SN1"
    assert "heavy (fitted)" in text_of(climbed, "load")
    assert climbed.verdict == "valid"
    for rung in climbed.findings[0].ladder:
        for one in rung.evidence:
            assert one.interval is not None and one.interval[0] < 1.0 < one.interval[1], (rung.rung, one)


@pytest.mark.gate
def test_the_terminal_shows_it(climbed: FindingsDocument) -> None:
    shown = discovery_table(climbed)
    for line in ("1 seen in the fit", "2 another motion", "3 other load", "4 other day", "not tried by these data"):
        assert line in shown, line
    assert "3 other gains, 4 other unit" in shown


@pytest.mark.gate
def test_an_effect_is_seen_with_other_gains(tmp_path: Path) -> None:
    """The log of a run whose controller was softer, by the loop that the case makes of it."""
    case = changed(
        arm_experiments(tmp_path, {"first": Run(4.0, 3), "soft": Run(4.8, 3, "validation")}, FRICTION),
        {"soft": {"gains": {"Kp1": 1500.0, "Kd1": 90.0}}},
    )
    plain = (tmp_path / "robot.yaml").read_text(encoding="utf-8")
    robot = arm_document(1, {1: tuple(FRICTION)})
    robot["joints"][0]["parameters"] |= FRICTION["quadratic_viscous"]
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(robot, sort_keys=False), encoding="utf-8")
    true = load_case(case).model
    torque = true.torque(true.start, "soft")[:, 0]
    torque += 0.1 * np.random.default_rng(3).normal(size=torque.size)
    write_csv(trajectory(true.experiments["soft"].time, {"tau1": torque}), tmp_path / "soft_torque.csv")
    (tmp_path / "robot.yaml").write_text(plain, encoding="utf-8")
    document = discover(case, forbid=FORBID).document
    assert states(document)["gain"] == states(document)["held_out"] == "climbed"
    assert document.verdict == "valid"


@pytest.fixture(scope="module")
def repeated(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, FindingsDocument]:
    """What is held out is the motion of the fit once more."""
    folder = tmp_path_factory.mktemp("repeated")
    case = arm_experiments(folder, {"first": Run(4.0, 4), "again": Run(4.0, 4, "validation")}, FRICTION)
    return case, discover(case, folder / "out", forbid=FORBID).document


@pytest.mark.gate
def test_a_motion_that_is_repeated_climbs_nothing(repeated: tuple[Path, FindingsDocument]) -> None:
    document = repeated[1]
    assert states(document)["held_out"] == "open"
    assert "again repeats the motion of a fitted run in 100 % of its time" in text_of(document, "held_out")
    assert document.verdict == "valid"  # open is no doubt


@pytest.mark.gate
def test_the_experiment_that_is_written_is_taken_by_the_case_and_climbs(
    repeated: tuple[Path, FindingsDocument],
) -> None:
    case, document = repeated
    out = case.parent / "out"
    assert document.files["experiment_next"] == "experiment_next.yaml"
    rung = next(one for one in load_findings(out).findings[0].ladder if one.rung == "held_out")
    assert rung.next_step.endswith("Its lines for the case: experiment_next.yaml.")
    lines = yaml.safe_load((out / "experiment_next.yaml").read_text(encoding="utf-8"))
    assert list(lines["experiments"]) == ["first", "again", "next"]
    time = np.arange(0, 15.0, 0.01)
    write_csv(
        trajectory(time, {"tau1": np.zeros(time.size)}), case.parent / lines["experiments"]["next"]["torque"]["file"]
    )
    content = yaml.safe_load(case.read_text(encoding="utf-8")) | lines
    (case.parent / "with_next.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    experiments = load_case(case.parent / "with_next.yaml").model.experiments
    assert experiments["next"].role == "validation"
    assert new_part(experiments["next"].reference, experiments["first"].reference, 1) >= 0.5


@pytest.mark.gate
def test_a_run_without_the_effect_makes_it_a_doubt(tmp_path: Path) -> None:
    """The effect passes the test on all that is held out together, but one of the runs does not have it."""
    runs = {
        "first": Run(4.0, 4), "held": Run(3.6, 8, "validation"),
        "changed": Run(5.0, 2, "validation", has_effects=False),
    }  # fmt: skip
    document = discover(arm_experiments(tmp_path, runs, FRICTION), forbid=FORBID).document
    assert states(document)["held_out"] == "contradicted"
    assert document.verdict == "doubtful"
    (reason,) = [one for one in document.reasons if one.code == "effect-contradicted"]
    assert reason.place == "quadratic viscous, joint 1"
    assert "changed (held out): it has" in reason.text


def test_evidence_of_each_run_is_of_its_own_rows(tmp_path: Path) -> None:
    """A fit against itself with one parameter moved: each run gives its own figures, and they add up."""
    runs = {"first": Run(4.0, 2), "held": Run(4.6, 2, "validation"), "other": Run(5.4, 2, "validation")}
    fit = prepare(load_case(arm_experiments(tmp_path, runs)).model).fit
    for label in runs:
        same = evidence_in(label, fit, fit)
        assert same.amplitude is None
        assert same.ratio is not None and same.ratio.value == 1.0
        assert same.says == "hardly excited"
