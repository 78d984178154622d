"""``fmu-didim discover``: options, what it writes, what it says."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Mapping
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
import yaml

from fmu_didim import discover, simulate
from fmu_didim.base.errors import InputError, UnknownNameError
from fmu_didim.cli.main import main
from fmu_didim.components import load_fmu
from fmu_didim.data.tables import read_trajectory
from fmu_didim.dynamics.robot import read_robot
from fmu_didim.export import fmu, variational
from fmu_didim.results.findings import FindingsDocument, findings_schema, load_findings
from tests.discovery.helpers import TRUTH, arm_case

FRICTION = {"quadratic_viscous": {"Fq": 0.3}}
LAG = {"actuator_lag": {"T": 0.008}}


@pytest.fixture(scope="module")
def printed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """Folder and printed text of one run of the command; the plant has quadratic viscous friction."""
    folder = tmp_path_factory.mktemp("arm")
    case = arm_case(folder, FRICTION)
    with redirect_stdout(StringIO()) as out:
        assert main(["discover", str(case), "--out", str(folder / "out"), "--quiet"]) == 0
    return folder, out.getvalue()


def document_of(printed: tuple[Path, str]) -> FindingsDocument:
    return load_findings(printed[0] / "out")


# ---- what it finds and prints ----------------------------------------------------------------------


@pytest.mark.gate
def test_planted_effect_is_found_with_its_size(printed: tuple[Path, str]) -> None:
    document = document_of(printed)
    assert document.answer == "named"
    assert [(f.effect, f.joint) for f in document.findings] == [("quadratic_viscous", 1)]
    (value,) = document.findings[0].parameters
    assert value.name == "Fq1"
    assert value.interval[0] < 0.3 < value.interval[1]  # type: ignore[operator]
    assert value.std < 0.1  # type: ignore[operator]
    base = {p.name: p for p in document.base_parameters}
    for name in ("ZZ", "MX", "MY", "Fv", "Fc"):
        found = base[f"{name}1"]
        assert found.value == pytest.approx(TRUTH[0][name], abs=3.5 * found.std)  # type: ignore[operator]
    assert document.noise.source == "periods"
    assert document.noise.period_s == pytest.approx(4.0)
    assert document.noise.std == pytest.approx([0.1], rel=0.15)


@pytest.mark.gate
def test_text_names_it_and_says_where_the_files_are(printed: tuple[Path, str]) -> None:
    folder, text = printed
    assert "uadratic" in text
    assert "Fq1" in text
    assert str(folder / "out" / "findings.json") in text
    assert str(folder / "out" / "discovery.html") in text


@pytest.mark.gate
def test_progress_is_shown_unless_asked_not_to(
    printed: tuple[Path, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    case = arm_case(tmp_path, held_out=False)
    assert main(["discover", str(case), "--out", str(tmp_path / "out"), "--rounds", "1"]) == 0
    shown = capsys.readouterr().out
    assert re.search(r"\d\.\d s  base model", shown)
    assert re.search(r"signatures of \d+ candidates", shown)
    assert "s  base model" not in printed[1]
    assert "signatures of" not in printed[1]


# ---- what it writes --------------------------------------------------------------------------------


def test_findings_follow_their_schema_and_load_again(printed: tuple[Path, str], tmp_path: Path) -> None:
    path = printed[0] / "out" / "findings.json"
    content = json.loads(path.read_text(encoding="utf-8"))
    schema = findings_schema()
    assert set(schema["required"]) <= set(content) <= set(schema["properties"])
    assert set(content["findings"][0]) == set(schema["$defs"]["FindingResult"]["properties"])
    document = load_findings(path)
    assert load_findings(path.parent) == document
    assert json.loads(document.model_dump_json(by_alias=True)) == content
    for broken in ("{", '{"schema_version": 1}', path.read_text(encoding="utf-8").replace('"named"', '"sure"', 1)):
        (tmp_path / "findings.json").write_text(broken, encoding="utf-8")
        with pytest.raises(InputError, match="no saved discovery"):
            load_findings(tmp_path)


def test_all_files_named_are_there(printed: tuple[Path, str]) -> None:
    files = document_of(printed).files
    assert {"signals_estimation", "signals_validation", "robot", "plant_fmu", "case"} <= set(files)
    assert all((printed[0] / "out" / name).is_file() for name in files.values())


def test_signals_show_the_shrinking_gap(printed: tuple[Path, str]) -> None:
    document = document_of(printed)
    for label in ("estimation", "validation"):
        table = read_trajectory(printed[0] / "out" / document.files[f"signals_{label}"])
        measured, base, final, speed = (table.select([f"{n}1"])[:, 0] for n in ("measured", "base", "final", "dq"))
        sigma = document.noise.std[0]
        for model, wanted in ((base, document.gap[label].before), (final, document.gap[label].after)):
            gap = np.sqrt(max(np.mean((measured - model) ** 2) / sigma**2 - 1, 0))
            assert gap == pytest.approx(wanted, abs=1e-6)
        assert np.std(measured - final) == pytest.approx(0.1, rel=0.1)
        assert np.ptp(speed) > 1.0


def test_augmented_case_gives_the_torque_of_the_fitted_model(printed: tuple[Path, str]) -> None:
    """The note says to how much; the same by a simulation of our own from the files, plant as FMU and as a model."""
    out = printed[0] / "out"
    document = document_of(printed)
    (note,) = [n for n in document.notes if "augmented case" in n]
    told = float(re.search(r"to (\S+) of its peak", note)[1])  # type: ignore[index]
    assert told < 2e-3  # the case is integrated by the rule, the fit as finely as its noise asks
    for label in ("estimation", "validation"):
        table = read_trajectory(out / document.files[f"signals_{label}"])
        wanted = table.select(["final1"])[:, 0]
        found = simulate(out / document.files["case"], experiment=label)
        at = np.round((table.time - found.time[0]) * 200).astype(int)
        assert np.abs(found.select(["tau1"])[at, 0] - wanted).max() <= (1.05 * told + 1e-6) * np.abs(wanted).max()
    content = yaml.safe_load((out / document.files["case"]).read_text(encoding="utf-8"))
    assert content["plant"] == {"kind": "fmu"}


def test_augmented_robot_carries_effect_and_values(printed: tuple[Path, str]) -> None:
    out = printed[0] / "out"
    document = document_of(printed)
    joint = read_robot(out / document.files["robot"]).joints[0]
    assert list(joint.effects) == ["viscous", "coulomb", "quadratic_viscous"]
    assert joint.parameters["Fq"] == pytest.approx(document.findings[0].parameters[0].value)
    for value in document.base_parameters:
        assert joint.parameters[value.name.removesuffix("1").rstrip("_")] == pytest.approx(value.value)


def test_plant_fmu_has_the_found_values(printed: tuple[Path, str]) -> None:
    document = document_of(printed)
    plant = load_fmu(printed[0] / "out" / document.files["plant_fmu"])
    start = {v.name: v.start for v in plant.parameters}
    assert start["Fq1"] == pytest.approx(document.findings[0].parameters[0].value)


@pytest.mark.gate
def test_augmented_case_is_the_base_of_the_next_discovery(printed: tuple[Path, str], tmp_path: Path) -> None:
    """With the effect added nothing is missing any more; the folder may lie elsewhere, seen from the case."""
    shutil.copytree(printed[0], tmp_path / "moved")
    document = discover(tmp_path / "moved" / "out" / "case_augmented.yaml")
    assert document.answer == "nothing"
    assert document.gap["validation"].before < 0.4  # type: ignore[operator]


@pytest.mark.gate
def test_lag_becomes_a_part_of_its_own(tmp_path: Path) -> None:
    """An effect of the drive is written as a component, and stands in the augmented robot as well."""
    document = discover(arm_case(tmp_path, LAG, sigma=0.05), tmp_path / "out")
    first = document.findings[0]
    assert first.effect in ("actuator_lag", "delay")
    assert first.joint == 1
    assert first.parameters[0].value == pytest.approx(0.008, rel=0.25)
    part = load_fmu(tmp_path / "out" / document.files[f"part_{first.effect}1"])
    start = {v.name: v.start for v in part.parameters}
    assert start[first.parameters[0].name.rstrip("_1")] == pytest.approx(first.parameters[0].value)
    table = read_trajectory(tmp_path / "out" / "signals_estimation.csv")
    assert first.effect in read_robot(tmp_path / "out" / "robot_augmented.yaml").joints[0].effects
    (note,) = [n for n in document.notes if "augmented case" in n]
    assert float(re.search(r"to (\S+) of its peak", note)[1]) < 2e-3  # type: ignore[index]
    assert np.std(table.select(["measured1"]) - table.select(["final1"])) == pytest.approx(0.05, rel=0.15)


# ---- a run that is ended from outside ----------------------------------------------------------------


@pytest.mark.gate
@pytest.mark.parametrize(
    ("at", "rounds"), [("signatures of", 0), ("fitting candidate", 0), ("writing the augmented", 1)]
)
def test_a_run_that_is_killed_leaves_what_it_knew(friction_case: Path, tmp_path: Path, at: str, rounds: int) -> None:
    """It says that it is not at its end, and a page of an earlier run is gone."""

    def kill(text: str) -> None:
        if text.startswith(at):
            raise KeyboardInterrupt

    (tmp_path / "discovery.html").write_text("nothing is missing", encoding="utf-8")
    with pytest.raises(KeyboardInterrupt):
        discover(friction_case, tmp_path, progress=kill)
    document = load_findings(tmp_path)
    assert document.answer == "unfinished"
    assert document.unfinished is not None
    assert (document.unfinished.code, document.unfinished.rounds) == ("search-running", rounds)
    assert [f.effect for f in document.findings] == ["quadratic_viscous"][:rounds]
    assert document.gap["estimation"].before > 0.5  # type: ignore[operator]
    assert not (tmp_path / "discovery.html").exists()


@pytest.mark.gate
def test_time_that_is_up_is_told_everywhere(
    friction_case: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """An effect is hidden, and none was tried: that is no answer."""
    assert main(["discover", str(friction_case), "--out", str(tmp_path), "--time-limit", "0.001"]) == 3
    printed = " ".join(capsys.readouterr().out.split())
    page = (tmp_path / "discovery.html").read_text(encoding="utf-8")
    document = load_findings(tmp_path)
    assert document.answer == "unfinished" and document.findings == []
    assert document.unfinished is not None
    assert {name for name, _ in document.unfinished.untried} >= {"quadratic_viscous", "torque_saturation", "backlash"}
    assert "Torques from outside were not looked for either." in document.unfinished.text
    assert document.gap["validation"].before is not None
    for shown in (printed, page):
        assert "NOT FINISHED" in shown and "NOTHING MISSING" not in shown
        assert document.unfinished.text.split(" (")[0] in shown
        assert "--time-limit" in shown
    assert "Not tried torque saturation, joint 1" in printed
    assert {c.outcome for c in document.candidates} == {"not tried"}


@pytest.mark.gate
def test_enough_time_changes_nothing(friction_case: Path, printed: tuple[Path, str]) -> None:
    document = discover(friction_case, time_limit=1e6)
    assert document.answer == "named"
    assert document.document.unfinished is None
    assert [p.value for p in document.findings[0].parameters] == [
        p.value for p in document_of(printed).findings[0].parameters
    ]
    outcomes = {(c.round, c.effect): c.outcome for c in document.document.candidates}
    assert outcomes[1, "quadratic_viscous"] == "fitted"


@pytest.mark.gate
def test_a_second_run_compiles_nothing(friction_case: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Compiled code is found again by its content."""

    def compiled(*_: object, **__: object) -> None:
        raise AssertionError("compiled again")

    discover(friction_case)
    variational._library.cache_clear()
    for module in (fmu, variational):
        monkeypatch.setattr(module, "compile_shared_library", compiled)
    assert [f.effect for f in discover(friction_case).findings] == ["quadratic_viscous"]


