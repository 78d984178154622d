"""Logs that show the size of the torque alone: signs that are found, values with them, and what is told."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import integrate, stats

from fmu_didim import check, discover, identify, load_case
from fmu_didim.base.diagnostics import DiagnosedError
from fmu_didim.base.errors import InputError
from fmu_didim.checks.data.expected import Expected
from fmu_didim.checks.data.unsigned import unsigned_diagnostics
from fmu_didim.data.signals import Array
from fmu_didim.estimators.starts.reference_start import rows_on, whole_reference
from fmu_didim.estimators.starts.signs import best_values, folded_excess, signed_by, unknown_signs, with_signs
from fmu_didim.model.loop_model import LoopModel
from tests.tools.unsigned import SCARA, case_of, errors_of
from tests.tools.verdict.catalogue import right


def unsigned(model: LoopModel) -> LoopModel:
    """The same logs without their signs."""
    for label, experiment in model.experiments.items():
        model = model.with_experiment(label, replace(experiment, torque=np.abs(experiment.torque), is_unsigned=True))
    return model


def wrong_signs(model: LoopModel, other: LoopModel) -> float:
    """Share of the squares of all logs whose signs differ."""
    pairs = [(model.experiments[k].torque, other.experiments[k].torque) for k in model.experiments]
    off = sum(float(np.sum((a - b) ** 2)) for a, b in pairs) / 4
    return off / sum(float(np.sum(a**2)) for a, _ in pairs)


@pytest.mark.parametrize("robot", ["scara", "arm", "axis"])
@pytest.mark.parametrize("seed", range(5))
def test_signs_are_found_from_start_values_that_are_off_by_a_factor(robot: str, seed: int) -> None:
    """Each value is off by up to 2.5, up or down. Along the reference, near zero, some samples are on the wrong side:
    the fit of the loop puts these right."""
    model = right(robot, seed)
    assert wrong_signs(with_signs(unsigned(model)), model) < 2e-3
    assert with_signs(model) is model  # it has its signs


def test_signs_of_a_simulation_are_those_of_each_sample() -> None:
    model = right("scara", 1)
    found = signed_by(unsigned(model), model.start)
    simulated = model.torque(model.start)
    given = found.experiments["estimation"].torque
    np.testing.assert_array_equal(np.sign(given), np.where(simulated < 0, -1.0, 1.0))
    np.testing.assert_array_equal(np.abs(given), np.abs(model.experiments["estimation"].torque))


def test_the_least_misfit_counts_wherever_it_begins() -> None:
    model = right("arm", 3)
    run = model.simulation(model.start)
    columns, known = rows_on(run, whole_reference(run))
    sizes = np.abs(run.experiment.torque)
    near = best_values(columns, known, sizes, model.theta(model.start))
    far = best_values(columns, known, sizes, 0.1 * model.theta(model.start)[::-1].copy())
    assert far[1] == pytest.approx(near[1], rel=1e-6)


@pytest.mark.parametrize("torque", [0.0, 0.1, -0.3, 1.0, -4.0])
def test_sizes_are_larger_than_the_torque_by_the_mean_of_the_folded_normal_distribution(torque: float) -> None:
    noise = 0.3
    mean = integrate.quad(lambda x: abs(torque + noise * x) * stats.norm.pdf(x), -12, 12, points=[-torque / noise])[0]
    found = folded_excess(np.array([[torque]]), np.array([noise]))
    np.testing.assert_allclose(found, [[mean - abs(torque)]], atol=1e-9)


def fit_of(columns: Array, values: Array, *, is_unsigned: bool = True) -> Any:
    """A point of a model torque = columns (N, p) values (p,), noise of deviation one."""
    log = SimpleNamespace(label="a", rows=slice(None))
    block = SimpleNamespace(logs=[log], columns=slice(0, 1))
    experiments = {"a": SimpleNamespace(is_unsigned=is_unsigned)}
    kind = type("Experiments", (), {"output_blocks": (block,), "__getitem__": lambda _, k: experiments[k]})
    model = SimpleNamespace(experiments=kind(), beside_prior=lambda table: table)
    return SimpleNamespace(
        model=model, outputs=(columns @ values)[:, None], jacobian=columns[:, None, :], deviation=np.ones(1)
    )


def test_deviations_of_logs_without_signs_are_those_of_many_draws() -> None:
    """Half of the torque is within its noise of zero. 4000 draws know a deviation to 1 %."""
    rng = np.random.default_rng(3)
    columns = np.column_stack([np.linspace(-1, 1, 200), np.cos(np.linspace(0, 9, 200))])
    truth = np.array([1.5, 1.0])
    clean, pseudo = columns @ truth, np.linalg.pinv(columns)
    sizes = np.abs(clean + rng.normal(size=(4000, 200)))
    theta = np.tile(truth, (4000, 1))
    for _ in range(100):
        torque = theta @ columns.T
        signs = np.where(torque < 0, -1.0, 1.0)
        theta = (signs * (sizes - folded_excess(torque, np.ones(200)))) @ pseudo.T
    with_signs_known = np.linalg.inv(columns.T @ columns)
    stated = np.sqrt(np.diag(with_signs_known + unknown_signs(fit_of(columns, truth))))
    assert (np.abs(theta.mean(axis=0) - truth) < 0.15 * stated).all()
    np.testing.assert_allclose(theta.std(axis=0), stated, rtol=0.06)
    assert (stated > 1.15 * np.sqrt(np.diag(with_signs_known))).all()
    np.testing.assert_allclose(unknown_signs(fit_of(columns, truth, is_unsigned=False)), 0, atol=1e-12)


@pytest.mark.gate
def test_values_are_those_of_the_machine_and_the_signs_are_told() -> None:
    result = identify(case_of(1))
    assert result.verdict == "valid"
    assert np.abs(errors_of(result)).max() < 4
    told = [remark for remark in result.document.remarks if "shows sizes alone" in remark]
    assert len(told) == 1 and "of 402 values are so near to zero" in told[0]


@pytest.mark.slow
def test_intervals_hold_the_truth() -> None:
    """100 draws: between 92 and 97 % of the values."""
    inside = [np.abs(errors_of(identify(case_of(seed)))) < 1.96 for seed in range(100)]
    assert 0.92 < np.mean(inside) < 0.97


def test_a_log_without_signs_that_does_not_say_so_is_told() -> None:
    with pytest.raises(DiagnosedError, match="never goes below zero") as caught:
        identify(case_of(1, says_so=False))
    assert {d.code.name for d in caught.value.found} == {"log-unsigned"}
    assert "unsigned: true" in str(caught.value)
    assert "log-unsigned" in [d.code.name for d in check(case_of(1, says_so=False)).diagnostics]


def test_a_torque_that_never_changes_its_sign_is_no_such_log() -> None:
    """Of a joint that gravity loads one way."""
    rng = np.random.default_rng(1)
    columns = np.abs(rng.normal(size=(100, 1, 2)))
    measured = columns @ (1.0, 2.0) + 0.01 * rng.normal(size=(100, 1))
    assert unsigned_diagnostics(Expected(measured, columns=columns), "estimation") == []


def test_a_constant_log_is_no_such_log() -> None:
    """It is told as one: of a deviation of zero, any error is many times as much."""
    columns = np.random.default_rng(1).normal(size=(100, 1, 2))
    constant = np.full((100, 1), 0.3)
    assert unsigned_diagnostics(Expected(constant, constant, columns), "estimation") == []


def test_negative_values_in_a_log_without_signs_are_refused() -> None:
    with pytest.raises(InputError, match="has negative values"):
        load_case(SCARA).with_(train={"torque": {"unsigned": True}})


def test_discovery_asks_for_signs() -> None:
    with pytest.raises(InputError, match="without signs"):
        discover(case_of(1))
