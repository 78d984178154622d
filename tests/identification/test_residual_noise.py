"""Noise with a colour, and noise that was stated wrongly, from the log to the saved result."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmu_didim import identify, load_case, load_result
from fmu_didim.checks.identification import residual_tests
from fmu_didim.checks.residual import residual_diagnostics
from fmu_didim.estimators import Clie, Didim, Estimator
from fmu_didim.fit.estimate import Estimate
from tests.helpers import with_torque
from tests.tools.monte_carlo import context, half_coloured

CASE = Path("examples/scara/identify_200hz.yaml")
RATE_HZ = 50


@cache
def estimate(
    estimator: Estimator, *, coloured: bool, equal: bool = False, stated: float | None = None, seed: int = 5
) -> Estimate:
    """SCARA, torque at 50 Hz with noise of 5 %."""
    here, rng = context(RATE_HZ), np.random.default_rng(seed)
    size = here.torque.shape
    noise = half_coloured(rng, size, RATE_HZ) if coloured else rng.normal(size=size)
    model = with_torque(here.model, here.torque + here.noise * noise)
    if equal:
        model = replace(model, joint_weights="equal")
    if stated is not None:
        model = replace(model, torque_deviation=stated * here.noise)
    return estimator.estimate(model)


def codes(found: Estimate) -> list[str]:
    return [diagnostic.code.name for diagnostic in residual_diagnostics(residual_tests(found))]


each_estimator = pytest.mark.parametrize(
    "estimator", [Didim(), Didim(finish=False), Clie()], ids=["didim", "didim without finish", "clie"]
)


@each_estimator
def test_each_estimator_counts_the_colour(estimator: Estimator) -> None:
    found, white = (estimate(estimator, coloured=coloured) for coloured in (True, False))
    assert [colour.coefficients.size > 0 for colour in found.colours] == [True, True]
    assert [colour.coefficients.size for colour in white.colours] == [0, 0]
    # Dense algebra with the noise as it is gives 1.6 to 1.8, by parameter.
    assert (found.standard_deviation > 1.3 * white.standard_deviation).all()
    assert (found.standard_deviation < 2.3 * white.standard_deviation).all()
    assert found.freedom < 0.6 * white.freedom
    assert codes(found) == ["noise-coloured"] * 2
    assert codes(white) == []
    for stage in found.stages.values():
        assert (stage.standard_deviation > 1.2 * white.standard_deviation).all()


@pytest.mark.gate
@each_estimator
def test_deviations_that_count_the_colour_are_those_of_the_errors(estimator: Estimator) -> None:
    """24 draws of 8 parameters: root mean square 1 if right; about 1.7 if the colour did not count."""
    found = [estimate(estimator, coloured=True, seed=seed) for seed in range(100, 124)]
    errors = np.array([(f.value - context(RATE_HZ).truth) / f.standard_deviation for f in found])
    assert 0.7 < np.sqrt(np.mean(errors**2)) < 1.4
    assert np.mean(np.abs(errors) < 2) > 0.8


ESTIMATED = 4 / np.sqrt(2 * 500)
"""Four standard deviations of a deviation estimated from the 500 samples of a joint, relative."""


@pytest.mark.gate
def test_equal_weights_are_worse_and_say_so() -> None:
    """What the second joint, 26 times quieter, knows best is decided by the first one's noise; over 12 draws."""
    found = [estimate(Didim(), coloured=False, equal=True, seed=seed) for seed in range(200, 212)]
    weighted = estimate(Didim(), coloured=False)
    errors = np.array([(f.value - context(RATE_HZ).truth) / f.standard_deviation for f in found])
    assert 0.6 < np.sqrt(np.mean(errors**2)) < 1.4
    deviation = np.median([f.standard_deviation for f in found], axis=0)
    for name in ("ZZ2", "MX2", "MY2"):
        k = weighted.names.index(name)
        assert deviation[k] > 3 * weighted.standard_deviation[k]
    noise = np.array([[np.sqrt(c.variance) for c in f.colours] for f in found]) / context(RATE_HZ).noise
    # The second joint's residual also holds what the first one's noise does to the parameters: 1.2 to 1.35 by 12 draws.
    assert np.median(noise, axis=0).min() > 0.95 and np.median(noise, axis=0).max() < 1.5