# ---- options ---------------------------------------------------------------------------------------


def proposed(document: FindingsDocument) -> set[str]:
    """All effects that took part in the end, named, refused or ambiguous."""
    named = {f.effect for f in document.findings}
    return named | {e for e, _, _ in document.refused} | {r.effect for f in document.findings for r in f.ambiguous}


@pytest.fixture(scope="module")
def friction_case(printed: tuple[Path, str]) -> Path:
    return printed[0] / "case.yaml"


@pytest.mark.gate
def test_forbidden_effects_are_not_named(friction_case: Path) -> None:
    forbidden = ("quadratic_viscous", "power_viscous")
    document = discover(friction_case, forbid=forbidden)
    assert not {f.effect for f in document.findings} & set(forbidden)
    assert not {e for e, _, _ in document.refused} & set(forbidden)
    assert document.findings[0].effect == "cubic_viscous", "the next best of the class"
    assert document.provenance["options"]["forbid"] == sorted(forbidden)


@pytest.mark.gate
def test_preferred_effect_is_taken_out_of_the_ambiguous_set(friction_case: Path, printed: tuple[Path, str]) -> None:
    """The power law fits as well; without the wish the one with fewer parameters is taken."""
    rivals = {r.effect: r.bic_behind for r in document_of(printed).findings[0].ambiguous}
    assert rivals["power_viscous"] is not None
    assert rivals["power_viscous"] < 10
    document = discover(friction_case, prefer=["power_viscous"])
    assert document.findings[0].effect == "power_viscous"
    assert "quadratic_viscous" in {r.effect for r in document.findings[0].ambiguous}


