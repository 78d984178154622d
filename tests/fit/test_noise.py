"""Noise of a torque log known without a model: its size and colour from repetition, and without."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fmu_didim.base.errors import InputError
from fmu_didim.checks.data.checks import data_diagnostics
from fmu_didim.cosim import sample_operator
from fmu_didim.data.filters import LowPass
from fmu_didim.data.signals import Trajectory, trajectory, write_csv
from fmu_didim.data.tables import read_trajectory
from fmu_didim.discovery.base_model import prepare
from fmu_didim.fit.log_noise import friction_columns
from fmu_didim.fit.noise.noise import (
    LARGEST_CORRELATION,
    Noise,
    motion_frequency,
    noise_from_periods,
    noise_from_residual,
    period_in_ticks,
)
from tests.discovery.helpers import RATE, arm_model, coloured, data, sines, with_torque

SAMPLES = 500
"""Samples in a period of the made-up logs."""
SIGMA = np.array([0.3, 0.02])


def repeating(periods: int = 4) -> np.ndarray:
    """(N, 2) torque that repeats exactly, far larger than the noise and with steps."""
    phase = 2 * np.pi * np.arange(periods * SAMPLES)[:, None] / SAMPLES
    return np.asarray(
        [20.0, 3.0] * np.sin(phase + np.array([0.1, 1.3])) + [4.0, 0.5] * np.sign(np.cos(3 * phase + 0.4))
    )


# ---- from periods ----------------------------------------------------------------------------------


@pytest.mark.parametrize("rho", [0.0, 0.4, 0.8])
def test_size_and_colour_from_periods(rho: float) -> None:
    """Mean over seeds: nearly without bias; each single estimate within what so many samples allow."""
    found = []
    draws = 120
    for seed in range(draws):
        noise = coloured(np.random.default_rng(seed), (4 * SAMPLES, 2), rho, SIGMA)
        estimate = noise_from_periods(repeating() + noise, SAMPLES, rate_hz=100.0, skip=50)
        assert estimate is not None
        assert estimate.source == "periods"
        assert estimate.periods == 4
        found.append([estimate.deviation / SIGMA, estimate.correlation])
    size, effective_fraction = np.mean(found, axis=0)
    factor = (1 + rho**2) / (1 - rho**2)
    # Estimates scatter by 1.13 to 1.19 of what as many samples without the differences between periods would give.
    spread = 1.2 * np.sqrt(factor / (2 * 3 * SAMPLES))
    assert size == pytest.approx(1, abs=5 * spread / np.sqrt(draws))
    # A negative correlation is cut off at zero, which leaves white noise with a mean of 0.4 of its spread.
    assert effective_fraction == pytest.approx(rho, abs=0.02)
    assert np.abs(np.array(found)[:, 0] - 1).max() < 5 * spread


@pytest.mark.parametrize(("length", "skip", "periods"), [(4.0, 0.0, 4), (4.0, 0.1, 4), (1.9, 0.0, 2), (2.5, 0.1, 3)])
def test_periods_that_are_compared_are_counted(length: float, skip: float, periods: int) -> None:
    torque = repeating()[: round(length * SAMPLES)]
    estimate = noise_from_periods(torque, SAMPLES, rate_hz=100.0, skip=round(skip * SAMPLES))
    assert estimate is not None
    assert estimate.periods == periods


def test_weight_makes_a_chi_square_of_independent_samples() -> None:
    noise = Noise(SIGMA, np.array([0.0, 0.6]), "periods")
    assert noise.factor == pytest.approx([1.0, 0.25])
    values = coloured(np.random.default_rng(1), (200_000, 2), 0.6, SIGMA)
    assert np.sum((values * noise.weight) ** 2, axis=0) / 200_000 == pytest.approx(noise.factor, rel=0.02)


def test_what_is_correlated_for_long_is_told() -> None:
    """Noise of correlation 0.3 has forgotten itself after 50 ms; a slow torque that does not repeat has not."""
    found = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        noise = coloured(rng, (4 * SAMPLES, 2), 0.3, SIGMA)
        slow = coloured(rng, (4 * SAMPLES, 2), 0.98, SIGMA)
        plain = noise_from_periods(repeating() + noise, SAMPLES, rate_hz=100.0, skip=0)
        both = noise_from_periods(repeating() + noise + slow, SAMPLES, rate_hz=100.0, skip=0)
        assert plain is not None and both is not None
        found.append([plain.slow, both.slow])
    plain_mean, both_mean = np.mean(found, axis=0)
    assert plain_mean == pytest.approx(0.0, abs=0.03)  # the mean of 40 scatters by 0.006
    assert both_mean == pytest.approx(0.5 * 0.98**5, abs=0.08)  # by 0.012, and is 0.02 too small


def test_constant_difference_between_periods_is_not_noise() -> None:
    noise = coloured(np.random.default_rng(2), (2 * SAMPLES, 2), 0.0, SIGMA)
    drifted = repeating(2) + noise
    drifted[SAMPLES:] += 10 * SIGMA
    estimate = noise_from_periods(drifted, SAMPLES, rate_hz=100.0, skip=0)
    assert estimate is not None
    assert estimate.deviation == pytest.approx(SIGMA, rel=0.1)


@pytest.mark.parametrize("change", [-0.05, -0.2])
def test_friction_that_changes_between_periods_is_not_noise(change: float) -> None:
    """Viscous and Coulomb friction by 5 % of a period's before: with the columns of friction the noise is found; a
    change of a fifth, without them, is taken for noise."""
    motion = sines(16.0, joints=2)
    speed = motion.select(["dq1", "dq2"])
    count = 4 * RATE
    friction = np.array([3.0, 0.8]) * np.tanh(speed / 0.02) + np.array([1.0, 0.3]) * speed
    drift = 1 + change * np.repeat(np.arange(4), count)[:, None]
    noise = coloured(np.random.default_rng(3), friction.shape, 0.3, SIGMA)
    torque = motion.select(["ddq1", "ddq2"]) + friction * drift + noise
    columns = np.stack([speed, np.tanh(speed / (0.01 * np.abs(speed).max(axis=0))), np.ones_like(speed)], axis=2)
    with_columns = noise_from_periods(torque, count, rate_hz=100.0, skip=0, regressors=columns)
    plain = noise_from_periods(torque, count, rate_hz=100.0, skip=0)
    assert with_columns is not None
    assert plain is not None
    assert with_columns.deviation == pytest.approx(SIGMA, rel=0.06)
    assert with_columns.correlation == pytest.approx(0.3, abs=0.08)
    if change < -0.1:
        assert (plain.deviation > 1.3 * SIGMA).all()


@pytest.mark.parametrize("size", [1.0, 5.0, 20.0])
def test_push_in_one_period_is_not_noise(size: float) -> None:
    """A tenth of one of two periods pushed by ``size`` deviations: noise within 20 % in 99 of 100 draws.

    Otherwise the external torque would hide in what is taken for noise.
    """
    near = []
    for seed in range(40):
        noise = coloured(np.random.default_rng(seed), (2 * SAMPLES, 2), 0.4, SIGMA)
        torque = repeating(2) + noise
        torque[620:670] += size * SIGMA
        estimate = noise_from_periods(torque, SAMPLES, rate_hz=100.0, skip=0)
        assert estimate is not None
        near += list((np.abs(estimate.deviation / SIGMA - 1) < 0.2) & (np.abs(estimate.correlation - 0.4) < 0.2))
    assert np.mean(near) >= 0.95


def test_noise_of_changing_loudness_is_all_noise() -> None:
    """Half of the motion three times as loud: nothing is left out."""
    loud = 1 + 2 * (np.arange(4 * SAMPLES) % SAMPLES < SAMPLES // 2)[:, None]
    noise = coloured(np.random.default_rng(7), (4 * SAMPLES, 2), 0.0, SIGMA) * loud
    estimate = noise_from_periods(repeating() + noise, SAMPLES, rate_hz=100.0, skip=0)
    assert estimate is not None
    assert estimate.deviation == pytest.approx(SIGMA * np.sqrt(5), rel=0.06)


def test_too_short_a_log_gives_nothing() -> None:
    torque = repeating(2)
    assert noise_from_periods(torque[: int(1.4 * SAMPLES)], SAMPLES, rate_hz=100.0, skip=0) is None
    assert noise_from_periods(torque, SAMPLES, rate_hz=100.0, skip=SAMPLES) is None
    assert noise_from_periods(torque[: int(1.6 * SAMPLES)], SAMPLES, rate_hz=100.0, skip=0) is not None
    assert noise_from_periods(torque[:40], 20, rate_hz=100.0, skip=0) is None, "twenty differences are too few"


def test_correlation_is_capped() -> None:
    """A random walk between periods must not make the effective number of samples vanish."""
    walk = np.cumsum(np.random.default_rng(4).normal(size=(2 * SAMPLES, 2)), axis=0)
    estimate = noise_from_periods(repeating(2) + walk, SAMPLES, rate_hz=100.0, skip=0)
    assert estimate is not None
    assert (estimate.correlation <= LARGEST_CORRELATION).all()
    assert (estimate.factor > 0.01).all()


def test_exact_repetition_gives_finite_weights(tmp_path: Path) -> None:
    """A simulated log without noise is data, too: nothing becomes infinite."""
    prepared = prepare(arm_model(tmp_path))
    assert np.isfinite(prepared.fit.noise.weight).all()
    assert np.isfinite(prepared.fit.values).all()
    assert np.isfinite(prepared.fit.covariance).all()


# ---- period ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("period_s", [2.0, 3.7, 4.0])
@pytest.mark.parametrize("periods", [1.5, 2, 5])
def test_period_of_sums_of_sines(period_s: float, periods: float) -> None:
    motion = sines(periods * period_s, joints=2, period_s=period_s)
    assert period_in_ticks(motion) == round(period_s * RATE)


def test_period_of_a_file_with_nine_digits(tmp_path: Path) -> None:
    motion = sines(8.0, joints=2)
    rounded = np.array([[float(f"{v:.9g}") for v in row] for row in motion.values])
    assert not np.array_equal(rounded, motion.values)
    write_csv(trajectory(motion.time, dict(zip(motion.names, rounded.T, strict=True))), tmp_path / "motion.csv")
    assert period_in_ticks(read_trajectory(tmp_path / "motion.csv")) == 4 * RATE


def chirp() -> Trajectory:
    time = np.arange(8 * RATE) / RATE
    return trajectory(time, {"q1": np.sin(2 * np.pi * (0.2 + 0.1 * time) * time)})


def test_no_period_where_nothing_repeats() -> None:
    still = trajectory(np.arange(800) / RATE, {"q1": np.full(800, 0.3)})
    assert period_in_ticks(chirp()) is None
    assert period_in_ticks(sines(4.0)) is None, "one single period"
    assert period_in_ticks(still) is None, "no motion"
    mixed = trajectory(chirp().time, {"q1": sines(8.0).select(["q1"])[:, 0], "q2": chirp().select(["q1"])[:, 0]})
    assert period_in_ticks(mixed) is None, "one joint repeats, the other does not"


def test_a_joint_at_rest_does_not_hide_the_period() -> None:
    motion = sines(8.0)
    both = trajectory(motion.time, {"q1": motion.select(["q1"])[:, 0], "q2": np.full(motion.time.size, 0.7)})
    assert period_in_ticks(both) == 4 * RATE


def test_a_nearly_periodic_motion_has_no_period() -> None:
    """Sines whose frequencies differ by one part in a thousand from a common period's."""
    motion = sines(8.0)
    shifted = motion.select(["q1"])[:, 0] + 0.3 * np.sin(2 * np.pi * 1.001 * motion.time)
    assert period_in_ticks(trajectory(motion.time, {"q1": shifted})) is None


