"""Campaigns over a case of a model: fields of its entries vary, outputs are simulated with true values and noise."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmu_didim import Measured
from fmu_didim.base.errors import InputError
from fmu_didim.campaigns.campaign import study
from fmu_didim.campaigns.planning.document import CampaignDocument
from fmu_didim.campaigns.planning.fields import plain
from fmu_didim.campaigns.planning.plan import Plan
from fmu_didim.campaigns.planning.recorded import with_simulated_outputs, written_out
from fmu_didim.campaigns.planning.truth import noisy_logs, simulated_truth, with_simulated_logs
from fmu_didim.campaigns.reporting.page import write_campaign_report
from fmu_didim.campaigns.running.single_run import write_single_run
from fmu_didim.case import load_case
from fmu_didim.case.in_memory import Memory
from tests.conftest import ROOT

CASE = ROOT / "examples/house/identify.yaml"
TRUTH = {"model": {"parameters": {"R1": 0.02, "R2": 0.01}}}


def plan_of(**entries: Any) -> Plan:
    return Plan(CampaignDocument.model_validate({"name": "test", "case": str(CASE), **entries}), Path())


def test_short_forms_are_written_out_so_that_paths_go_on_in_them() -> None:
    content = written_out({
        "model": "a.fmu", "inputs": "u.csv", "measured": ["y.csv", {"file": "z.csv"}],
        "validation": {"measured": "w.csv"}, "experiments": {"a": {"inputs": "v.csv"}},
    })  # fmt: skip
    assert content["model"] == {"source": "a.fmu"} and content["inputs"] == {"file": "u.csv"}
    assert content["measured"] == [{"file": "y.csv"}, {"file": "z.csv"}]
    assert content["validation"] == {"measured": {"file": "w.csv"}}
    assert content["experiments"] == {"a": {"inputs": {"file": "v.csv"}}}
    assert written_out({"robot": "a.yaml", "train": {"measured": "x.csv"}})["train"] == {"measured": "x.csv"}


def test_every_field_of_a_model_makes_another_run() -> None:
    plan = plan_of(
        vary={
            "model.parameters.C": [3e6, 4e6], "train.inputs.interpolation": ["linear", "held"],
            "identify.R1.start": [0.01, 0.05],
        }
    )  # fmt: skip
    assert plan.quantity == "output" and len({run.id for run in plan.runs}) == 8
    assert len({run.data for run in plan.runs}) == 2  # the way between rows belongs to the data


def test_data_of_a_model_have_its_true_values_and_the_noise_that_is_asked_for() -> None:
    plan = plan_of(truth=TRUTH, noise={"std": [0.1]}, seeds=2)
    content = plan.content(())
    assert content.truth is not None
    truth = simulated_truth(content.truth, Path(content.folder))
    assert {name: value for name, (value, _) in truth.values.items()} == {"R1": 0.02, "R2": 0.01}
    logs = noisy_logs(truth, content.noise, plan.runs[0].data)
    still = noisy_logs(truth, {}, plan.runs[0].data)
    noise = {name: logs[name].values - still[name].values for name in logs}
    assert set(noise) == {"measured_estimation_T.csv", "measured_validation_T.csv"}
    assert all(0.09 < np.std(values) < 0.11 for values in noise.values())
    case = load_case(with_simulated_logs(content.case, truth.outputs), folder=content.folder, signals=still)
    at_truth = case.model.torque(np.array([0.02, 0.01]))
    assert case.model.measured == pytest.approx(at_truth, abs=1e-9)
    assert case.with_signals(logs).model.measured != pytest.approx(at_truth, abs=1e-3)
    with pytest.raises(InputError, match="one value for each output"):
        noisy_logs(truth, {"std": [0.1, 0.2]}, plan.runs[0].data)
    relative = noisy_logs(truth, {"relative": 0.5}, plan.runs[0].data)["measured_estimation_T.csv"]
    size = np.std(still["measured_estimation_T.csv"].values)
    assert np.std(relative.values - still["measured_estimation_T.csv"].values) == pytest.approx(size / 2, rel=0.1)


def test_one_run_is_written_with_its_own_data(tmp_path: Path) -> None:
    plan = plan_of(truth=TRUTH, noise={"std": [0.1]}, seeds=2)
    written = load_case(write_single_run(plan, plan.runs[1], tmp_path))
    content = plan.content(())
    truth = simulated_truth(content.truth or {}, Path(content.folder))
    drawn = noisy_logs(truth, content.noise, plan.runs[1].data)["measured_estimation_T.csv"]
    assert written.model.measured == pytest.approx(drawn.values, abs=1e-12)


def test_outputs_at_instants_of_their_own_are_simulated_there(tmp_path: Path) -> None:
    rows = np.loadtxt(CASE.parent / "room.csv", delimiter=",", skiprows=1)[5:800:3]
    np.savetxt(tmp_path / "x.csv", rows + np.array([30.0, 0.0]), delimiter=",", header="t,x", comments="")
    files = [str(CASE.parent / "room.csv"), {"file": str(tmp_path / "x.csv"), "columns": {"x": "x"}}]
    content = {
        "name": "two", "model": str(CASE.parent / "house.fmu"), "inputs": str(CASE.parent / "weather.csv"),
        "measured": files, "identify": {"R1": None}, **TRUTH,
    } | {"model": {"source": str(CASE.parent / "house.fmu"), **TRUTH["model"]}}  # fmt: skip
    still = noisy_logs(simulated_truth(content, tmp_path), {}, "0")
    room, inner = (still[f"measured_estimation_{name}.csv"] for name in ("T", "x"))
    assert inner.time == pytest.approx(rows[:, 0] + 30)
    assert inner.values[:, 0] == pytest.approx(np.interp(inner.time, room.time, room.values[:, 0]), abs=0.01)


def test_what_a_case_says_of_the_noise_stays() -> None:
    content = written_out({"model": "a.fmu", "measured": {"file": "y.csv", "columns": {"y": {"unit": "K", "std": 0.1}},
                                                          "std": {"z": 2.0}}})  # fmt: skip
    made = with_simulated_outputs(content, {"estimation": ["y", "z", "w"]})["measured"]
    assert [file.get("std") for file in made] == [{"y": 0.1}, {"z": 2.0}, None]


def test_arrays_in_memory_are_refused() -> None:
    with pytest.raises(InputError, match="cannot take an object in memory"):
        plain({"measured": Measured([0, 1], y=[1, 2])}, Memory())


@pytest.mark.gate
def test_a_campaign_reports_without_words_of_robots(tmp_path: Path) -> None:
    made = study(
        CASE, out=tmp_path, truth=TRUTH, noise={"std": [0.1]}, seeds=3, vary={"identify.R1.start": [0.01, 0.05]}
    )
    results = made.run()
    frame = results.by_parameter()
    assert len(results.to_frame(parameters=False)) == 6 and (np.abs(frame["bias_in_sigma"]) < 3).all()
    page = write_campaign_report(results)[0].read_text(encoding="utf-8").lower()
    assert "output error %" in page
    assert not [word for word in ("torque", "joint", "gear") if word in page]
