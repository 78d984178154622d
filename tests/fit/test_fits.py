"""Least squares of the closed loop: known parameters recovered, limits held, covariance true."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

from fmu_didim.base.errors import SimulationError
from fmu_didim.components import ModelComponent
from fmu_didim.discovery.base_model import with_nuisances
from fmu_didim.fit.derivatives.differences import STEP
from fmu_didim.fit.derivatives.repetition import repetition
from fmu_didim.fit.derivatives.sensitivity import sensitivity
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.solver.accuracy import integrated, with_fitting_substeps
from fmu_didim.fit.solver.least_squares import minimise
from fmu_didim.fit.solver.termination import Stopping
from fmu_didim.model.loop_model import LoopModel, Simulation
from tests.discovery.helpers import RATE, TRUTH, arm_model, coloured, data, known_noise, with_torque

SIGMA = 0.1
"""Of the torque noise, N m; the torque's RMS is about 10 N m."""
START = np.array([0.8, 1.3, 2.0, 0.6, 0.7])
"""Start of ZZ, MX, MY, Fv, Fc, in parts of the truth."""


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> LoopModel:
    return arm_model(tmp_path_factory.mktemp("one"))


@pytest.fixture(scope="module")
def truth(arm: LoopModel) -> np.ndarray:
    return arm.start


def model_with(arm: LoopModel, noise: np.ndarray | float = 0.0) -> LoopModel:
    return replace(with_torque(arm, arm.measured + noise), workers=1)


@pytest.fixture(scope="module")
def slopes(arm: LoopModel, truth: np.ndarray) -> np.ndarray:
    """Sensitivities at the truth."""
    return sensitivity(model_with(arm), truth, arm.measured)


def chi_square(model: LoopModel, values: np.ndarray) -> float:
    return float(np.sum((model.residual(values) / SIGMA) ** 2))


# ---- recovery --------------------------------------------------------------------------------------


@pytest.mark.parametrize("joints", [1, 2])
def test_noise_free_log_gives_the_parameters(tmp_path: Path, joints: int) -> None:
    arm = arm_model(tmp_path, joints=joints)
    truth = arm.start
    fit = minimise(arm.with_values(truth * np.tile(START, joints)), known_noise([1e-4] * joints))
    assert fit.values == pytest.approx(truth, rel=1e-6)
    assert np.abs(fit.residual).max() < 1e-5
    assert fit.model.start == pytest.approx(fit.values)


def test_smoothing_velocity_is_found_too(tmp_path: Path) -> None:
    arm = arm_model(tmp_path, joints=2, rate_hz=200.0)
    model = with_nuisances(arm)
    assert [parameter.name for parameter in model.free_parameters[-2:]] == ["v0_1", "v0_2"]
    start = model.start * 1.2
    fit = minimise(model.with_values(start), known_noise([1e-4, 1e-4]), stopping=Stopping(12))
    assert fit.values == pytest.approx([*arm.start, TRUTH[0]["v0"], TRUTH[1]["v0"]], rel=1e-5)


def test_noisy_log_gives_the_parameters_within_their_deviation(tmp_path: Path) -> None:
    arm = arm_model(tmp_path, joints=2)
    truth = arm.start
    sigma = [0.15, 0.06]
    noise = coloured(np.random.default_rng(0), arm.measured.shape, 0.3, np.array(sigma))
    model = with_torque(arm, arm.measured + noise)
    fit = minimise(model.with_values(np.tile(START, 2) * truth), known_noise(sigma, 0.3))
    deviation = np.sqrt(np.diag(fit.covariance))
    assert (np.abs(fit.values - truth) < 3.5 * deviation).all()
    assert (deviation < 0.3 * np.abs(truth)).all(), "intervals that say something"
    independent = fit.residual.size * known_noise(sigma, 0.3).factor[0]
    assert fit.chi_square == pytest.approx(independent, rel=0.1)