@pytest.mark.gate
def test_preferred_effect_that_does_not_fit_is_not_taken(friction_case: Path) -> None:
    assert discover(friction_case, prefer=["spring"]).findings[0].effect == "quadratic_viscous"


@pytest.mark.gate
def test_effect_from_outside_is_named(tmp_path: Path) -> None:
    """Torque Sw sin(3 q + 0.7), of no kind in the catalogue but ripple: with the class given, it wins."""
    name = "tests.discovery.helpers:SwayTorque"
    document = discover(arm_case(tmp_path, {name: {"Sw": 0.4}}), tmp_path / "out", effects=[name])
    assert name in document.provenance["catalogue"]
    first = document.findings[0]
    assert first.effect == name
    assert first.title == "Sway"
    assert first.parameters[0].interval[0] < 0.4 < first.parameters[0].interval[1]  # type: ignore[operator]
    assert any("augmented case" in n for n in document.notes)


@pytest.mark.gate
def test_no_rounds_only_localise(friction_case: Path) -> None:
    document = discover(friction_case, rounds=0)
    assert document.answer == "unknown"
    assert document.findings == []
    assert document.regions
    assert document.regions[0].joint == 1


@pytest.mark.gate
def test_same_seed_gives_the_same_findings(friction_case: Path, printed: tuple[Path, str]) -> None:
    first, second = document_of(printed), discover(friction_case)
    for name in ("answer", "findings", "gap", "ratio_interval", "base_parameters"):
        ours, theirs = (without_text(getattr(d, name)) for d in (first, second))
        assert ours == theirs, name


