"""The gap in units of the noise, and the two gates: information criterion and held-out ratio."""

from __future__ import annotations

import numpy as np
import pytest

from fmu_didim.fit.gap import delta_bic, explained, joint_gaps, rms_ratio, total_gap
from fmu_didim.fit.noise.noise import effective_fraction
from tests.discovery.helpers import coloured, known_noise

SIGMA = np.array([0.3, 0.02])
COUNT = 2000


def model_error(sizes: np.ndarray, count: int = COUNT) -> np.ndarray:
    """(N, n) of these RMS values exactly, slow as the error of a model is."""
    time = np.arange(count)[:, None] / 100
    values = np.sin(2 * np.pi * 0.35 * time + np.arange(sizes.size)) + 0.5 * np.sin(2 * np.pi * 1.1 * time)
    return np.asarray(values / np.sqrt(np.mean(values**2, axis=0)) * sizes)


# ---- gap -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rho", [0.0, 0.6])
@pytest.mark.parametrize("gap", [0.5, 1.0, 3.0])
def test_known_model_error_is_the_gap(gap: float, rho: float) -> None:
    found, totals = [], []
    for seed in range(20):
        noise = coloured(np.random.default_rng(seed), (COUNT, 2), rho, SIGMA)
        residual = noise + model_error(SIGMA * np.array([gap, 2 * gap]))
        found.append(joint_gaps(residual, known_noise(SIGMA, rho)))
        totals.append(total_gap(residual, known_noise(SIGMA, rho)))
    assert np.mean(found, axis=0) == pytest.approx([gap, 2 * gap], rel=0.05)
    assert np.mean(totals) == pytest.approx(gap * np.sqrt(2.5), rel=0.05)


def test_noise_alone_has_no_gap() -> None:
    gaps = [
        joint_gaps(coloured(np.random.default_rng(seed), (COUNT, 2), 0.5, SIGMA), known_noise(SIGMA, 0.5))
        for seed in range(50)
    ]
    # The variance of so many coloured samples is known to 4 %: a gap of a third is seven of these.
    assert np.max(gaps) < 0.45
    assert np.mean(np.square(gaps)) < 0.03
    assert joint_gaps(0.5 * SIGMA * np.ones((10, 2)), known_noise(SIGMA)) == pytest.approx([0, 0])
    assert total_gap(0.5 * SIGMA * np.ones((10, 2)), known_noise(SIGMA)) == 0


# ---- colour ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("rho", [0.0, 0.3, 0.7, 0.9])
def test_effective_part_of_coloured_samples(rho: float) -> None:
    found = [effective_fraction(coloured(np.random.default_rng(seed), (COUNT, 2), rho, SIGMA)) for seed in range(200)]
    # The mean of 200 scatters by up to 0.8 %, and is 2.6 % too large at most.
    assert np.mean(found, axis=0) == pytest.approx((1 - rho) / (1 + rho), rel=0.06)


def test_effective_samples_give_the_variance_of_a_mean() -> None:
    """What f is for: the mean of N coloured samples varies as that of N f independent ones."""
    rho = 0.8
    means = [coloured(np.random.default_rng(seed), (COUNT, 1), rho).mean() for seed in range(2000)]
    assert np.var(means) * COUNT * (1 - rho) / (1 + rho) == pytest.approx(1, rel=0.1)


def test_colour_stays_between_its_limits() -> None:
    alternating = (-1.0) ** np.arange(100)[:, None]
    ramp = np.arange(5000.0)[:, None]
    assert effective_fraction(alternating) == pytest.approx(1)
    assert 0.01 <= effective_fraction(ramp)[0] < 0.02
    assert np.isfinite(effective_fraction(np.zeros((100, 1)))).all()


# ---- information criterion -------------------------------------------------------------------------