@pytest.mark.parametrize(("stated", "told"), [(1.0, None), (0.5, "residual-above-noise"), (2.0, "stated-noise-large")])
def test_noise_that_was_stated_wrongly_is_told(stated: float, told: str | None) -> None:
    found, right = estimate(Didim(), coloured=False, stated=stated), estimate(Didim(), coloured=False)
    assert codes(found) == ([told] * 2 if told else [])
    # What is stated too small does not make the deviations smaller; what is stated too large makes them larger.
    np.testing.assert_allclose(found.standard_deviation, max(stated, 1.0) * right.standard_deviation, rtol=ESTIMATED)


@pytest.mark.gate
@pytest.mark.parametrize("wrong", [{"train": {"torque": {"log_shift_s": 0.005}}}, {"loop": {"delay_samples": 1}}])
def test_deviations_contain_what_a_wrong_model_leaves(wrong: dict[str, Any]) -> None:
    """The clock of the log 5 ms late, or a missing sample of delay, with known noise of 1 %: told, and the truth, which
    the noise alone puts more than ten deviations away, is not far outside."""
    right = context(RATE_HZ).model
    case = load_case(CASE).with_(train={"torque": {"rate_hz": RATE_HZ}}).with_(**wrong)
    assert case.model is not None
    torque = case.model.torque(case.model.start)[: right.measured.shape[0]]
    sigma = 0.01 * np.sqrt((torque**2).mean(axis=0))
    measured = torque + sigma * np.random.default_rng(1).normal(size=torque.shape)
    found = Didim().estimate(replace(with_torque(right, measured), torque_deviation=sigma))
    assert codes(found).count("residual-above-noise") == 2
    error = np.abs(found.base_value - context(RATE_HZ).truth)  # a command that comes late may look like another start
    assert (error / found.stages["didim"].formulas["cramer_rao"]).max() > 10
    assert (error / found.standard_deviation[: error.size]).max() < 5


@pytest.mark.gate
def test_the_result_says_it(tmp_path: Path) -> None:
    case = load_case(CASE).with_(train={"torque": {"rate_hz": RATE_HZ}}, torque_std=[0.05, 0.002])
    outcome = identify(case, tmp_path)
    document = load_result(tmp_path).document
    assert [(noise.joint, noise.rate_hz, noise.order) for noise in document.noise] == [(1, 50.0, 0), (2, 50.0, 0)]
    for noise, residual, stated in zip(document.noise, context(RATE_HZ).noise, (0.05, 0.002), strict=True):
        assert noise.chi_square_per_sample == pytest.approx((residual / stated) ** 2, rel=0.15)
        assert noise.chi_square_per_sample > noise.chi_square_bound > 1 > noise.chi_square_least
        assert noise.inflation == pytest.approx(residual / stated, rel=0.08)
    assert "chi-square per sample" in outcome.summary()
    assert "contain this lack of fit" in outcome.summary().replace("\n    ", " ")


@pytest.mark.gate
@pytest.mark.parametrize("rate_hz", [100.0, 10.0])
def test_the_misfit_of_a_real_robot_is_no_noise_that_is_louder_in_places(rate_hz: float) -> None:
    """Its friction grows with the load: where the torque is large the model is wrong."""
    case = load_case("examples/double_pendulum/identify.yaml").with_(train={"torque": {"rate_hz": rate_hz}})
    found = Didim(start="torque").estimate(case.model)
    assert [colour.is_louder for colour in found.colours] == [False, False]
    assert all(colour.coefficients.size for colour in found.colours)


@pytest.mark.gate
def test_intervals_hold_where_noise_grows_with_the_torque() -> None:
    """SCARA at 50 Hz; some 88 % of the values lay in intervals by noise that is as loud everywhere."""
    here, inside, louder = context(RATE_HZ), [], 0
    for seed in range(20):
        rng = np.random.default_rng([seed, 31])
        noise = 0.05 * np.abs(here.torque) * rng.normal(size=here.torque.shape)
        found = Didim().estimate(with_torque(here.model, here.torque + noise))
        low, high = found.interval().T
        inside += list((low <= here.model.start) & (here.model.start <= high))
        louder += any(code == "noise-louder" for code in codes(found))
    assert np.mean(inside) > 0.91
    assert louder >= 18
