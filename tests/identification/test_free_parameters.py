"""Values of an experiment's own, and parameters beside the plant: what data without noise give back exactly."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from fmu_didim import identify
from fmu_didim.data.signals import trajectory, write_csv
from fmu_didim.fit.derivatives.sensitivity import sensitivity
from fmu_didim.report import result_table
from tests.cases import scara_case
from tests.helpers import model_of


def case_with(folder: Path, *, own: tuple[str, ...] = (), **identified: dict[str, Any]) -> Path:
    """The SCARA with two experiments for the estimation, of which the second has some values of its own, and one that
    is held out."""
    path = scara_case(folder)
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    first, second = content.pop("train"), content.pop("validation")
    content["experiments"] = {
        "held": {**second, "role": "validation"}, "first": first, "second": {**second, "own": list(own)},
    }  # fmt: skip
    if identified:
        content["identify"] = identified
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return path


def with_data(path: Path, truth: dict[str, float]) -> np.ndarray:
    """Gives a case torque logs of its own loop with these values, all others as they stand; returns all values."""
    model = model_of(path)
    values = model.start
    for name, value in truth.items():
        values[model.names.index(name)] = value
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    for label, experiment in model.experiments.items():
        torque = model.torque(values, label)
        file = path.parent / f"{label}.csv"
        write_csv(trajectory(experiment.time, {f"tau{j + 1}": torque[:, j] for j in range(2)}), file)
        content["experiments"][label]["torque"] = {"file": file.name}
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return values


def test_experiments_are_stacked_in_their_order(tmp_path: Path) -> None:
    model = model_of(case_with(tmp_path, own=("Fv1",)))
    assert list(model.experiments) == ["first", "second", "held"]
    assert (model.estimation_labels, model.experiments.validation_labels) == (("first", "second"), ("held",))
    assert model.names[-2:] == ("Fc2", "Fv1[second]")
    assert model.linear_count == 9
    assert model.measured.shape == (200, 2)
    values = model.start + 0.01
    values[-1] = 0.7
    np.testing.assert_array_equal(
        model.torque(values)[model.experiments.rows["second"]], model.torque(values, "second")
    )
    assert model.theta(values, "second")[1] == 0.7
    assert model.theta(values, "first")[1] == model.theta(values, "held")[1] == values[1]


@pytest.mark.gate
def test_a_value_of_its_own_is_found(tmp_path: Path) -> None:
    path = case_with(tmp_path, own=("Fv1", "MX2"))
    truth = with_data(path, {"Fv1[second]": 1.5, "MX2[second]": 0.3})
    outcome = identify(path)
    np.testing.assert_allclose(outcome.estimate.value, truth, rtol=1e-6)
    assert outcome.document.experiments["second"].own == ["Fv1[second]", "MX2[second]"]
    # It is carried by the same parameter of the plant, and is none of the loop.
    assert outcome.document.parameters["MX2[second]"].standard == "MX2"
    lines = result_table(outcome.document).splitlines()
    assert not any(line.startswith("MX2[second] =") for line in lines)


@pytest.mark.gate
@pytest.mark.parametrize(
    ("entry", "value"),
    [
        ({"of": "controller", "parameter": "Kd2", "start": 3.0}, 5.0),
        ({"of": "drive", "joint": 2}, 1.15),
        ({"of": "delay"}, 0.4),
        ({"of": "log"}, 0.007),
    ],
    ids=["gain of the controller", "gain of a drive", "delay", "clock of the log"],
)
def test_a_parameter_beside_the_plant_is_found(tmp_path: Path, entry: dict[str, Any], value: float) -> None:
    path = case_with(tmp_path, beside=entry)
    truth = with_data(path, {"beside": value})
    outcome = identify(path)
    assert outcome.document.status == "converged"
    np.testing.assert_allclose(outcome.estimate.value, truth, rtol=1e-6)
    assert outcome.document.parameters["beside"].standard == ""
    assert all(e.relative_error_percent.total < 1e-4 for e in outcome.document.experiments.values())  # type: ignore[operator]


def test_what_acts_in_one_experiment_alone_has_no_slope_elsewhere(tmp_path: Path) -> None:
    model = model_of(case_with(tmp_path, own=("Fv1", "late"), late={"of": "log"}))
    assert model.names[-3:] == ("Fv1[second]", "late", "late[second]")
    slopes = sensitivity(model, model.start, model.torque(model.start))
    first, second = (slopes[model.experiments.rows[label]] for label in ("first", "second"))
    for name in ("Fv1", "late"):
        shared, own = model.names.index(name), model.names.index(f"{name}[second]")
        assert np.abs(first[:, :, shared]).max() > 0
        assert not first[:, :, own].any()
        assert not second[:, :, shared].any()
        assert np.abs(second[:, :, own]).max() > 0
