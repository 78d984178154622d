"""Answers of fits of outputs that are none: failing simulations, ridges, rough models."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fmu_didim.base.errors import IdentificationError
from fmu_didim.data.signals import trajectory
from fmu_didim.fit.estimate import RefusedError, Status
from fmu_didim.fit.noise.noise import motion_frequency
from fmu_didim.fit.solver.minimum_check import unproven
from tests.case.calibration.models import case_of, noisy, steps_of_lag

TIME = np.linspace(0, 20, 101)


@pytest.mark.parametrize("start", [0.5, 3.0])
def test_a_step_to_where_the_model_fails_is_shortened(start: float) -> None:
    """X = exp(-sqrt(k) t), and Gauss-Newton steps to k < 0."""
    log = noisy(TIME, {"X": np.exp(-0.1 * TIME)}, 0.01, 0)
    case = case_of("root", {"log": log}, measured="log", identify={"k": {"start": start}, "X0": {}})
    found = case.estimator.estimate(case.model)
    assert found.status is Status.CONVERGED
    assert (np.abs(found.value - [0.01, 1.0]) < 4 * found.standard_deviation).all()
    (told,) = [remark for remark in found.remarks if "shortened" in remark]
    assert "k = -" in told
    assert "the state is not finite" in told  # what the FMU said
    assert len(found.iterations) < 15


def test_a_start_where_the_model_fails_is_refused() -> None:
    log = trajectory(TIME, {"X": np.exp(-0.1 * TIME)})
    case = case_of("root", {"log": log}, measured="log", identify={"k": {"start": -1.0}})
    with pytest.raises(RefusedError, match=r"cannot be simulated[\s\S]*not finite") as error:
        case.estimator.estimate(case.model)
    assert "gains" not in str(error.value)


@pytest.mark.parametrize("seed", range(5))
def test_a_ridge_is_refused_with_how_the_parameters_move_along_it(seed: int) -> None:
    """z = g k (...): only the product is shown."""
    z = 2.0 * steps_of_lag(TIME, {0.0: 1.0, 8.0: -1.0}, constant=1.5, gain=2.0, start=0.0)
    rng = np.random.default_rng(seed)
    start = dict(zip(("T", "k", "g"), np.array([1.5, 2.0, 2.0]) * np.exp(rng.uniform(-1, 1, 3)), strict=True))
    case = case_of(
        "lag", {"u": trajectory(np.array([0.0, 8.0, 20.0]), {"u": np.array([1.0, -1.0, -1.0])}),
                "log": noisy(TIME, {"z": z}, 0.01, seed)},
        inputs={"file": "u", "interpolation": "held"}, measured="log",
        identify={name: {"start": float(value), "minimum": 0.0} for name, value in start.items()},
    )  # fmt: skip
    with pytest.raises(IdentificationError, match="cannot tell some parameters apart") as error:
        case.estimator.estimate(case.model)
    assert str(error.value.got).startswith("k +1 %, g -1 % together change the outputs least of all")


@pytest.mark.parametrize("seed", range(6))
def test_a_rough_model_is_right_or_not_settled(seed: int) -> None:
    log = noisy(TIME, {"X": np.exp(-0.2 * TIME)}, 0.01, 100 + seed)
    start = float(np.exp(np.random.default_rng(seed).uniform(-1, 1)) * 0.2)
    case = case_of("rough", {"log": log}, measured="log", identify={"k": {"start": start}, "X0": {"start": 0.7}})
    found = case.estimator.estimate(case.model)
    smooth = np.array([0.2, 1.0])
    if found.status is Status.CONVERGED:
        assert (np.abs(found.value - smooth) < 4 * found.standard_deviation + 1e-3).all()
    else:
        assert found.advice


def test_a_reference_that_rests_but_for_rounding_has_no_frequency() -> None:
    time = np.arange(100) * 0.01
    assert motion_frequency(trajectory(time, {"q1": 0.3 + 0 * time}), 1) == 0.0
    speed = 1e-165 * np.sin(30 * time)
    assert motion_frequency(trajectory(time, {"q1": 0.3 + 0 * time, "dq1": speed}), 1) == 0.0


def test_a_point_beside_the_minimum_is_none_and_the_minimum_is_one() -> None:
    log = noisy(TIME, {"X": np.exp(-0.1 * TIME)}, 0.01, 3)
    case = case_of("root", {"log": log}, measured="log", identify={"k": {"start": 0.02}, "X0": {}})
    found = case.estimator.estimate(case.model)
    assert found.fit is not None
    assert unproven(found.fit) is None
    for sigmas, told in ((0.02, False), (0.5, True)):
        values = found.value + sigmas * found.standard_deviation * [1.0, 0.0]
        beside = replace(found.fit, model=found.fit.model.with_values(values), values=values)
        doubt = unproven(beside)
        assert (doubt is not None) == told
        if doubt is not None:
            assert "still falling" in doubt.text
            assert 0.3 < abs(doubt.off) < 1.0
    wrong = replace(found.fit, jacobian=3 * found.fit.jacobian)
    doubt = unproven(wrong)
    assert doubt is not None
    assert "not those of the model" in doubt.text
