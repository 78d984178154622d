"""What is told of a residual: larger or smaller than the noise, or with a colour."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from fmu_didim.base.diagnostics import Severity
from fmu_didim.checks.residual import (
    NoiseResult,
    lack_of_fit,
    large_diagnostics,
    residual_diagnostics,
    slow_diagnostics,
)
from fmu_didim.data.filters import LowPass
from fmu_didim.fit.log_noise import known_noise
from fmu_didim.fit.uncertainty import Colour
from tests.checks.data.right import right

WHITE = Colour(1, 50.0, 4.0, 4.0, np.zeros(0), 0.02, 0.4, 500.0)
COLOURED = replace(WHITE, coefficients=np.array([0.6, 0.1]), lag_one=0.63, whiteness=0.2, inflation=2.5)


def test_a_test_of_each_joint_against_the_known_noise() -> None:
    second = replace(COLOURED, joint=2, residual_variance=9.0, samples=100.0)
    first, other = lack_of_fit([WHITE, second], np.array([2.0, 1.5]))
    assert first.chi_square_per_sample == pytest.approx(1.0)
    assert other.chi_square_per_sample == pytest.approx(4.0)
    assert other.chi_square_bound == pytest.approx(stats.chi2.ppf(0.999, 100) / 100)
    assert other.chi_square_least == pytest.approx(stats.chi2.ppf(0.001, 100) / 100)
    assert (other.joint, other.rate_hz, other.lag1, other.whiteness_p, other.inflation) == (2, 50.0, 0.63, 0.2, 2.5)
    assert (other.order, list(other.coefficients)) == (2, [0.6, 0.1])
    assert [test.order for test in (first, other)] == [0, 2]
    assert not first.exceeds_noise and other.exceeds_noise


def test_without_known_noise_no_chi_square() -> None:
    (test,) = lack_of_fit([WHITE], None)
    assert (test.chi_square_per_sample, test.chi_square_bound, test.chi_square_least) == (None, None, None)
    assert not test.exceeds_noise and not test.is_below_noise


@pytest.mark.parametrize(
    ("colour", "known", "codes"),
    [
        (WHITE, None, []),
        (WHITE, 2.0, []),
        (WHITE, 1.0, ["residual-above-noise"]),
        (WHITE, 4.0, ["stated-noise-large"]),
        (COLOURED, None, ["noise-coloured"]),
        (COLOURED, 1.0, ["residual-above-noise", "noise-coloured"]),
        (replace(COLOURED, whiteness=0.9e-4), None, ["noise-coloured", "colour-not-modelled"]),
        (replace(WHITE, whiteness=0.9e-4), None, ["colour-not-modelled"]),
        (replace(WHITE, whiteness=1.1e-4), None, []),
        (replace(WHITE, is_louder=True, inflation=1.3), None, ["noise-louder"]),
        (replace(WHITE, is_louder=True, inflation=1.11), None, ["noise-louder"]),
        (replace(WHITE, is_louder=True, inflation=0.89), None, ["noise-louder"]),
        (replace(WHITE, is_louder=True, inflation=1.09), None, []),  # "some 1 times" says nothing
        (replace(WHITE, is_louder=True, inflation=0.97), None, []),
    ],
    ids=[
        "unknown",
        "as the noise",
        "above",
        "below",
        "coloured",
        "coloured, above",
        "not modelled",
        "no colour seen",
        "by chance",
        "louder in places",
        "just louder",
        "just less",
        "louder by too little",
        "less by too little",
    ],
)
def test_what_is_told(colour: Colour, known: float | None, codes: list[str]) -> None:
    tests = lack_of_fit([colour], None if known is None else np.array([known]))
    found = residual_diagnostics(tests)
    assert [diagnostic.code.name for diagnostic in found] == codes
    assert all(diagnostic.place == "joint 1" for diagnostic in found)
    assert {d.code.name for d in found if d.code.severity is Severity.DOUBT} <= {"residual-above-noise"}


def test_noise_of_periods_is_known_from_a_part_of_the_samples() -> None:
    stated, periods = (lack_of_fit([WHITE], np.array([2.0]), stated=stated)[0] for stated in (True, False))
    assert periods.chi_square_bound == pytest.approx(stats.f.isf(0.001, 500, 500 / 3))
    assert periods.chi_square_bound > stated.chi_square_bound
    # That a residual is smaller than the differences of periods is no fault of the case.
    assert residual_diagnostics(lack_of_fit([WHITE], np.array([4.0]), stated=False)) == []


def test_rates_are_named_where_there_are_several() -> None:
    found = residual_diagnostics(lack_of_fit([COLOURED, replace(COLOURED, rate_hz=20.0)], None))
    assert [diagnostic.place for diagnostic in found] == ["joint 1, logs at 50 Hz", "joint 1, logs at 20 Hz"]


def test_figures_are_in_the_sentence() -> None:
    bounds = dict(chi_square_per_sample=7.8, chi_square_bound=1.2, chi_square_least=0.8)
    (above,) = residual_diagnostics([coloured(50.0, memory_s=1.0, order=0).model_copy(update={"joint": 3, **bounds})])
    assert str(above).startswith("joint 3: the residual is larger than the known noise (chi-square per sample 7.8,")
    assert (above.value, above.bound) == (7.8, 1.2)
    assert "discover" in above.advice


def coloured(rate_hz: float, *, memory_s: float, order: int = 1) -> NoiseResult:
    """A residual whose noise is a first-order autoregression."""
    coefficients = np.full(order, np.exp(-1 / (rate_hz * memory_s)))
    return NoiseResult(
        joint=1, rate_hz=rate_hz, chi_square_per_sample=None, chi_square_bound=None, chi_square_least=None,
        noise_is_stated=False, lag1=0.9, order=order, coefficients=coefficients.tolist(), whiteness_p=0.5,
        inflation=2.0,
    )  # fmt: skip


ABOVE_NOISE = {"chi_square_per_sample": 9.0, "chi_square_bound": 1.2}


@pytest.mark.parametrize(
    ("test", "motion_hz", "cutoff_hz", "told"),
    [
        (coloured(200, memory_s=0.05), 0.5, np.inf, False),  # noise of a current sensor
        (coloured(200, memory_s=0.05), 1.25, np.inf, False),
        (coloured(200, memory_s=0.05), 0.5, 4.0, False),  # and a low-pass of the torque
        (coloured(100, memory_s=2.0), 1.0, np.inf, True),  # 94 % below 1 Hz
        (coloured(100, memory_s=2.0), 1.0, 1.5, False),  # nothing is left to compare with
        (coloured(4, memory_s=2.0), 1.25, np.inf, False),  # the motion fills the band
        (coloured(100, memory_s=2.0, order=0), 1.0, np.inf, False),  # white
        (coloured(100, memory_s=2.0).model_copy(update=ABOVE_NOISE), 1.0, np.inf, False),
    ],
)
def test_a_residual_that_is_as_slow_as_the_motion(
    test: NoiseResult, motion_hz: float, cutoff_hz: float, told: bool
) -> None:
    found = slow_diagnostics([test], motion_hz, cutoff_hz)
    assert [d.code.name for d in found] == (["residual-slow"] if told else [])
    if told:  # power of the autoregression below f: 2/pi atan(2 pi f memory)
        assert found[0].value == pytest.approx(2 / np.pi * np.arctan(2 * np.pi * motion_hz * 2.0), abs=0.01)


def test_logs_of_several_rates_tell_a_slow_residual_of_a_joint_once() -> None:
    less, more = (
        lack_of_fit([replace(COLOURED, coefficients=np.array([memory]))], None)[0] for memory in (0.985, 0.99)
    )
    (found,) = slow_diagnostics([less, more, less], 1.0)
    assert slow_diagnostics([less], 1.0) and found == slow_diagnostics([more], 1.0)[0]


@pytest.mark.gate
def test_the_noise_by_periods_is_that_of_the_log_whatever_it_is_filtered_with() -> None:
    """The residual that it is compared with is that of the log, too."""
    model = right("puma560", 1, rate_hz=20.0)
    plain, filtered = known_noise(model), known_noise(model.with_low_pass(LowPass(4.0)))
    assert plain is not None and filtered is not None
    np.testing.assert_array_equal(plain, filtered)


@pytest.mark.parametrize(
    ("coefficients", "error", "told"),
    [
        ([0.9], 0.2, True),
        ([0.9], 0.1, False),
        ([0.9], 0.02, False),
        ([], 0.5, False),
        ([0.3], 0.5, False),
        ([-0.9], 0.5, False),
        ([1.2, -0.95], 0.5, False),
    ],
    ids=["slow and large", "hardly a tenth", "slow", "white", "nearly white", "fast", "a hum of 8 Hz"],
)
def test_a_large_residual_need_not_be_as_slow_as_the_motion(
    coefficients: list[float], error: float, told: bool
) -> None:
    """At 50 Hz, beside a motion of 0.6 Hz: what lies below 2.4 Hz counts."""
    (test,) = lack_of_fit([replace(COLOURED, coefficients=np.array(coefficients))], None)
    assert slow_diagnostics([test], 0.6) == []
    found = large_diagnostics([test], {1: error}, 0.6)
    assert [(d.code.name, d.place) for d in found] == [("residual-slow", "joint 1")] * told
    assert all("% of the torque" in d.text for d in found)
    assert large_diagnostics([test], {1: error}, 20.0) == [], "too little lies above the motion"