# ---- without repetition ----------------------------------------------------------------------------


@pytest.mark.parametrize("rho", [0.0, 0.3, 0.6])
def test_fallback_on_pure_noise(rho: float) -> None:
    """Within 20 % in size and 0.15 in colour."""
    for seed in range(10):
        residual = coloured(np.random.default_rng(seed), (2000, 2), rho, SIGMA)
        noise = noise_from_residual(residual, rate_hz=100, motion_hz=1.0)
        assert noise.source == "residual"
        assert noise.period_s is None
        assert noise.deviation == pytest.approx(SIGMA, rel=0.2)
        assert noise.correlation == pytest.approx(rho, abs=0.15)


@pytest.mark.parametrize("rate_hz", [100.0, 20.0])
def test_fallback_leaves_slow_model_error_out(rate_hz: float) -> None:
    """Model error of ten times the noise at the frequencies of the motion: at most twice the noise, never half."""
    time = np.arange(2000)[:, None] / rate_hz
    slow = 10 * np.sin(2 * np.pi * 0.25 * time) + 5 * np.sin(2 * np.pi * 0.9 * time + 1)
    for seed in range(10):
        residual = SIGMA * slow + coloured(np.random.default_rng(seed), (2000, 2), 0.3, SIGMA)
        noise = noise_from_residual(residual, rate_hz=rate_hz, motion_hz=1.0)
        assert (noise.deviation > 0.5 * SIGMA).all()
        assert (noise.deviation < 2.0 * SIGMA).all()


