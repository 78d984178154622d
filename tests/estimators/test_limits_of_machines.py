"""Values that no machine has: the answer is the nearest machine, and what the data alone ask for is reported."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fmu_didim.case import load_case
from fmu_didim.checks.identification import checked
from fmu_didim.estimators.didim import Didim
from fmu_didim.fit.estimate import Estimate
from fmu_didim.fit.statistics import bounded_interval
from fmu_didim.model.loop_model import LoopModel
from tests.helpers import ROOT, with_torque

SEEDS = 40
NOISE = np.array([0.35, 0.012])


@pytest.fixture(scope="module")
def model() -> LoopModel:
    return load_case(ROOT / "examples/scara/identify.yaml").model


def estimated(model: LoopModel, truth: dict[str, float], seed: int) -> Estimate:
    """From a simulated log with noise, the truth changed."""
    values = model.start
    for name, value in truth.items():
        values[model.names.index(name)] = value
    log = model.torque(values)
    log = log + NOISE * np.random.default_rng(seed).standard_normal(log.shape)
    return Didim(start="torque").estimate(with_torque(replace(model, torque_deviation=NOISE), log))


@pytest.fixture(scope="module")
def without_friction(model: LoopModel) -> list[Estimate]:
    return [estimated(model, {"Fv1": 0.0}, seed) for seed in range(SEEDS)]


@pytest.mark.gate
def test_friction_that_is_zero_is_never_negative_and_its_intervals_hold(without_friction: list[Estimate]) -> None:
    """In half of the draws the data alone have it below zero; then the interval begins there."""
    place = without_friction[0].names.index("Fv1")
    held = [estimate for estimate in without_friction if place in estimate.held_at_zero]
    assert 0.25 * SEEDS <= len(held) <= 0.75 * SEEDS
    for estimate in without_friction:
        assert estimate.value[place] >= 0
        assert (estimate.value[place] == 0) == (place in estimate.held_at_zero)
        low, high = estimate.interval()[place]
        assert low <= 0 <= high or place not in estimate.held_at_zero
        assert any("Fv1 = 0 (alone -" in remark for remark in estimate.remarks) is (place in estimate.held_at_zero)
    covered = [estimate.interval()[place][0] <= 0 <= estimate.interval()[place][1] for estimate in without_friction]
    assert np.mean(covered) >= 0.9


@pytest.mark.gate
def test_other_values_stay_right_beside_one_that_is_held(without_friction: list[Estimate], model: LoopModel) -> None:
    truth = model.start
    truth[model.names.index("Fv1")] = 0.0
    z = np.array([(estimate.value - truth) / estimate.standard_deviation for estimate in without_friction])
    others = [i for i in range(truth.size) if i != model.names.index("Fv1")]
    assert np.mean(np.abs(z[:, others]) <= 1.96) >= 0.92
    assert np.abs(z[:, others]).max() < 4.5


def test_friction_far_below_zero_is_a_doubt_with_the_value_that_the_data_ask_for(model: LoopModel) -> None:
    """A drive that pushes: no machine has it, and the answer is one all the same."""
    estimate = estimated(model, {"Fv1": -0.6}, 1)
    place = estimate.names.index("Fv1")
    assert estimate.value[place] == 0
    assert estimate.unlimited is not None
    assert estimate.unlimited[place] == pytest.approx(-0.6, abs=0.2)
    codes = {d.code.name for d in checked(estimate, []).judgement.reasons}
    assert "friction-negative" in codes


@pytest.mark.parametrize("value", [-3.0, -1.0, 0.0])
def test_the_interval_of_a_value_below_its_limit(value: float) -> None:
    """Of draws above the limit, 95 % lie below its end."""
    draws = value + np.random.default_rng(0).standard_normal(4_000_000)
    above = draws[draws > 0]
    assert np.mean(above < bounded_interval(value, 1.0, 1e6, 0.0)) == pytest.approx(0.95, abs=0.01)
