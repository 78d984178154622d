"""The regressor measured on the running plant against the analytic one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from fmu_didim import identify
from fmu_didim.base.errors import InputError
from fmu_didim.model.prediction import predict
from tests.cases import ENTRIES, TRUTH, plant_case
from tests.helpers import NEAR, model_of


def probed_case(folder: Path, entries: dict[str, Any], kind: str = "fmu") -> Path:
    path = plant_case(folder, entries)
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    content["estimator"] = {"kind": "didim"}
    if kind != "fmu":
        content["plant"] = {"kind": kind, "source": str(Path("fmus/scara/robot.yaml").resolve())}
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return path


@pytest.mark.gate
@pytest.mark.parametrize("kind", ["fmu", "model", pytest.param("control", marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    "delay", [pytest.param(0.0, marks=pytest.mark.slow), 0.5, pytest.param(2.0, marks=pytest.mark.slow)]
)
def test_probed_regressor_is_the_analytic_one(tmp_path: Path, kind: str, delay: float) -> None:
    analytic = predict(model_of("examples/scara/identify.yaml").with_delay(delay), TRUTH)
    probed = predict(model_of(probed_case(tmp_path, ENTRIES, kind)).with_delay(delay), TRUTH)
    assert analytic.regressor is not None
    assert probed.regressor is not None
    assert probed.known is not None
    for i in range(TRUTH.size):
        size = np.linalg.norm(analytic.regressor[:, :, i])
        assert np.linalg.norm(probed.regressor[:, :, i] - analytic.regressor[:, :, i]) <= 1e-6 * size
    np.testing.assert_allclose(probed.torque, analytic.torque, rtol=0, atol=1e-9)
    np.testing.assert_allclose(probed.known, 0, atol=1e-6 * np.abs(probed.torque).max())


@pytest.mark.gate
def test_didim_with_a_probed_regressor_gives_the_same_answer(tmp_path: Path) -> None:
    outcome = identify(probed_case(tmp_path, ENTRIES))
    expected = identify("examples/scara/identify.yaml").estimate
    assert outcome.document.status == "converged"
    # Each is integrated as finely as a hundredth of the noise asks.
    assert (np.abs(outcome.estimate.value - expected.value) <= NEAR * expected.standard_deviation).all()
    np.testing.assert_allclose(outcome.estimate.standard_deviation, expected.standard_deviation, rtol=1e-3)


@pytest.mark.gate
def test_parameters_left_out_keep_their_values_and_torque(tmp_path: Path) -> None:
    entries = {name: entry for name, entry in ENTRIES.items() if name not in ("Fv1", "MY2")}
    outcome = identify(probed_case(tmp_path, entries))
    truth = TRUTH[[0, 2, 3, 4, 6, 7]]
    assert (np.abs(outcome.estimate.value - truth) <= 3.5 * outcome.estimate.standard_deviation).all()


def test_nonlinear_parameter_is_refused_by_didim(tmp_path: Path) -> None:
    path = probed_case(tmp_path, {"Fc1": {"start": 0.7}, "v0_1": {"start": 0.03}})
    with pytest.raises(InputError, match=r"do not enter the torque linearly(.|\n)*v0_1(.|\n)*clie"):
        identify(path)