def fitted(residual: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """What least squares leaves, each joint with its own coefficients."""
    left = residual.copy()
    for j in range(residual.shape[1]):
        left[:, j] -= columns @ np.linalg.lstsq(columns, residual[:, j], rcond=None)[0]
    return left


def gains(amplitude: float, rho: float, seeds: range, *, margin: float = 0.0) -> list[float]:
    """Gain by one column at one joint, of amplitude times sigma in the truth."""
    column = model_error(np.ones(1))
    result = []
    for seed in seeds:
        before = amplitude * column + coloured(np.random.default_rng(seed), (COUNT, 1), rho)
        result.append(delta_bic(before, fitted(before, column), 1.0, known_noise(1.0, rho)) - margin)
    return result


@pytest.mark.parametrize("rho", [0.0, 0.4, 0.8])
def test_useless_column_is_not_preferred(rho: float) -> None:
    """A parameter too many is taken in 2 % of the cases at most by BIC alone, hardly ever by the threshold of ten."""
    found = np.array(gains(0.0, rho, range(1200)))
    assert np.mean(found > 0) <= 0.036  # four standard deviations of such a share above 2 %
    assert np.mean(found > 10) < 0.003


@pytest.mark.parametrize("rho", [0.0, 0.4, 0.8])
def test_true_column_is_preferred(rho: float) -> None:
    """Seven times its own standard deviation, which is that of N f samples."""
    amplitude = 7 / np.sqrt(COUNT * (1 - rho) / (1 + rho))
    found = np.array(gains(amplitude, rho, range(100)))
    assert np.mean(found > 10) >= 0.95
    assert np.median(found) == pytest.approx(49 - np.log(COUNT * (1 - rho) / (1 + rho)), rel=0.15)


def test_every_parameter_costs() -> None:
    noise = coloured(np.random.default_rng(0), (COUNT, 2), 0.0, SIGMA)
    count = float((COUNT * effective_fraction(noise)).sum())
    for cost in (1.0, 4.0):
        assert delta_bic(noise, noise, cost, known_noise(SIGMA)) == pytest.approx(-cost * np.log(count))


def test_improvement_far_below_the_noise_is_worth_nothing() -> None:
    """A residual that is smaller than the noise (overfitted, or a noise-free log) does not grow in worth for ever."""
    small = coloured(np.random.default_rng(0), (COUNT, 1), 0.0, 1e-3)
    assert delta_bic(small, 1e-3 * small, 1.0, known_noise(1.0)) < 0


# ---- held-out ratio --------------------------------------------------------------------------------


@pytest.mark.gate
@pytest.mark.parametrize("rho", [0.0, 0.5, 0.8])
@pytest.mark.parametrize("size", [0.3, 1.0])
def test_interval_of_the_ratio_covers_the_truth(size: float, rho: float) -> None:
    """Blocks of half a second at 100 Hz; the truth is sqrt(1 / (1 + size^2)) with the same noise in both."""
    hits, error = 0, model_error(np.array([size]))
    for seed in range(100):
        after = coloured(np.random.default_rng(seed), (COUNT, 1), rho)
        ratio = rms_ratio(after + error, after, known_noise(1.0, rho), block=50, seed=seed)
        assert ratio.low <= ratio.value <= ratio.high
        hits += ratio.low <= 1 / np.sqrt(1 + size**2) <= ratio.high
    assert hits >= 90


@pytest.mark.gate
def test_no_improvement_is_rarely_called_one() -> None:
    """A model error of other sign is no better: the interval lies below 1 in 3 of 100, counted over 400 draws."""
    error = model_error(np.array([0.2]))
    below = 0
    for seed in range(400):
        noise = coloured(np.random.default_rng(seed), (COUNT, 1), 0.5)
        below += rms_ratio(noise + error, noise - error, known_noise(1.0), block=50, seed=seed).high < 1
    assert below / 400 <= 0.065  # four standard deviations of such a share


def test_ratio_is_weighted_and_reproducible() -> None:
    """Each joint counts in units of its noise; the same seed gives the same interval."""
    first = coloured(np.random.default_rng(0), (COUNT, 2), 0.0, SIGMA)
    halved = first * [1.0, 0.5]
    ratio = rms_ratio(first, halved, known_noise(SIGMA), block=50)
    assert ratio.value == pytest.approx(np.sqrt(0.625), abs=0.02)
    assert ratio == rms_ratio(first, halved, known_noise(SIGMA), block=50)
    assert rms_ratio(first, first, known_noise(SIGMA), block=50).value == 1
    assert rms_ratio(first, first, known_noise(SIGMA), block=10 * COUNT).high == 1, "one block longer than the log"


# ---- share explained -------------------------------------------------------------------------------


def test_explained_in_units_of_the_noise_and_as_a_share() -> None:
    noise = known_noise(SIGMA)
    clean = coloured(np.random.default_rng(0), (50_000, 2), 0.0, SIGMA)
    large = model_error(SIGMA * [2.0, 0.0], 50_000)
    small = np.roll(model_error(SIGMA * [0.0, 1.0], 50_000), 777, axis=0)
    size, share = explained(clean + large + small, clean + small, noise)
    assert size == pytest.approx(2.0, rel=0.02)
    assert share == pytest.approx(0.8, abs=0.02)
    size, share = explained(clean + large + small, clean, noise)
    assert size == pytest.approx(2.0, rel=0.02), "of the joint where it explains most"
    assert share == pytest.approx(1.0, abs=0.02)


def test_nothing_explained() -> None:
    noise = known_noise(SIGMA)
    residual = model_error(SIGMA)
    assert explained(residual, residual, noise) == (0.0, 0.0)
    worse = explained(residual, 2 * residual, noise)
    assert worse[0] == 0
    assert worse[1] == 0
    assert explained(0.1 * residual, 0.05 * residual, noise)[1] == 0, "below the noise there is no gap to share"