def test_it_is_the_minimum(arm: LoopModel, truth: np.ndarray) -> None:
    """Any step by a tenth of a standard deviation from it costs."""
    model = model_with(arm, coloured(np.random.default_rng(1), arm.measured.shape, 0.0, SIGMA))
    fit = minimise(model.with_values(truth * START), known_noise(SIGMA))
    assert fit.chi_square == pytest.approx(chi_square(model, fit.values))
    assert fit.residual == pytest.approx(model.residual(fit.values), abs=1e-12)
    root = np.linalg.cholesky(fit.covariance)
    for direction in (*np.eye(5), *-np.eye(5)):
        # A step of 0.2 deviations costs 0.04; the minimum itself is known to 0.02.
        assert chi_square(model, fit.values + 0.2 * root @ direction) > fit.chi_square


@pytest.mark.gate
@pytest.mark.parametrize("rho", [0.0, 0.6])
def test_intervals_cover_the_truth(arm: LoopModel, truth: np.ndarray, slopes: np.ndarray, rho: float) -> None:
    """60 logs of 5 parameters: 95 % intervals hold 88 to 99 % of them, and the deviations are those of the spread."""
    noise = known_noise(SIGMA, rho)
    scores = []
    for seed in range(60):
        model = model_with(arm, coloured(np.random.default_rng(seed), arm.measured.shape, rho, SIGMA))
        fit = minimise(model.with_values(truth), noise, jacobian=slopes, stopping=Stopping(updates=0))
        scores.append((fit.values - truth) / np.sqrt(np.diag(fit.covariance)))
    table = np.array(scores)
    assert 0.88 <= np.mean(np.abs(table) < 1.96) <= 0.99
    assert np.sqrt(np.mean(table**2)) == pytest.approx(1, abs=0.15)
    assert np.abs(table.mean(axis=0)).max() < 4 / np.sqrt(60)


# ---- limits ----------------------------------------------------------------------------------------


def limited(model: LoopModel, name: str, low: float, high: float) -> LoopModel:
    free_parameters = [replace(k, lowest=low, highest=high) if k.name == name else k for k in model.free_parameters]
    return model.with_free(tuple(free_parameters))


@pytest.mark.parametrize(("low", "high"), [(-np.inf, 1.8), (2.3, np.inf)])
def test_limits_hold_and_the_others_are_best_within_them(
    arm: LoopModel, truth: np.ndarray, low: float, high: float
) -> None:
    """The true Coulomb friction of 2 N m lies outside; the rest agrees with another solver's bounded minimum."""
    noise = coloured(np.random.default_rng(2), arm.measured.shape, 0.0, SIGMA)
    model = limited(model_with(arm, noise), "Fc1", low, high)
    fit = minimise(model.with_values(truth), known_noise(SIGMA), stopping=Stopping(20))
    bound = high if np.isfinite(high) else low
    assert fit.values[4] == bound
    bounds = (np.array([-np.inf] * 4 + [low]), np.array([np.inf] * 4 + [high]))
    wanted = least_squares(
        lambda x: model.residual(x).ravel() / SIGMA, np.clip(truth, *bounds), bounds=bounds, xtol=1e-12, ftol=1e-12
    )  # fmt: skip
    deviation = np.sqrt(np.diag(fit.covariance))
    assert np.abs(fit.values - wanted.x).max() <= (0.1 * deviation).max()
    assert fit.chi_square == pytest.approx(2 * wanted.cost, abs=0.05)


def test_start_outside_is_moved_inside_and_inactive_limits_do_not_matter(arm: LoopModel, truth: np.ndarray) -> None:
    model = limited(model_with(arm), "Fc1", 0.0, 5.0)
    start = truth.copy()
    start[4] = 50.0
    fit = minimise(model.with_values(start), known_noise(1e-4))
    assert fit.values == pytest.approx(truth, rel=1e-6)