@pytest.mark.parametrize("cutoff_hz", [20.0, 40.0])
def test_noise_behind_the_filter_of_a_log_is_that_before_it(cutoff_hz: float) -> None:
    """White noise at 1 kHz behind the filter, seen at 100 Hz: as much as the same density would be at that rate.
    Without the cut-off it would be a fraction."""
    for seed in range(5):
        white = np.random.default_rng(seed).normal(0.0, SIGMA * np.sqrt(10), size=(20000, 2))
        behind = LowPass(cutoff_hz).apply(white, 1000.0)[::10]
        found = noise_from_residual(behind, rate_hz=100.0, motion_hz=8.0, cutoff_hz=cutoff_hz)
        assert found.deviation == pytest.approx(SIGMA, rel=0.2)
        assert found.correlation == pytest.approx(0.0, abs=0.2)
        assert (noise_from_residual(behind, rate_hz=100.0, motion_hz=8.0).deviation < 0.7 * SIGMA).all()


def test_a_sweep_is_no_noise_at_a_low_rate() -> None:
    """Torque of 1.5 sigma that sweeps from 0.5 to 5 Hz in 24 s, seen at 20 Hz: the noise is told to a third."""
    time = np.arange(480) / 20.0
    sweep = np.sqrt(2) * 1.5 * np.sin(2 * np.pi * (0.5 * time + 0.5 * 0.19 * time**2))
    for seed in range(10):
        noise = coloured(np.random.default_rng(seed), (480, 2), 0.3, SIGMA)
        found = noise_from_residual(noise + SIGMA * sweep[:, None], rate_hz=20.0, motion_hz=1.5)
        assert np.median(found.deviation / SIGMA) < 1.35, seed
        assert (found.deviation / SIGMA > 0.6).all(), seed