def without_text(value: object) -> object:
    """Findings without the texts about the next experiment, which only a run with an output folder designs."""
    if not isinstance(value, list):
        return value
    found = [v.model_copy(update={"experiment": ""}) if hasattr(v, "experiment") else v for v in value]
    for v in found:
        for i, rung in enumerate(getattr(v, "ladder", [])):
            v.ladder[i] = rung.model_copy(update={"next_step": ""})
    return found


# ---- held-out data ---------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def without_held_out(tmp_path_factory: pytest.TempPathFactory) -> FindingsDocument:
    return discover(arm_case(tmp_path_factory.mktemp("one"), FRICTION, held_out=False))


@pytest.mark.gate
def test_without_held_out_data_the_criterion_alone_decides(without_held_out: FindingsDocument) -> None:
    assert [(f.effect, f.joint) for f in without_held_out.findings] == [("quadratic_viscous", 1)]
    assert without_held_out.ratio_interval is None
    assert without_held_out.findings[0].ratio_interval is None
    assert set(without_held_out.gap) == {"estimation"}


def test_without_held_out_data_it_is_said(without_held_out: FindingsDocument) -> None:
    assert any("held" in note or "validation" in note for note in without_held_out.notes)


# ---- errors ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("option", ["forbid", "prefer"])
def test_unknown_effect_is_told_with_the_valid_names(friction_case: Path, option: str) -> None:
    with pytest.raises(UnknownNameError, match="stribek") as caught:
        discover(friction_case, **{option: ["stribek"]})
    assert "stribeck" in str(caught.value)


@pytest.mark.gate
@pytest.mark.parametrize(
    ("name", "error"),
    [
        ("tests.discovery.helpers:NoSuch", "NoSuch"),
        ("no_such_module:Effect", "no_such_module"),
        ("tests.discovery.helpers:TRUTH", "not an effect"),
        ("pathlib:Path", "not an effect"),
    ],
)
def test_wrong_further_effect_is_told(friction_case: Path, name: str, error: str) -> None:
    with pytest.raises(InputError, match=error):
        discover(friction_case, effects=[name])


@pytest.mark.parametrize(
    ("arguments", "told"),
    [(["--forbid", "stribek"], "stribeck"), (["--effect", "pathlib:Path"], "not an effect")],
)
def test_command_ends_with_an_error_and_no_files(
    friction_case: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], told: str
) -> None:
    assert main(["discover", str(friction_case), "--out", str(tmp_path / "out"), *arguments]) == 1
    shown = capsys.readouterr()
    assert told in shown.err
    assert "Traceback" not in shown.err
    assert not (tmp_path / "out").exists()


def test_missing_case_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["discover", str(tmp_path / "none.yaml")]) == 1
    assert "none.yaml" in capsys.readouterr().err


def test_case_without_torque_is_told(friction_case: Path, tmp_path: Path) -> None:
    shutil.copytree(friction_case.parent, tmp_path / "case")
    path = tmp_path / "case" / "case.yaml"
    content: Mapping[str, dict[str, object]] = yaml.safe_load(path.read_text(encoding="utf-8"))
    del content["train"]["torque"]
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    with pytest.raises(InputError, match="torque"):
        discover(path)
