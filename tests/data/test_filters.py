"""Filters, power density and products of signals, against those of SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage, signal

from fmu_didim.base.errors import InputError
from fmu_didim.data import filters
from fmu_didim.data.filters import LowPass, band_limited, running_maximum, running_median, thinned
from fmu_didim.data.spectrum import lagged_products, power_density

VALUES = np.random.default_rng(2).normal(size=777)


@pytest.mark.parametrize("width", [1, 5, 21])
@pytest.mark.parametrize("at_once", [100, 100_000])
def test_running_median_and_maximum(width: int, at_once: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(filters, "AT_ONCE", at_once)
    expected = ndimage.median_filter(VALUES, width, mode="nearest")
    np.testing.assert_array_equal(running_median(VALUES, width), expected)
    np.testing.assert_array_equal(running_median(VALUES, width, outside=0.0), signal.medfilt(VALUES, width))
    np.testing.assert_array_equal(running_maximum(VALUES, width), ndimage.maximum_filter1d(VALUES, width))


def test_low_pass_and_thinning_out() -> None:
    table = VALUES[:700].reshape(350, 2)
    sections = signal.butter(4, 10.0, fs=100.0, output="sos")
    np.testing.assert_array_equal(LowPass(10.0).apply(table, 100.0), signal.sosfiltfilt(sections, table, axis=0))
    with pytest.raises(InputError, match="below half the torque rate"):
        LowPass(10.0).apply(table, 20.0)
    slow, fast = np.sin(np.linspace(0, 6, 601)), np.sin(2.5 * np.arange(601))
    ripple = 1 - 10 ** (-2 * 0.05 / 20)  # 0.05 dB, there and back
    found = thinned(slow + fast, 4)
    np.testing.assert_allclose(found[20:-20], slow[::4][20:-20], atol=ripple + 0.001)  # and 0.1 % of the fast one


@pytest.mark.parametrize("segment", [32, 101, 256, 777])
@pytest.mark.parametrize("median", [False, True])
def test_power_density_is_that_of_welch(segment: int, median: bool) -> None:
    frequency, power = power_density(VALUES, 50.0, segment, median=median)
    average = "median" if median else "mean"
    expected = signal.welch(VALUES, fs=50.0, nperseg=segment, average=average)
    np.testing.assert_allclose(frequency, expected[0], rtol=1e-12)
    np.testing.assert_allclose(power, expected[1], rtol=1e-9, atol=1e-15)


def test_lagged_products_are_sums_of_products() -> None:
    a, b = VALUES[:50], VALUES[100:170]
    lags = np.arange(-69, 50)
    expected = [sum(a[t] * b[t - lag] for t in range(50) if 0 <= t - lag < 70) for lag in lags]
    np.testing.assert_allclose(lagged_products(a, b, lags), expected, atol=1e-12)


def test_band_limited_samples_of_white_noise_are_white() -> None:
    """To a hundredth, and a constant stays what it is: 20 samples a second of 200, with nothing above 15 Hz."""
    weights, middle = band_limited(200.0, 4000, 15.0)
    spacing = np.diff(middle)
    assert (spacing == 10).all() and middle[0] == 40
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, rtol=1e-12)
    covariance = (weights @ weights.T).toarray()
    row = covariance[200] / covariance[200, 200]
    assert np.abs(np.delete(row, 200)).max() < 0.01


@pytest.mark.parametrize(("frequency_hz", "least", "most"), [(4.0, 0.98, 1.02), (16.0, 0.0, 0.02), (60.0, 0.0, 0.01)])
def test_nothing_above_the_cut_off_is_left(frequency_hz: float, least: float, most: float) -> None:
    weights, middle = band_limited(200.0, 4000, 15.0)
    wave = np.sqrt(2) * np.sin(2 * np.pi * frequency_hz * np.arange(4000) / 200 + 0.3)
    assert least <= np.sqrt(np.mean((weights @ wave) ** 2)) <= most
    if least > 0:
        np.testing.assert_allclose(weights @ wave, wave[middle], atol=0.03)


@pytest.mark.parametrize(("cutoff_hz", "order"), [(8.0, 4), (20.0, 2), (45.0, 4)])
def test_share_of_noise_that_a_low_pass_leaves_is_that_of_drawn_noise(cutoff_hz: float, order: int) -> None:
    one = LowPass(cutoff_hz, order)
    drawn = one.apply(np.random.default_rng(1).normal(size=(200_000, 1)), 100.0)
    assert one.noise_share(100.0) == pytest.approx(float(np.var(drawn)), rel=0.03)