def test_values_stay_inside_at_every_step(arm: LoopModel, truth: np.ndarray, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[np.ndarray] = []
    torque = Simulation.torque

    def watched(run: Simulation) -> np.ndarray:
        seen.append(run.values)
        return torque(run)

    monkeypatch.setattr(Simulation, "torque", watched)
    model = limited(model_with(arm), "Fv1", 1.6, 4.0)
    minimise(model.with_values(truth * START), known_noise(1e-2))
    assert len(seen) > 5
    assert all(1.6 <= values[3] <= 4.0 for values in seen)


# ---- Jacobian --------------------------------------------------------------------------------------


def same_minimum(fit: Fit, other: Fit) -> None:
    assert fit.chi_square == pytest.approx(other.chi_square, abs=0.05)
    deviation = np.sqrt(np.diag(other.covariance))
    assert np.abs((fit.values - other.values) / deviation).max() < 0.2


@pytest.mark.parametrize("wrong", [0.7, 1.5, 4.0])
def test_stale_jacobian_leads_to_the_same_minimum(
    arm: LoopModel, truth: np.ndarray, slopes: np.ndarray, wrong: float
) -> None:
    """Columns wrong by a common factor, and one of them by three times that."""
    model = model_with(arm, coloured(np.random.default_rng(3), arm.measured.shape, 0.0, SIGMA))
    model = model.with_values(truth * START)
    stale = slopes * wrong
    stale[:, :, 0] *= 3
    same_minimum(
        minimise(model, known_noise(SIGMA), jacobian=stale, stopping=Stopping(20)), minimise(model, known_noise(SIGMA))
    )


def test_good_jacobian_saves_simulations(arm: LoopModel, truth: np.ndarray, slopes: np.ndarray) -> None:
    model = model_with(arm, coloured(np.random.default_rng(4), arm.measured.shape, 0.0, SIGMA))
    model = model.with_values(truth * 1.02)
    fresh = minimise(model, known_noise(SIGMA))
    given = minimise(model, known_noise(SIGMA), jacobian=slopes, outputs=model.torque(model.start))
    same_minimum(given, fresh)
    assert given.simulations < fresh.simulations


# ---- ends ------------------------------------------------------------------------------------------


def test_hopeless_fit_ends_early(arm: LoopModel, truth: np.ndarray, slopes: np.ndarray) -> None:
    """A model of wrong form far above the best cost known is given up; one that may reach it is not."""
    time = data(arm).time[:, None]
    model = model_with(arm, 2.0 * np.sin(2 * np.pi * 7.3 * time))
    torque = model.torque(truth)
    best = minimise(model.with_values(truth), known_noise(SIGMA), jacobian=slopes, outputs=torque)
    given_up = minimise(
        model.with_values(truth), known_noise(SIGMA), jacobian=slopes, outputs=torque,
        stopping=Stopping(give_up_above=0.5 * best.chi_square),
    )  # fmt: skip
    assert given_up.simulations == 0
    assert given_up.values == pytest.approx(truth)
    kept = minimise(
        model.with_values(truth), known_noise(SIGMA), jacobian=slopes, outputs=torque,
        stopping=Stopping(give_up_above=1.01 * best.chi_square),
    )  # fmt: skip
    assert kept.chi_square == pytest.approx(best.chi_square)


def test_start_that_cannot_be_simulated_is_an_error(arm: LoopModel, truth: np.ndarray) -> None:
    wrong = truth.copy()
    wrong[0] = 1e-3
    with pytest.raises(SimulationError):
        minimise(model_with(arm).with_values(wrong), known_noise(SIGMA))


def test_knob_without_effect_stays(arm: LoopModel, truth: np.ndarray) -> None:
    """A free parameter that nothing depends on keeps its value and has no finite interval of its own making."""
    model = model_with(arm, coloured(np.random.default_rng(5), arm.measured.shape, 0.0, SIGMA))
    idle = replace(model.free_parameters[-1], name="idle", owner="plant", key="no_such_parameter", value=3.0)
    fit = minimise(model.with_free((*model.free_parameters, idle)), known_noise(SIGMA))
    plain = minimise(model, known_noise(SIGMA))
    assert fit.values[-1] == 3.0
    assert fit.values[:-1] == pytest.approx(plain.values)
    covariance = fit.covariance
    assert np.isfinite(covariance).all()
    assert covariance[:-1, :-1] == pytest.approx(plain.covariance, rel=1e-6, abs=1e-12)


@pytest.mark.parametrize("exact", [False, True])
def test_a_parameter_that_is_held_is_known(arm: LoopModel, truth: np.ndarray, exact: bool) -> None:
    """Limits that are one leave a value without deviation, and the others the deviations that they have without it."""
    noise = known_noise(SIGMA)
    model = limited(with_nuisances(model_with(arm)), "v0_1", 0.02, 0.02)
    fit = minimise(model, noise, stopping=Stopping(exact=exact))
    alone = minimise(model_with(arm), noise, stopping=Stopping(exact=exact))
    assert fit.values[-1] == 0.02
    covariance = fit.covariance
    assert covariance[-1, -1] == 0.0
    assert covariance[:-1, :-1] == pytest.approx(alone.covariance, rel=1e-6, abs=1e-12)


def test_rounding_makes_no_variance_negative(arm: LoopModel) -> None:
    """Columns that are one another to rounding: what they tell apart is rounding of any sign."""
    fit, rng = minimise(model_with(arm), known_noise(SIGMA)), np.random.default_rng(6)
    for _ in range(200):
        some = fit.jacobian[: int(rng.integers(3, len(fit.jacobian))), :, : int(rng.integers(1, 4))]
        slopes = np.concatenate([some, some[:, :, :1] * float(10 ** rng.uniform(-9, 9))], axis=2)
        covariance = replace(fit, jacobian=slopes).covariance
        assert np.linalg.eigvalsh(covariance).min() >= -1e-12 * np.abs(covariance).max()
        assert (np.diag(covariance) >= 0).all()


# ---- sensitivities ---------------------------------------------------------------------------------


@pytest.mark.gate
@pytest.mark.parametrize("exact", [False, True])
def test_sensitivities_of_a_motion_that_repeats_are_those_of_the_whole(tmp_path: Path, exact: bool) -> None:
    """Three periods, of which the first and a bit are simulated: the same columns as without noticing that."""
    arm = arm_model(tmp_path, joints=2, seconds=12.0)
    model = with_nuisances(replace(arm, workers=1))
    torque = model.torque(model.start)
    found = repetition(data(arm), data(arm).operator, 1 / RATE, torque)
    assert found is not None
    assert found.period == 400
    assert found.operator.ticks[-1] < 0.5 * data(arm).reference.time.size
    columns = sensitivity(model, model.start, torque, exact=exact)
    for i, parameter in enumerate(model.free_parameters):
        moved = model.start
        moved[i] += STEP * parameter.scale
        whole = (model.torque(moved) - torque) / (moved[i] - model.start[i])
        assert np.abs(columns[:, :, i] - whole).max() <= 1e-3 * np.abs(whole).max(), parameter.name


def test_torque_that_drifts_does_not_repeat(tmp_path: Path) -> None:
    arm = arm_model(tmp_path, seconds=12.0)
    operator, step = data(arm).operator, 1 / RATE
    drift = np.linspace(0, 0.1, arm.measured.shape[0])[:, None]
    assert repetition(data(arm), operator, step, arm.measured) is not None
    assert repetition(data(arm), operator, step, arm.measured + drift) is None


def test_columns_that_drift_are_not_continued(tmp_path: Path) -> None:
    arm = arm_model(tmp_path, seconds=12.0)
    found = repetition(data(arm), data(arm).operator, 1 / RATE, arm.measured)
    assert found is not None
    begin = arm.measured[: found.operator.count]
    np.testing.assert_allclose(found.continued(begin), arm.measured, atol=1e-4)
    assert found.continued(begin * np.linspace(1.0, 1.1, begin.shape[0])[:, None]) is None


# ---- integration as fine as the noise asks -----------------------------------------------------------


def substeps(model: LoopModel, values: np.ndarray) -> int | None:
    return model.system(values).components["plant"].stated_substeps


def test_steps_as_fine_as_the_noise_asks(arm: LoopModel, truth: np.ndarray) -> None:
    model = model_with(arm)
    counts = []
    for sigma in (10 * SIGMA, SIGMA, 0.1 * SIGMA):
        fitting = with_fitting_substeps(model, truth, np.array([sigma]))
        assert fitting.loop.substeps is not None
        finest = model.with_loop(substeps=512).torque(truth)
        error = fitting.torque(truth) - finest
        assert np.sqrt(np.mean(error**2)) <= 2 * 0.01 * sigma  # what is left beyond the last doubling is less than it
        counts.append(substeps(fitting, truth))
    assert counts[0] < counts[2] < model.automatic_substeps(truth)


def test_the_rule_holds_where_the_noise_asks_for_more(arm: LoopModel, truth: np.ndarray) -> None:
    assert with_fitting_substeps(model_with(arm), truth, np.array([1e-12])).loop.substeps is None


@pytest.mark.parametrize("times", [1, 2, 4])
def test_a_search_may_ask_for_no_finer_steps_than_resolve_what_oscillates(
    arm: LoopModel, truth: np.ndarray, times: int
) -> None:
    model = model_with(arm)
    fewest, coarse = model.fewest_substeps(truth), np.array([10 * SIGMA])
    assert times * fewest < model.automatic_substeps(truth)
    assert with_fitting_substeps(model, truth, np.array([1e-12]), times_fewest=times).loop.substeps == times * fewest
    assert with_fitting_substeps(model, truth, coarse, times_fewest=1024) == with_fitting_substeps(model, truth, coarse)


def test_the_residual_stands_for_noise_that_is_not_known(arm: LoopModel, truth: np.ndarray) -> None:
    noisy = model_with(arm, np.random.default_rng(3).normal(0, SIGMA, arm.measured.shape))
    known = with_fitting_substeps(noisy, truth, np.array([SIGMA]))
    assert with_fitting_substeps(noisy, truth).loop.substeps == known.loop.substeps
    assert with_fitting_substeps(replace(noisy, torque_deviation=np.array([1e-12])), truth).loop.substeps is None


def test_stated_substeps_stay(arm: LoopModel, truth: np.ndarray) -> None:
    model = model_with(arm)
    plant = model.loop.plant.with_substeps(3)
    assert plant is not None
    stated = model.with_loop(plant=plant)
    assert with_fitting_substeps(stated, truth, np.array([SIGMA])) == stated


def test_sensitivities_do_not_change_the_steps(arm: LoopModel, truth: np.ndarray) -> None:
    """A step of a free parameter that asks for more substeps would show as a change of the torque."""
    known = arm.loop.plant.equations()
    assert known is not None
    explicit = ModelComponent(replace(known[0], implicit=None))
    model = model_with(arm).with_loop(plant=explicit, substeps=1)
    pinned = model.integrated_as(truth)
    steeper = truth * [1, 1, 1, 1, 50]
    assert substeps(model, steeper) != substeps(pinned, truth)
    assert substeps(pinned, steeper) == substeps(pinned, truth)


def test_a_minimum_is_integrated_finer_where_its_noise_asks(arm: LoopModel, truth: np.ndarray) -> None:
    found = minimise(model_with(arm).with_values(truth * START).with_loop(substeps=1), known_noise([SIGMA]))
    exact = integrated(replace(found, noise=known_noise([1e-9])))
    assert exact.model.loop.substeps is None
    assert exact.values == pytest.approx(truth, rel=1e-6)
    assert np.abs(found.values / truth - 1).max() > 1e-6
    assert integrated(exact) is exact


def test_an_exact_jacobian_belongs_to_the_minimum(arm: LoopModel, truth: np.ndarray) -> None:
    stopping = Stopping(exact=True, whole=True)
    fit = minimise(model_with(arm).with_values(truth * START), known_noise([1e-4]), stopping=stopping)
    assert np.array_equal(fit.jacobian, sensitivity(fit.model, fit.values, fit.torque, exact=True))
