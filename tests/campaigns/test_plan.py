"""Combinations, identities, and what they depend on."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from fmu_didim.base.errors import InputError
from fmu_didim.campaigns.planning import identity
from fmu_didim.campaigns.planning.fields import labels, with_value
from fmu_didim.campaigns.planning.plan import Plan
from tests.campaigns.helpers import CASE, LAWS, plan_of
from tests.cases import scara_case


@pytest.mark.parametrize(
    ("path", "value", "place", "expected"),
    [
        ("loop.delay_samples", 1, ("loop", "delay_samples"), 1),
        ("train.torque.rate_hz", 5, ("train", "torque", "rate_hz"), 5),
        ("train.reference.joints.1.cosine", [1], ("train", "reference", "joints", 1, "cosine"), [1]),
        ("robot.joints.0.parameters.Fv", 9.0, ("robot", "joints", 0, "parameters", "Fv"), 9.0),
        ("controller.source.Kp", [1, 2], ("controller", "source", "Kp"), [1, 2]),
        ("estimator.start", None, ("estimator",), {"kind": "didim"}),
    ],
)
def test_a_field_by_its_path(path: str, value: Any, place: tuple[Any, ...], expected: Any) -> None:
    content = yaml.safe_load(CASE.read_text())
    before = yaml.safe_dump(content)
    found: Any = with_value(content, path, value, CASE.parent)
    for part in place:
        found = found[part]
    assert found == expected
    assert yaml.safe_dump(content) == before


@pytest.mark.parametrize("path", ["train.reference.joints.7.cosine", "train.reference.joints.x", "name.below"])
def test_a_path_that_leads_nowhere(path: str) -> None:
    with pytest.raises(InputError):
        with_value(yaml.safe_load(CASE.read_text()), path, 1, CASE.parent)


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (5, 5),
        (0.5, 0.5),
        (True, True),
        ("../a/pd.yaml", "pd"),
        ("didim", "didim"),
        ({"M": 1}, "{M: 1}"),
        (None, "null"),
    ],
)
def test_labels(value: Any, expected: Any) -> None:
    assert labels([value]) == [expected]


LONG = {f"key{k}": k for k in range(20)}


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        (["va/controller.yaml", "vb/controller.yaml"], ["va/controller", "vb/controller"]),
        (["x/va/c.yaml", "y/va/c.yaml", "d.yaml"], ["x/va/c", "y/va/c", "d"]),
        (["low/1", "high/1"], ["low/1", "high/1"]),
        (["a/m.fmu", "a/m.yaml"], ["a/m.fmu", "a/m.yaml"]),
        (["c.yaml", "./c.yaml"], ["c.yaml", "./c"]),
        (["c.yaml", "c.yaml"], ["c", "c"]),
        (["c.yaml", "c"], ["c.yaml", "c"]),
    ],
)
def test_unlike_values_have_unlike_labels(values: list[Any], expected: list[Any]) -> None:
    assert labels(values) == expected


def test_what_begins_alike_is_written_in_full() -> None:
    first, second = labels([LONG, {**LONG, "key19": 0}])
    assert first != second
    assert labels([LONG]) != [first]


def test_labels_are_distinct_over_all_blocks_and_kinds_of_them() -> None:
    vary = [{"list": [{"controller": "va/c.yaml"}, {"controller": "vb/c.yaml"}]}, {"grid": {"a": ["low/1", "high/1"]}}]
    found = {tuple(s.label for s in settings) for settings in plan_of(vary=vary).combinations()}
    assert found == {("va/c", "low/1"), ("va/c", "high/1"), ("vb/c", "low/1"), ("vb/c", "high/1")}


@pytest.mark.parametrize(
    ("vary", "expected"),
    [
        ({"a": [1, 2], "b": [3, 4]}, [(1, 3), (1, 4), (2, 3), (2, 4)]),
        ([{"zip": {"a": [1, 2], "b": [3, 4]}}], [(1, 3), (2, 4)]),
        ([{"list": [{"a": 1, "b": 3}, {"a": 2}]}], [(1, 3), (2,)]),
        ([{"grid": {"a": [1, 2]}}, {"grid": {"b": [3]}}], [(1, 3), (2, 3)]),
        ({"a": {"one": 1, "two": 2}}, [(1,), (2,)]),
        ({"a": range(3)}, [(0,), (1,), (2,)]),
        ({"a": np.array([1.5, 2.5])}, [(1.5,), (2.5,)]),
    ],
)
def test_combinations(vary: Any, expected: list[tuple[Any, ...]]) -> None:
    found = [tuple(s.value for s in settings) for settings in plan_of(vary=vary).combinations()]
    assert found == expected


def test_latin_hypercube_fills_every_slice() -> None:
    ranges = {"loop.delay_s": {"low": 0.0, "high": 1.0}, "low_pass.cutoff_hz": {"low": 1, "high": 100, "scale": "log"}}
    plan = plan_of(vary=[{"latin_hypercube": ranges, "count": 20, "seed": 4}])
    rows = np.array([[s.value for s in settings] for settings in plan.combinations()])
    np.testing.assert_array_equal(np.sort(np.floor(rows[:, 0] * 20)), np.arange(20))
    np.testing.assert_array_equal(np.sort(np.floor(np.log10(rows[:, 1]) / 2 * 20)), np.arange(20))
    again = np.array([[s.value for s in settings] for settings in plan_of(vary=plan.document.vary).combinations()])
    np.testing.assert_array_equal(rows, again)


def ids(**entries: Any) -> set[str]:
    return {run.id for run in plan_of(**entries).runs}


BASE: dict[str, Any] = {"vary": {"controller.source": LAWS[:2], "train.torque.rate_hz": [20, 10]}, "seeds": 3}


@pytest.mark.parametrize(
    ("entries", "common"),
    [
        ({}, 12),
        ({"vary": {"train.torque.rate_hz": [10.0, 20.0], "controller.source": LAWS[:2]}}, 12),
        ({"vary": {**BASE["vary"], "train.torque.rate_hz": [20, 50]}}, 6),
        ({"seeds": [0, 2]}, 8),
        ({"name": "another", "description": "of it", "keep": True, "limits": {"time_s": 9}}, 12),
        ({"noise": {"relative": 0.04}}, 0),
        ({"truth": {"loop": {"delay_samples": 1}}}, 0),
        ({"verb": "discover"}, 0),
    ],
)
def test_a_run_is_what_its_content_is(entries: dict[str, Any], common: int) -> None:
    assert len(ids(**BASE) & ids(**{**BASE, **entries})) == common


def test_equal_runs_are_there_once() -> None:
    plan = plan_of(vary={"train.torque.rate_hz": [10, 10.0, 20]}, seeds=2)
    assert (plan.combination_count, len(plan.runs)) == (6, 4)


def test_files_belong_to_a_run_wherever_they_lie(tmp_path: Path) -> None:
    def run(folder: Path) -> str:
        return Plan(plan_of(case=str(folder / "case.yaml"), noise=None).document, Path()).runs[0].id

    content = yaml.safe_load(scara_case(tmp_path).read_text())
    first = run(tmp_path)
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        own = {**content, "robot": "own.yaml"}
        (tmp_path / name / "case.yaml").write_text(yaml.safe_dump(own))
        shutil.copy(content["robot"], tmp_path / name / "own.yaml")
    assert run(tmp_path / "one") == run(tmp_path / "two") == first
    text = (tmp_path / "two/own.yaml").read_text()
    (tmp_path / "two/own.yaml").write_text(text.replace("Fc: 0.82", "Fc: 0.83"))
    assert run(tmp_path / "two") != first
    (tmp_path / "two/own.yaml").write_text("# a remark\n" + text)
    assert run(tmp_path / "two") == first
    log = tmp_path / "log.csv"
    shutil.copy(content["train"]["torque"]["file"], log)
    content["train"]["torque"]["file"] = str(log)
    (tmp_path / "case.yaml").write_text(yaml.safe_dump(content))
    assert run(tmp_path) == first
    log.write_text(log.read_text() + "\n")
    assert run(tmp_path) != first


def test_another_code_is_another_run(monkeypatch: pytest.MonkeyPatch) -> None:
    before = plan_of(**BASE)
    designs = {run.data for run in before.runs}
    monkeypatch.setattr("fmu_didim.campaigns.planning.plan.code_digest", lambda: "another")
    after = plan_of(**BASE)
    assert not {run.id for run in before.runs} & {run.id for run in after.runs}
    assert {run.data for run in after.runs} == designs  # the noise is the same: versions can be compared


def test_what_is_believed_changes_no_data() -> None:
    """Controllers that a case mis-states, starts and estimators see the data of one machine with the same noise."""
    vary = {"controller.source": LAWS, "estimator.start": ["reference", "torque"]}
    believed = plan_of(vary=vary, truth={"controller": {"source": LAWS[0]}}, seeds=2)
    assert len(believed.runs) == 16
    assert len({run.data for run in believed.runs}) == 2
    real = plan_of(vary=vary, seeds=2)
    assert len({run.data for run in real.runs}) == 8


def test_truth_begins_with_the_case() -> None:
    plan = plan_of(vary={"truth.robot.joints.0.parameters.Fv": [5.0]}, truth={"loop": {"delay_samples": 2}})
    content = plan.content(plan.runs[0].settings)
    assert content.truth is not None
    assert content.truth["robot"]["joints"][0]["parameters"]["Fv"] == 5.0
    assert content.truth["loop"] == {"delay_samples": 2}
    assert "loop" not in content.case
    assert content.case["robot"] == "../../fmus/scara/robot.yaml"


def test_code_outside_the_tree_is_a_file_of_the_run(tmp_path: Path) -> None:
    own = tmp_path / "own.py"
    own.write_text("controller = 1\n")
    first = identity.References().canonical({"source": "own.py:controller"}, tmp_path)
    own.write_text("controller = 2\n")
    assert identity.References().canonical({"source": "own.py:controller"}, tmp_path) != first
    assert identity.References().canonical("fmu_didim.data.units:pretty", tmp_path)[1] == identity.file_digest(
        identity.PACKAGE / "data" / "units.py"
    )


def test_what_code_outside_the_tree_imports_belongs_to_the_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "case").mkdir()
    (tmp_path / "laws").mkdir()
    (tmp_path / "case/own.py").write_text("import numpy\nfrom laws.pd import make\ncontroller = make()\n")
    (tmp_path / "laws/__init__.py").write_text("")
    (tmp_path / "laws/pd.py").write_text("from .gains import GAIN\n")
    (tmp_path / "laws/gains.py").write_text("GAIN = 1\n")
    monkeypatch.syspath_prepend(tmp_path)

    def named() -> Any:
        return identity.References().canonical({"source": "own.py:controller"}, tmp_path / "case")

    first = named()
    assert [path.name for path in identity.imported(tmp_path / "case/own.py")] == ["__init__.py", "gains.py", "pd.py"]
    (tmp_path / "laws/gains.py").write_text("GAIN = 2\n")
    assert named() != first
    (tmp_path / "case/own.py").write_text("import laws.pd =\n")
    assert len(named()["source"]) == 2, "its own content alone, where it cannot be read"


def test_whole_cases_that_vary() -> None:
    """Measured logs: as many data as cases, whatever is changed in the way they are used."""
    cases = [str(CASE.with_name(name)) for name in ("identify.yaml", "identify_200hz.yaml")]
    plan = plan_of(case=None, noise=None, vary={"case": cases, "estimator.start": ["torque", "reference"]})
    assert len(plan.runs) == 4
    assert len({run.data for run in plan.runs}) == 2
    names = [plan.content(run.settings).case["name"] for run in plan.runs]
    assert names == ["SCARA, torque at 10 Hz"] * 2 + ["SCARA, torque at 200 Hz"] * 2
    assert [run.labels["case"] for run in plan.runs] == ["identify"] * 2 + ["identify_200hz"] * 2
