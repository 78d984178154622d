"""Campaigns of a robot whose case gives what was measured beside the torque: it is simulated with noise of its own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from fmu_didim.base.errors import InputError
from fmu_didim.campaigns.planning.document import CampaignDocument
from fmu_didim.campaigns.planning.plan import Plan
from fmu_didim.campaigns.planning.truth import noisy_logs, simulated_truth, with_simulated_logs
from fmu_didim.case import load_case
from fmu_didim.data.signals import trajectory, write_csv
from tests.campaigns.helpers import CASE


def measured_case(folder: Path, **measured: Any) -> Path:
    """The SCARA with an encoder's log beside its torque; only the instants of that file count in a simulation."""
    times = np.arange(0.0, 3.9, 0.013)
    write_csv(trajectory(times, {"q1": 0 * times, "dq2": 0 * times}), folder / "encoder.csv")
    content = yaml.safe_load(CASE.read_text())
    content = {key: value for key, value in content.items() if key != "validation"}
    for name in ("robot", "controller"):
        source = content[name] if isinstance(content[name], str) else content[name]["source"]
        path = str((CASE.parent / source).resolve())
        content[name] = path if isinstance(content[name], str) else {**content[name], "source": path}
    content["train"]["reference"]["duration_s"] = 4.0
    content["train"]["measured"] = {"file": "encoder.csv", **measured}
    (folder / "case.yaml").write_text(yaml.safe_dump(content))
    return folder / "case.yaml"


def test_what_is_measured_beside_the_torque_is_simulated_too(tmp_path: Path) -> None:
    path = measured_case(tmp_path, signals=["q1", "dq2"], std={"dq2": 1e-3})
    noise = {"relative": 0.02, "position_std": 1e-4}
    plan = Plan(CampaignDocument.model_validate({"name": "test", "case": str(path), "noise": noise}), Path())
    content = plan.content(())
    assert content.truth is not None
    truth = simulated_truth(content.truth, Path(content.folder))
    outputs = {one.name: one for one in truth.outputs["estimation"]}
    logs = noisy_logs(truth, content.noise, "0" * 16)
    for name, size in {"q1": 1e-4, "dq2": 1e-3}.items():
        added = logs[f"measured_estimation_{name}.csv"].values[:, 0] - outputs[name].values
        assert added.std() == pytest.approx(size, rel=0.15)
    assert np.ptp(outputs["q1"].values) > 0.1
    torque = logs["torque_estimation.csv"].values - truth.logs["estimation"].torque
    q1 = logs["measured_estimation_q1.csv"].values[:, 0] - outputs["q1"].values
    shared = min(q1.size, torque.shape[0])
    assert abs(np.corrcoef(q1[:shared], torque[:shared, 0])[0, 1]) < 0.3  # noise of its own
    case = load_case(with_simulated_logs(content.case, truth.outputs), folder=Path(content.folder), signals=logs)
    assert case.model.experiments.channels == ("q1", "dq2")
    found = case.estimator.estimate(case.model)
    right = np.array([truth.values[name][0] for name in found.names])
    assert (np.abs(found.value - right) < 4 * found.standard_deviation).all()


def test_a_signal_without_stated_noise_is_no_position(tmp_path: Path) -> None:
    path = measured_case(tmp_path, signals=["dq2"])
    plan = Plan(
        CampaignDocument.model_validate({"name": "test", "case": str(path), "noise": {"relative": 0.02}}), Path()
    )
    content = plan.content(())
    assert content.truth is not None
    truth = simulated_truth(content.truth, Path(content.folder))
    with pytest.raises(InputError, match=r"how much noise[\s\S]*std: \{dq2"):
        noisy_logs(truth, content.noise, "0" * 16)
