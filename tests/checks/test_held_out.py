"""Whether a larger residual where experiments were held out is noise or a fault of the values."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.signal import lfilter

from fmu_didim.checks.held_out import Residual, held_out_diagnostics
from fmu_didim.fit.derivatives.sensitivity import sensitivity
from fmu_didim.fit.statistics import covariance_white
from fmu_didim.model.loop_model import LoopModel
from tests.checks.data.right import loaded, logged, motion

RATE_HZ, NOISE = 50.0, 0.01
"""Samples a second; standard deviation of the noise of the fitted log, of that of the torque."""
RNG = np.random.default_rng


@cache
def run(robot: str, rate_hz: float = RATE_HZ) -> tuple[LoopModel, dict[str, np.ndarray], np.ndarray]:
    """The loop with the true values, its torque by label, and the covariance of values that were fitted to it."""
    model = loaded(robot)
    for label in model.experiments:
        model = logged(model, label, motion(robot, 1, label), rate_hz)
    torque = {label: model.torque(model.start, label) for label in model.experiments}
    for label, own in torque.items():
        model = model.with_experiment(label, replace(model.experiments[label], torque=own))
    alone = model.on("estimation")
    columns = (
        sensitivity(alone, alone.start, torque["estimation"]) / (NOISE * torque["estimation"].std(axis=0))[:, None]
    )
    return model, torque, covariance_white(columns.reshape(-1, columns.shape[2]))


def codes(robot: str, seed: int, held: np.ndarray, rate_hz: float = RATE_HZ) -> list[str]:
    """Codes where the held-out residual is this, in units of the torque of each joint."""
    model, torque, covariance = run(robot, rate_hz)

    def of(label, errors):
        own = torque[label]
        return Residual.of(own + own.std(axis=0) * errors, own)

    fitted = of("estimation", NOISE * RNG(seed).normal(size=torque["estimation"].shape))
    found = held_out_diagnostics(model, covariance, fitted, {"validation": of("validation", held)}, {})
    return [d.code.name for d in found]


def noise(robot: str, seed: int, size: float, rate_hz: float = RATE_HZ) -> np.ndarray:
    return size * NOISE * RNG([seed, 1]).normal(size=run(robot, rate_hz)[1]["validation"].shape)


@pytest.mark.parametrize("robot", ["scara", "arm"])
@pytest.mark.parametrize("size", [3.0, 6.0])
def test_a_noisier_log_is_a_remark(robot, size):
    found = [codes(robot, seed, noise(robot, seed, size)) for seed in range(8)]
    assert found == [["held-out-noisier"] * 2] * 8
    assert codes(robot, 0, noise(robot, 0, 1.0)) == []


def other_values(robot, factor, name):
    """What is left where values of this name are others in the held-out experiment."""
    model, torque, _ = run(robot)
    scale = [factor if one.startswith(name) else 1.0 for one in model.names]
    return (model.torque(model.start * scale, "validation") - torque["validation"]) / torque["validation"].std(axis=0)


@pytest.mark.parametrize("robot", ["scara", "arm"])
@pytest.mark.parametrize(("name", "factor"), [("ZZ", 1.1), ("Fc", 1.3), ("Fv", 1.3)])
@pytest.mark.parametrize("size", [1.0, 2.0])
def test_values_that_are_others_are_doubted_also_in_a_noisier_log(robot, name, factor, size):
    for seed in range(4):
        found = codes(robot, seed, noise(robot, seed, size) + other_values(robot, factor, name))
        assert "worse-on-held-out" in found


def test_noise_with_a_colour_is_doubted():
    """It may be anything slow."""
    white = RNG(3).normal(size=(700, 2))
    slow = lfilter([1.0], [1.0, -0.8], white, axis=0)[-500:]
    assert codes("scara", 0, 2 * NOISE * slow) == ["worse-on-held-out"] * 2


def test_of_few_samples_nothing_shows_that_it_is_noise():
    assert codes("scara", 0, noise("scara", 0, 3.0, 10.0), 10.0) == ["worse-on-held-out"] * 2


def test_the_remark_says_what_was_asked():
    model, torque, covariance = run("scara")
    own, fitted = torque["validation"], torque["estimation"]
    (one, _) = held_out_diagnostics(
        model, covariance,
        Residual.of(fitted + NOISE * fitted.std(axis=0) * RNG(0).normal(size=fitted.shape), fitted),
        {"validation": Residual.of(own + own.std(axis=0) * noise("scara", 0, 2.0), own)}, {},
    )  # fmt: skip
    assert one.place == "validation: joint 1"
    assert one.value == pytest.approx(2.0, rel=0.15)
    assert "white, and follows neither the motion nor the values" in one.text
