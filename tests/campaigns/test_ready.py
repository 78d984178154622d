"""The ready campaigns of examples/campaigns: all of their cases have the right form, and a part of each runs."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import jsonschema
import pandas as pd
import pytest

from fmu_didim.base.documents import load_yaml
from fmu_didim.campaigns.campaign import campaign
from fmu_didim.campaigns.planning.document import CampaignDocument
from fmu_didim.campaigns.reporting.results import Results
from fmu_didim.campaigns.validation import case_problems, read_campaign
from fmu_didim.case.files import DATA_VARIABLE
from tests.conftest import EMPS_FILES, needs_emps
from tests.helpers import ROOT

FOLDER = ROOT / "examples/campaigns"


def part_of(name: str, out: Path, vary: Any, seeds: int | None = None) -> Results:
    """Run a ready campaign with fewer values."""
    content = load_yaml(FOLDER / f"{name}.yaml") | {"vary": vary}
    if seeds is not None:
        content["seeds"] = seeds
    return campaign(content, out, folder=FOLDER).run(workers=2)


def vary_of(name: str) -> Any:
    return load_yaml(FOLDER / f"{name}.yaml")["vary"]


@pytest.fixture
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A data folder whose files are empty: what the form of a campaign takes from them is that they are there."""
    (tmp_path / "emps").mkdir()
    for name in EMPS_FILES:
        (tmp_path / "emps" / name).touch()
    monkeypatch.setenv(DATA_VARIABLE, str(tmp_path))
    return tmp_path


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.yaml")), ids=lambda path: path.stem)
def test_form(path: Path, data: Path) -> None:
    plan, found = read_campaign(load_yaml(path), FOLDER)
    assert plan is not None
    assert found + case_problems(plan, None)[0] == []
    jsonschema.validate(load_yaml(path), CampaignDocument.model_json_schema())


def test_data_that_are_not_shipped_are_told(data: Path) -> None:
    """Each file once, with what to do, and nothing else."""
    content = load_yaml(FOLDER / "emps.yaml")
    plan, found = read_campaign(content, FOLDER)
    assert plan is not None
    for name in EMPS_FILES:
        (data / "emps" / name).unlink()
    told = found + case_problems(plan, None)[0]
    assert len(told) == len(EMPS_FILES)
    for text, name in zip(told, EMPS_FILES, strict=True):
        assert re.search(rf"the file .*{name} does not exist\. Set {DATA_VARIABLE} to .*nonlinearbenchmark\.org", text)


@pytest.mark.slow
def test_robustness(tmp_path: Path) -> None:
    """From a start far away and at a tenth of the paper's noise: the right answer, or none."""
    vary = vary_of("scara_robustness") | {"train.torque.rate_hz": [10], "noise.relative": [0.05]}
    results = part_of("scara_robustness", tmp_path / "run", vary, 1)
    runs = results.to_frame()
    assert set(runs["verdict"]) <= {"valid", "doubtful"}
    far = runs[runs["verdict"] == "valid"]
    assert (far["ZZ1R"] - 3.43).abs().max() < 0.1


@pytest.mark.slow
def test_a_mis_stated_controller_is_seen_in_bias_and_verdict(tmp_path: Path) -> None:
    """What biases the answer never leaves it valid; all see the same data, which is told."""
    results = part_of("controller_swap", tmp_path / "run", vary_of("controller_swap"), 2)
    summary = results.groups().set_index("label.stated")
    assert summary.loc["the right one", ["valid", "data"]].tolist() == [2, 2]
    assert summary.loc["the right one", "largest_bias_in_sigma"] < 4
    assert summary.loc["Kp 5 % low", "largest_bias_in_sigma"] < 4  # the loop tracks, whatever its gain
    wrong = summary[summary["largest_bias_in_sigma"] > 3]
    assert {"one sample late", "PID"} <= set(wrong.index)
    assert (wrong["valid"] == 0).all(), summary.to_string()
    assert any("14 runs are on 2 different data" in remark for remark in results.remarks())


@pytest.mark.slow
@needs_emps
def test_emps(tmp_path: Path) -> None:
    vary = [vary_of("emps")[0], {"grid": {"loop.delay_samples": [0]}}]
    results = part_of("emps", tmp_path / "run", vary)
    table = results.by_parameter("train.torque.rate_hz")
    mass = table[table["parameter"] == "M"].set_index("train.torque.rate_hz")
    assert mass["bias"].isna().all()
    assert (mass["value"] - 95.1).abs().max() < 3
    assert mass.loc[4, "stated"] > mass.loc[1000, "stated"]


@pytest.mark.gate
def test_estimators_see_the_same_logs(tmp_path: Path) -> None:
    results = part_of("scara_estimators", tmp_path / "run", vary_of("scara_estimators"), 2)
    frame = results.to_frame()
    assert set(frame["verdict"]) <= {"valid", "doubtful"} and frame["label.estimator"].nunique() == 6
    table = results.by_parameter().pivot(index="parameter", columns="label.estimator", values="stated")
    assert table.shape == (8, 6) and table.notna().to_numpy().all()
    assert (table["IDIM-WLS"] < table["IDIM-LS"]).sum() >= 6  # joints weighted: smaller deviations
    assert (results.groups()["largest_bias_in_sigma"] < 4).all()


@pytest.mark.slow
def test_estimators_of_six_joints(tmp_path: Path) -> None:
    results = part_of("tx40_estimators", tmp_path / "run", vary_of("tx40_estimators"), 1)
    assert results.status().failures == dict.fromkeys(results.status().failures, 0)
    assert set(results.to_frame()["verdict"]) <= {"valid", "doubtful"}
    table = results.by_parameter().pivot(index="parameter", columns="label.estimator", values="stated")
    assert table.notna().to_numpy().all()


@pytest.mark.slow
def test_hidden_effects_are_named(tmp_path: Path) -> None:
    results = part_of(
        "arm2r_hidden", tmp_path / "run", [vary_of("arm2r_hidden")[0], {"grid": {"train.torque.rate_hz": [100]}}], 1
    )
    found: pd.DataFrame = results.confusion()
    assert found.loc["nothing", "nothing"] == 1
    assert found.loc["stribeck@1", "stribeck@1"] == 1
    assert found.to_numpy().sum() == 6
    assert (results.folder / "campaign.json").is_file()


@pytest.mark.gate
def test_the_intervals_of_a_model_hold(tmp_path: Path) -> None:
    """Of both starts alike, and with five times the noise, five times as wide."""
    vary = vary_of("house") | {"noise.std": {"0.1 K": [0.1], "0.5 K": [0.5]}}
    found = part_of("house", tmp_path, vary, 4).by_parameter()
    assert (found["used"] == 4).all() and (found["bias_in_sigma"].abs() < 3).all()
    stated = found.set_index(["identify.R1.start", "noise.std", "parameter"])["stated"].unstack("noise.std")
    assert stated["0.5 K"].to_numpy() == pytest.approx(5 * stated["0.1 K"].to_numpy(), rel=0.3)