def test_frequency_of_the_motion() -> None:
    assert motion_frequency(sines(8.0), 1) == pytest.approx(1.25, abs=0.3)
    without = trajectory(sines(8.0).time, {"q1": sines(8.0).select(["q1"])[:, 0]})
    assert motion_frequency(without, 1) == pytest.approx(motion_frequency(sines(8.0), 1), abs=0.13)


# ---- in the preparation of a model ---------------------------------------------------------------


def test_prepared_from_periods(tmp_path: Path) -> None:
    model = arm_model(tmp_path, seconds=12.0)
    noise = coloured(np.random.default_rng(5), model.measured.shape, 0.5, 0.1)
    prepared = prepare(with_torque(model, model.measured + noise))
    assert prepared.fit.noise.source == "periods"
    assert prepared.fit.noise.period_s == pytest.approx(4.0)
    assert prepared.fit.noise.periods == 3
    assert prepared.fit.noise.deviation == pytest.approx([0.1], rel=0.1)
    assert prepared.fit.noise.correlation == pytest.approx([0.5], abs=0.1)
    assert not prepared.notes


def test_samples_that_are_missing_are_left_out_of_the_noise(tmp_path: Path) -> None:
    """Periods are compared where both have a sample; taken one after the other the rows would no longer match."""
    model = arm_model(tmp_path, seconds=12.0)
    noise = coloured(np.random.default_rng(5), model.measured.shape, 0.5, 0.1)
    whole = data(with_torque(model, model.measured + noise))
    kept = np.delete(np.arange(whole.time.size), [150, 151, 420, 700, 701, 702])
    reference = whole.reference.time
    operator = sample_operator(
        whole.time[kept], start=float(reference[0]), step=float(reference[1] - reference[0]), tick_count=reference.size
    )
    less = replace(whole, time=whole.time[kept], torque=whole.torque[kept], operator=operator)
    assert less.rate_hz == pytest.approx(whole.rate_hz)
    lacking = model.with_experiment(model.first, less)
    prepared = prepare(lacking)
    everything = prepare(model.with_experiment(model.first, whole)).fit.noise
    assert prepared.fit.noise.source == "periods"
    assert prepared.fit.noise.period_s == pytest.approx(4.0)
    assert prepared.fit.noise.deviation == pytest.approx(everything.deviation, rel=0.03)
    assert prepared.fit.noise.correlation == pytest.approx(everything.correlation, abs=0.03)
    assert prepared.fit.noise.slow == pytest.approx(everything.slow, abs=0.03)
    (told,) = data_diagnostics(lacking, causes=False)
    assert "6 of 1200 torque samples are missing, the first of them after t = 1.49 s" in str(told)


