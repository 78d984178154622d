"""Whether a larger residual where experiments were held out is noise or a fault of the values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.signal import lfilter

from fmu_didim.checks.data.checks import data_diagnostics
from fmu_didim.checks.held_out import Residual, held_out_diagnostics
from fmu_didim.checks.identification import checked
from fmu_didim.checks.validation import validated
from fmu_didim.estimators import Didim
from fmu_didim.fit.derivatives.sensitivity import sensitivity
from fmu_didim.fit.statistics import covariance_white
from fmu_didim.fit.uncertainty import Colour
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


def codes(
    robot: str, seed: int, held: np.ndarray, rate_hz: float = RATE_HZ, colours: Sequence[Colour] = ()
) -> list[str]:
    """Codes where the held-out residual is this, in units of the torque of each joint; and the noise of the fit."""
    model, torque, covariance = run(robot, rate_hz)

    def of(label, errors):
        own = torque[label]
        return Residual.of(own + own.std(axis=0) * errors, own)

    fitted = of("estimation", NOISE * RNG(seed).normal(size=torque["estimation"].shape))
    found = held_out_diagnostics(model, covariance, fitted, {"validation": of("validation", held)}, {}, colours)
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


def remembering(memory: float, seed: int = 3) -> np.ndarray:
    """Noise of which each sample is so much of the one before, and something new."""
    return lfilter([1.0], [1.0, -memory], RNG(seed).normal(size=(700, 2)), axis=0)[-500:]


def of_colour(memory: float, rate_hz: float = RATE_HZ, joints: Sequence[int] = (1, 2)) -> list[Colour]:
    """The noise of a fit, of this colour in some joints."""
    return [Colour(j, rate_hz, 1.0, 1.0, np.array([memory]), memory, 1.0, 500.0) for j in joints]


@pytest.mark.parametrize(
    ("memory", "colours", "is_noise"),
    [
        (0.8, (), False),  # it may be anything slow
        (0.8, of_colour(0.8), True),  # as in the fit, and louder
        (0.8, of_colour(0.8, rate_hz=100.0), False),  # of a log at another rate
        (0.8, of_colour(0.3), False),
        (0.3, of_colour(0.8), False),
        (0.0, of_colour(0.8), False),  # another kind of noise
        (0.0, (), True),
    ],
)
def test_noise_of_another_colour_than_in_the_fit_is_doubted(memory, colours, is_noise):
    found = codes("scara", 0, 2 * NOISE * remembering(memory), colours=colours)
    assert found == ["held-out-noisier" if is_noise else "worse-on-held-out"] * 2


def test_the_colour_of_one_joint_is_no_other_ones():
    found = codes("scara", 0, 2 * NOISE * remembering(0.8), colours=of_colour(0.8, joints=(2,)))
    assert sorted(found) == ["held-out-noisier", "worse-on-held-out"]


@pytest.mark.parametrize(("name", "factor"), [("ZZ", 1.1), ("Fc", 1.3), ("Fv", 1.6)])
def test_values_that_are_others_are_doubted_in_coloured_noise_too(name, factor):
    for seed in range(4):
        held = 2 * NOISE * remembering(0.8, seed) + other_values("scara", factor, name)
        assert "worse-on-held-out" in codes("scara", seed, held, colours=of_colour(0.8))


@pytest.mark.gate
@pytest.mark.parametrize(
    ("memory", "size", "verdict", "code"),
    [
        (0.0, 3.0, "valid", "held-out-noisier"),
        pytest.param(0.8, 3.0, "valid", "held-out-noisier", marks=pytest.mark.slow),
        (0.8, 1.0, "valid", None),
    ],
)
def test_a_right_model_with_a_noisier_held_out_log_is_valid(memory, size, verdict, code):
    """The whole way, by what identify finds of the noise itself."""
    for seed in range(4):
        model, torque, _ = run("scara")
        for k, (label, own) in enumerate(torque.items()):
            noise = lfilter([np.sqrt(1 - memory**2)], [1.0, -memory], RNG([seed, k]).normal(size=(900, 2)), axis=0)
            louder = size if label == "validation" else 1.0
            log = own + louder * NOISE * own.std(axis=0) * noise[-own.shape[0] :]
            model = model.with_experiment(label, replace(model.experiments[label], torque=log))
        estimate = Didim(start="torque").estimate(model)
        validations = validated(estimate)
        found = checked(estimate, validations).judgement
        assert found.verdict == verdict
        told = [d.code.name for d in found.remarks if d.code.name.startswith("held-out")]
        assert set(told) == ({code} if code else set())


@pytest.mark.gate
def test_a_log_of_the_fit_with_a_little_noise_is_no_independent_evidence():
    model, torque, _ = run("scara")
    own, rng = torque["estimation"], RNG(0)
    log = own + NOISE * own.std(axis=0) * rng.normal(size=own.shape)
    fitted = replace(model.experiments["estimation"], torque=log)
    copy = replace(fitted, torque=log * (1 + 1e-3 * rng.normal(size=log.shape)), role="validation")
    found = data_diagnostics(model.with_experiment("estimation", fitted).with_experiment("validation", copy))
    assert [d.code.name for d in found] == ["validation-repeats-motion"]
    assert "no independent evidence" in found[0].text


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
    assert "as white as that of the fit, and follows neither the motion nor the values" in one.text
