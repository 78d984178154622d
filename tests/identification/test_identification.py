"""DIDIM on the paper's robot: starts, statistics, guards."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fmu_didim.base.errors import InputError, UnknownNameError
from fmu_didim.case import Case, load_case
from fmu_didim.components import ModelComponent
from fmu_didim.controllers import read_controller
from fmu_didim.data.filters import LowPass
from fmu_didim.estimators import Didim
from fmu_didim.fit.derivatives.sensitivity import sensitivity
from fmu_didim.fit.estimate import Estimate, RefusedError, Status
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.prediction import predict
from tests.helpers import NEAR, with_component, with_torque

PAPER_TABLE_1 = {
    "ZZ1R": 3.43, "Fv1": 0.03, "Fc1": 0.82, "ZZ2": 0.063, "MX2": 0.241, "MY2": 0.014, "Fv2": 0.013, "Fc2": 0.137,
}  # fmt: skip
TRUTH = np.array(list(PAPER_TABLE_1.values()))


def start_divided_by(factor: float) -> dict[str, float]:
    """Inertias divided by a factor, all else zero."""
    return {"ZZ1R": 3.43 / factor, "ZZ2": 0.063 / factor}


@pytest.fixture(scope="module")
def cases() -> dict[int, Case]:
    return {
        200: load_case("examples/scara/identify_200hz.yaml"),
        10: load_case("examples/scara/identify.yaml"),
    }


def model_at(cases: dict[int, Case], rate: int) -> LoopModel:
    model = cases[rate].model
    assert model is not None
    return model


@pytest.mark.gate
@pytest.mark.parametrize("rate", [200, 10])
@pytest.mark.parametrize(
    ("start", "most"),
    [(PAPER_TABLE_1, 2), (start_divided_by(100), 5), (start_divided_by(1000), 6), ("reference", 5)],
    ids=["truth", "a hundredth", "a thousandth", "reference"],
)
def test_paper_starts(cases: dict[int, Case], rate: int, start: object, most: int) -> None:
    """Tables 1, 2 and 3: iterations, and every parameter within 3 sigma of the truth."""
    estimate = Didim(start=start).estimate(model_at(cases, rate))
    assert estimate.status is Status.CONVERGED
    assert estimate.iteration_count <= (most if rate == 200 or start == PAPER_TABLE_1 else 5)
    assert (np.abs(estimate.value - TRUTH) <= 3 * estimate.standard_deviation).all()
    didim = estimate.stages["didim"]
    assert (np.abs(didim.value - TRUTH) <= 3 * didim.standard_deviation).all()
    error = 100 * np.linalg.norm(estimate.residual) / np.linalg.norm(estimate.measured)
    assert 4.5 < error < 5.5


@pytest.mark.parametrize("rate", [200, 10])
def test_noise_free_data_give_the_parameters(cases: dict[int, Case], rate: int) -> None:
    model = model_at(cases, rate)
    estimate = Didim(start=start_divided_by(100)).estimate(with_torque(model, model.torque(TRUTH)))
    assert estimate.status is Status.CONVERGED
    np.testing.assert_allclose(estimate.value, TRUTH, rtol=1e-6)


@pytest.mark.gate
@pytest.mark.parametrize("rate", [200, 10])
def test_noise_free_data_of_another_simulator(cases: dict[int, Case], rate: int) -> None:
    """Torque of the example's own generator (DOP853, equations by hand) before noise: only the integration differs."""
    import runpy

    import yaml

    maker = runpy.run_path("examples/scara/make_data.py")
    content = Path("examples/scara/identify.yaml").read_text(encoding="utf-8")
    series = yaml.safe_load(content)["train"]["reference"]
    torque = maker["closed_loop"](series)[1][:: 200 // rate]
    model = model_at(cases, rate)
    estimate = Didim(start="reference").estimate(with_torque(model, torque))
    np.testing.assert_allclose(estimate.value, TRUTH, rtol=1e-6)


def test_torque_is_regressor_times_parameters(cases: dict[int, Case]) -> None:
    model = model_at(cases, 10)
    for delay in (0.0, 0.5, 1.0):
        prediction = predict(model.with_delay(delay), TRUTH)
        rebuilt = prediction.regressor @ TRUTH + prediction.known
        np.testing.assert_allclose(rebuilt, prediction.torque, rtol=0, atol=1e-12 * np.abs(prediction.torque).max())


def test_sensitivity_agrees_with_central_differences(cases: dict[int, Case]) -> None:
    model = model_at(cases, 10)
    prediction = predict(model, TRUTH)
    found = sensitivity(model, TRUTH, prediction.torque)
    for i in range(TRUTH.size):
        step = np.zeros(TRUTH.size)
        step[i] = 1e-4 * np.linalg.norm(prediction.torque) / np.linalg.norm(prediction.regressor[:, :, i])
        central = (model.torque(TRUTH + step) - model.torque(TRUTH - step)) / (2 * step[i])
        size = np.linalg.norm(central)
        assert np.linalg.norm(found[:, :, i] - central) <= 1e-5 * size


@pytest.mark.slow
def test_loose_tracking_needs_the_corrected_deviation(cases: dict[int, Case]) -> None:
    """With weak gains W is not the sensitivity: eq. (8) claims too little, the corrected formula does not."""
    model = model_at(cases, 200)
    soft = ModelComponent(read_controller("controllers/scara_pd.yaml")).with_parameters(
        {"Kp1": 150.0, "Kd1": 40.0, "Kp2": 3.0, "Kd2": 0.8}
    )
    loose = with_component(model, "controller", soft)
    torque = loose.torque(TRUTH)
    noise = 0.05 * np.sqrt((torque**2).mean(axis=0))
    values, corrected, paper = [], [], []
    for seed in range(30):
        measured = torque + noise * np.random.default_rng(seed).normal(size=torque.shape)
        estimate = Didim(tolerance=1e-3, finish=False).estimate(with_torque(loose, measured))
        values.append(estimate.value)
        corrected.append(estimate.standard_deviation)
        paper.append(estimate.stages["didim"].formulas["paper"])
    empirical = np.std(values, axis=0, ddof=1)
    ratio_corrected = np.mean(corrected, axis=0) / empirical
    assert (np.mean(paper, axis=0) / np.mean(corrected, axis=0)).min() < 0.87
    assert (np.abs(np.log(ratio_corrected)) < 0.35).all()  # the standard deviation of 30 draws is known to 13 %


def test_known_noise_and_equal_weights_are_used(cases: dict[int, Case]) -> None:
    model = model_at(cases, 10)
    free = Didim().estimate(model)
    known = Didim().estimate(replace(model, torque_deviation=10 * free.noise))
    assert (np.abs(known.value - free.value) <= NEAR * free.standard_deviation).all()
    np.testing.assert_allclose(known.standard_deviation, 10 * free.standard_deviation, rtol=1e-3)
    equal = Didim().estimate(replace(model, joint_weights="equal"))
    # The second joint, ten times weaker, then counts for less.
    assert equal.standard_deviation[4] > 1.5 * free.standard_deviation[4]


def test_low_pass_filters_torque_and_regressor_alike(cases: dict[int, Case]) -> None:
    model = model_at(cases, 200).with_low_pass(LowPass(cutoff_hz=4.0))
    prediction = predict(model, TRUTH)
    rebuilt = prediction.regressor @ TRUTH + prediction.known
    np.testing.assert_allclose(rebuilt, prediction.torque, rtol=0, atol=1e-9)
    estimate = Didim().estimate(model)
    error = 100 * np.linalg.norm(estimate.residual) / np.linalg.norm(estimate.measured)
    assert error < 2.0  # most of the white noise is gone
    assert (np.abs(estimate.value - TRUTH) <= 0.15 * np.abs(TRUTH) + 0.03).all()
    # Filtered samples hang together: they tell no more than the samples did, though the residual is a fifth.
    unfiltered = Didim().estimate(model_at(cases, 200))
    assert (estimate.noise < 0.3 * unfiltered.noise).all()
    ratio = estimate.standard_deviation / unfiltered.standard_deviation
    assert ratio.min() > 0.97 and ratio.max() < 1.3
    assert estimate.freedom < 0.1 * unfiltered.freedom
    with pytest.raises(InputError, match="below half the torque rate"):
        Didim().estimate(model_at(cases, 10).with_low_pass(LowPass(cutoff_hz=40.0)))


def test_delay_is_estimated(cases: dict[int, Case]) -> None:
    model = model_at(cases, 200)
    torque = model.with_delay(0.4).torque(TRUTH)
    noise = 0.02 * np.sqrt((torque**2).mean(axis=0)) * np.random.default_rng(5).normal(size=torque.shape)
    estimate = Didim(estimate_delay=True).estimate(with_torque(model, torque + noise))
    assert estimate.names[-1] == "delay"
    assert abs(estimate.value[-1] - 0.4) <= 3 * estimate.standard_deviation[-1]
    assert (np.abs(estimate.base_value - TRUTH) <= 3.5 * estimate.standard_deviation[:-1]).all()


def test_diverging_start_is_recovered_and_named(cases: dict[int, Case]) -> None:
    estimate = Didim(start=start_divided_by(100)).estimate(model_at(cases, 200))
    first = estimate.iterations[0]
    assert np.isnan(first.relative_error_percent)
    assert "diverged" in first.note
    assert "restarted from the motion that the measured torque implies" in first.note
    assert estimate.remarks[0].startswith("Started from the motion that the measured torque implies; not from the val")


def test_start_with_impossible_inertia_is_recovered_and_named(cases: dict[int, Case]) -> None:
    estimate = Didim(start={"ZZ1R": -1.0, "ZZ2": 0.06}).estimate(model_at(cases, 10))
    assert "not positive definite" in estimate.iterations[0].note
    assert (np.abs(estimate.value - TRUTH) <= 3 * estimate.standard_deviation).all()


def test_torque_of_the_wrong_sign_is_refused_with_advice(cases: dict[int, Case]) -> None:
    model = model_at(cases, 10)
    with pytest.raises(RefusedError) as caught:
        Didim().estimate(with_torque(model, -model.measured))
    assert "check the sign" in str(caught.value)
    assert caught.value.values is not None and caught.value.values.size == TRUTH.size
    assert caught.value.iterations


def test_exchanged_joints_are_not_returned_as_an_answer(cases: dict[int, Case]) -> None:
    model = model_at(cases, 10)
    exchanged = with_torque(model, model.measured[:, ::-1].copy())
    try:
        estimate = Didim().estimate(exchanged)
    except RefusedError:
        return
    # Which of its steps fail is chance; what is left over is told as what it is.
    assert estimate.status is Status.MAXIMUM_ITERATIONS
    assert np.sqrt(np.mean((estimate.simulated - exchanged.measured) ** 2, axis=0)).min() > 0.5


def test_unknown_starts_are_refused(cases: dict[int, Case]) -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'ZZ1R'"):
        Didim(start={"ZZ1": 3.0}).estimate(model_at(cases, 10))
    with pytest.raises(InputError, match="torque, reference, nominal, description"):
        Didim(start="cad").estimate(model_at(cases, 10))


def test_integration_error_is_measured(cases: dict[int, Case]) -> None:
    model = model_at(cases, 10)
    estimate = Didim().estimate(model)
    assert 0 < estimate.integration_error < 1e-3
    assert np.max(estimate.integration_shift) <= 0.02
    assert estimate.integration is not None and estimate.integration.method == "linearly implicit midpoint rule"
    assert estimate.integration.substeps < model.automatic_substeps(estimate.value)
    # What it tells is what finer steps do.
    finer = Didim().estimate(model.with_loop(plant=model.loop.plant.with_substeps(4 * estimate.integration.substeps)))
    moved = np.abs(finer.value - estimate.value) / estimate.standard_deviation
    assert np.max(moved) <= 2 * np.max(estimate.integration_shift) + 1e-4


def test_integration_that_stays_too_coarse_is_told(cases: dict[int, Case], monkeypatch: pytest.MonkeyPatch) -> None:
    model = model_at(cases, 10)
    monkeypatch.setattr("fmu_didim.estimators.finish.MAXIMUM_REFINEMENTS", 1)
    monkeypatch.setattr("fmu_didim.estimators.finish.INTEGRATION_SHIFT", 1e-9)
    estimate = Didim().estimate(model)
    assert any("would still move a value" in remark for remark in estimate.remarks)
    np.testing.assert_array_equal(estimate.simulated, replace_steps(model, estimate).torque(estimate.value))


def replace_steps(model: LoopModel, estimate: Estimate) -> LoopModel:
    """The model with the steps that an estimate says it was fitted with."""
    assert estimate.integration is not None
    return model.with_loop(plant=model.loop.plant.with_substeps(estimate.integration.substeps))