def test_exact_repetition_with_a_gap_gives_finite_weights() -> None:
    torque = repeating()
    torque[700] = np.nan
    noise = noise_from_periods(torque, SAMPLES, rate_hz=100.0, skip=50)
    assert noise is not None
    assert (noise.deviation >= 1e-9 * np.sqrt(np.nanmean(torque**2, axis=0))).all()


def test_prepared_without_repetition_says_so(tmp_path: Path) -> None:
    model = arm_model(tmp_path, seconds=5.0)
    noise = coloured(np.random.default_rng(6), model.measured.shape, 0.0, 0.1)
    prepared = prepare(with_torque(model, model.measured + noise))
    assert prepared.fit.noise.source == "residual"
    assert 0.08 < prepared.fit.noise.deviation[0] < 0.15
    assert any("does not repeat" in note for note in prepared.notes)


def test_too_few_samples_are_refused(tmp_path: Path) -> None:
    model = arm_model(tmp_path, seconds=2.0, rate_hz=10.0)
    with pytest.raises(InputError, match="too short") as caught:
        prepare(model)
    assert "20 samples of each joint for 5 parameters" in str(caught.value)


def test_friction_columns_follow_the_reference(tmp_path: Path) -> None:
    model = arm_model(tmp_path, seconds=5.0)
    columns = friction_columns(data(model))
    speed = data(model).reference.select(["dq1"])[::2, 0]
    assert columns.shape == (500, 1, 3)
    assert columns[:, 0, 0] == pytest.approx(speed, abs=1e-9)
    assert (np.sign(columns[:, 0, 1]) == np.sign(speed)).all()
