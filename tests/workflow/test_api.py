"""The names at the top of the package, and cases from a path, from a mapping and changed in memory."""

from __future__ import annotations

import ast
import importlib
import inspect
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fmu_didim
from fmu_didim import Didim, InputError, check, discover, excite, identify, load_case, simulate, trajectory
from fmu_didim.case.changes import CaseChanges
from fmu_didim.case.document import CaseDocument
from fmu_didim.cli.main import main
from tests.workflow.three_experiments import FOLDER, content

CASE = "examples/scara/identify.yaml"


def test_each_name_is_imported_from_its_home() -> None:
    tree = ast.parse(Path(fmu_didim.__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    homes = {a.name: node.module for node in tree.body if isinstance(node, ast.ImportFrom) for a in node.names}
    assert sorted(homes) == sorted(fmu_didim.__all__)
    for name, module in homes.items():
        assert getattr(fmu_didim, name) is getattr(importlib.import_module(f"fmu_didim.{module}"), name)


def test_top_level_imports_nothing_heavy_and_names_what_it_has() -> None:
    code = (
        "import sys, fmu_didim\n"
        "heavy = {'numpy', 'casadi', 'pydantic', 'scipy', 'matplotlib', 'pandas'} & set(sys.modules)\n"
        "sys.exit(f'imported: {heavy}' if heavy else 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "identify" in dir(fmu_didim)
    with pytest.raises(AttributeError, match="identity"):
        _ = fmu_didim.identity  # type: ignore[attr-defined]


def test_package_says_that_it_is_typed() -> None:
    assert (Path(fmu_didim.__file__).parent / "py.typed").is_file()


@pytest.mark.parametrize(
    "name", ["check", "discover", "excite", "export_ssp", "identify", "load_case", "simulate", "validate_on"]
)
def test_verbs_show_their_options(name: str) -> None:
    verb = getattr(fmu_didim, name)
    kinds = {p.kind for p in inspect.signature(verb).parameters.values()}
    assert not kinds & {inspect.Parameter.VAR_KEYWORD, inspect.Parameter.VAR_POSITIONAL}
    assert inspect.getdoc(verb)


@pytest.mark.parametrize("verb", [check, identify, discover, simulate, excite])
def test_options_that_a_verb_does_not_have_are_refused(verb: Any) -> None:
    with pytest.raises(TypeError, match="unexpected keyword argument 'torque'"):
        verb(CASE, torque=[1.0])


def test_cases_from_path_mapping_and_memory_give_the_same_torque() -> None:
    expected = simulate(CASE)
    case = load_case(CASE)
    log = case.model.experiments["estimation"]
    columns = {"tau1": log.torque[:, 0], "tau2": log.torque[:, 1]}
    in_memory = load_case(content(), folder=FOLDER, signals={"train_10hz.csv": trajectory(log.time, columns)})
    for other in (Path(CASE), case, in_memory, case.with_(name="the same")):
        np.testing.assert_array_equal(simulate(other).values, expected.values)
    np.testing.assert_array_equal(in_memory.model.measured, case.model.measured)


def test_other_rate_start_noise_and_estimator_by_entries() -> None:
    case = load_case(CASE)
    slow = case.with_(train={"torque": {"rate_hz": 5}}, torque_std=[0.2, 0.01], validation=None)
    assert slow.model.experiments["estimation"].rate_hz == pytest.approx(5)
    assert list(slow.model.experiments) == ["estimation"]
    assert list(slow.model.torque_deviation) == [0.2, 0.01]
    again = slow.with_(torque_std=None, train={"torque": {"rate_hz": None}})
    assert again.model.torque_deviation is None
    assert again.model.experiments["estimation"].rate_hz == pytest.approx(10)
    assert case.with_(estimator={"start": {"ZZ1R": 1.0}}).estimator.start == {"ZZ1R": 1.0}
    assert case.with_(estimator={"finish": False}).estimator.start["ZZ2"] == 6e-4
    assert case.with_(estimator={"kind": "clie"}).estimator.name == "clie"
    assert case.model.experiments["estimation"].rate_hz == pytest.approx(10)  # the first one is as it was


@pytest.mark.parametrize("form", [{}, {"estimate_delay": True}, {"kind": "didim", "estimate_delay": True}])
def test_options_without_a_kind_are_those_of_the_usual_estimator(form: dict[str, Any]) -> None:
    case = load_case({**content(), "estimator": form}, folder=FOLDER)
    assert case.estimator == Didim(estimate_delay="estimate_delay" in form)
    assert case.content["estimator"] == {"kind": "didim", **form}


def test_reference_of_another_kind_replaces_the_former_one() -> None:
    case = load_case(CASE)
    reference = case.reference("estimation")
    document = case.content
    document["train"]["reference"] = {"file": "motion.csv"}
    other = load_case(document, folder=FOLDER, signals={"motion.csv": reference})
    np.testing.assert_array_equal(other.reference("estimation").values, reference.values)
    back = other.with_(train={"reference": case.content["train"]["reference"]})
    assert "file" not in back.content["train"]["reference"]


def test_noise_in_memory_is_identified_with_its_digest_in_the_provenance() -> None:
    case = load_case(CASE).with_(validation=None)
    clean = simulate(case)
    torque = clean.select(["tau1", "tau2"])[::20] + np.random.default_rng(1).normal(scale=[0.2, 0.01], size=(101, 2))
    log = trajectory(clean.time[::20], {"tau1": torque[:, 0], "tau2": torque[:, 1]})
    outcome = identify(case.with_signals({"train_10hz.csv": log}))
    assert abs(outcome.values["ZZ1R"] - 3.43) < 5 * outcome.parameters["ZZ1R"].std
    assert outcome.document.provenance["files"]["train_10hz.csv"] == log.digest()


def test_logs_are_read_only_where_they_are_needed() -> None:
    document = {**content(), "train": {**content()["train"], "torque": {"file": "nowhere.csv"}}, "validation": None}
    case = load_case(document, folder=FOLDER, require_torque=False)
    assert simulate(case).time.size == 2001
    with pytest.raises(InputError, match="A data file is absent"):
        _ = case.model
    with pytest.raises(InputError, match="A data file is absent"):
        load_case(document, folder=FOLDER)


def test_every_entry_of_a_case_can_be_changed() -> None:
    assert set(CaseChanges.__annotations__) == set(CaseDocument.model_fields) - {"schema_version"}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"trian": {}}, "trian: unknown key. Did you mean 'train'\\? Valid keys: schema, name"),
        ({"train": {"torque": {"rate_hz": -3}}}, "train.torque.rate_hz: must be greater than 0 \\(got -3\\)"),
        ({"estimator": {"kind": "didm"}}, "there is no estimator 'didm'; valid: didim"),
        ({"estimator": {"strat": 1}}, "unknown option 'strat' of didim"),
        ({"robot": "nowhere.yaml"}, "The case names files that do not exist"),
        ({"train": {"torque": {"file": "nowhere.csv"}}}, "A data file is absent"),
        ({"torque_std": [0.1]}, "torque_std needs one value for each joint"),
        ({"train": None}, "give train: \\(reference and torque\\)"),
    ],
)
def test_wrong_changes_are_refused_with_a_message(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        load_case(CASE).with_(**changes)


def test_mapping_without_its_folder_is_refused_with_the_way_out() -> None:
    with pytest.raises(InputError, match=r"load_case\(content, folder=\.\.\.\)"):
        load_case(content())


def test_signals_for_no_file_of_the_case_are_refused() -> None:
    case = load_case(CASE)
    log = trajectory(np.array([0.0, 1.0]), {"tau1": np.zeros(2)})
    with pytest.raises(InputError, match=r"Did you mean 'train_10hz\.csv'"):
        case.with_signals({"train.csv": log})
    with pytest.raises(InputError, match="There is no column named 'tau2'"):
        case.with_signals({"train_10hz.csv": log})


def test_check_verb_of_the_command_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", CASE]) == 0
    printed = capsys.readouterr().out
    assert "Experiment  estimation: 100 samples at 10 Hz" in printed
    assert printed.rstrip().splitlines()[-1].startswith("READY")
