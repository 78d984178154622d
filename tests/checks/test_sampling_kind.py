"""Logs of averages that are taken for points, and the other way round: told beside what was found."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fmu_didim.checks.sampling_kind import Way, other_sampling
from fmu_didim.cosim import SampleOperator, sample_operator
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.augmentation.places import Proposal
from fmu_didim.dynamics.effects import EFFECTS
from fmu_didim.dynamics.robot import read_robot
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.solver.least_squares import minimise
from fmu_didim.model.loop_model import EffectAtJoint, LoopModel
from tests.discovery.helpers import arm_model, data, known_noise, with_torque

SIGMA = (0.02, 0.01)
SHIFT = EffectAtJoint("log_time_shift", 1)


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, LoopModel]:
    folder = tmp_path_factory.mktemp("arm")
    return folder, arm_model(folder, joints=2, rate_hz=50.0)


def operator(model: LoopModel, kind: str, window: str = "preceding") -> SampleOperator:
    reference = data(model).reference.time
    return sample_operator(
        data(model).time, start=float(reference[0]), step=float(reference[1] - reference[0]),
        tick_count=reference.size, kind=kind, window=window,  # type: ignore[arg-type]
    )  # fmt: skip


def logged(model: LoopModel, taken: SampleOperator, told: SampleOperator) -> LoopModel:
    """A noisy log that was taken in one way, said to be taken in another."""
    torque = taken_as(model, taken).torque(model.start)
    noise = np.random.default_rng(4).normal(size=torque.shape) * SIGMA
    return with_torque(taken_as(model, told), torque + noise)


def taken_as(model: LoopModel, operator: SampleOperator) -> LoopModel:
    """The loop with samples taken in another way."""
    return model.with_experiment(model.first, replace(data(model), operator=operator))


def asked(folder: Path, model: LoopModel, *, shifted: bool = False) -> Way | None:
    """What is told after a fit of the base, or of a shift of the log beside it."""
    noise = known_noise(SIGMA)
    fit: Fit = minimise(model, noise)
    if not shifted:
        return other_sampling(fit, fit.model, saved=0.0, threshold=10.0)
    builder = LoopModelBuilder(model, read_robot(folder / "robot.yaml"), EFFECTS)
    fit = minimise(builder.build(fit.model, [Proposal(SHIFT, {"log_shift": 0.005})]), noise)
    unshifted = builder.without(fit.model, 0)
    return other_sampling(fit, unshifted, saved=builder.at(SHIFT).cost, threshold=10.0)


@pytest.mark.gate
@pytest.mark.parametrize("window", ["preceding", "centred", "following"])
def test_averages_taken_for_points_are_told(arm: tuple[Path, LoopModel], window: str) -> None:
    folder, model = arm
    way = asked(folder, logged(model, operator(model, "average", window), operator(model, "point")))
    assert way is not None
    assert (way.kind, way.window, way.instead) == ("average", window, False)
    assert way.gain > 100
    text = way.text(0.02)
    word = {"preceding": "before", "centred": "around", "following": "after"}[window]
    assert f"averages over the 20 ms {word} each stamp" in text
    assert f"torque: {{sampling: average, window: {window}}}" in text


@pytest.mark.gate
def test_points_taken_for_averages_are_told(arm: tuple[Path, LoopModel]) -> None:
    folder, model = arm
    way = asked(folder, logged(model, operator(model, "point"), operator(model, "average")))
    assert way is not None
    assert way.kind == "point"
    assert "torque: {sampling: point}" in way.text(0.02)


def test_averages_are_told_instead_of_a_shift(arm: tuple[Path, LoopModel]) -> None:
    """An average over the preceding 20 ms resembles a log that is 10 ms late."""
    folder, model = arm
    wrong = logged(model, operator(model, "average"), operator(model, "point"))
    way = asked(folder, wrong, shifted=True)
    assert way is not None
    assert (way.kind, way.window, way.instead) == ("average", "preceding", True)
    assert "without a shift" in way.text(0.02)


@pytest.mark.gate
@pytest.mark.parametrize("kind", ["point", "average"])
@pytest.mark.parametrize("late_s", [0.0, 0.03])
def test_a_log_as_the_case_says_is_not_doubted(arm: tuple[Path, LoopModel], kind: str, late_s: float) -> None:
    """Nor is one that is late by more than averages are."""
    folder, model = arm
    told = operator(model, kind)
    reference = data(model).reference.time
    taken = told.stamped_later(late_s / float(reference[1] - reference[0]), reference.size)
    assert asked(folder, logged(model, taken, told), shifted=late_s > 0) is None
