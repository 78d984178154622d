"""What held-out positions say of values that were fitted to the torque, with or without positions."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from fmu_didim import Result, identify
from fmu_didim.case import Case, load_case
from fmu_didim.checks.identification import checked, held_out_channels
from fmu_didim.checks.validation import Validation, validate_on
from fmu_didim.data.signals import Array, Trajectory, trajectory
from fmu_didim.fit.estimate import Estimate
from tests.helpers import ROOT

CASE = load_case(ROOT / "examples/scara/identify_200hz.yaml").with_(
    train={"torque": {"rate_hz": 50}}, validation={"torque": {"rate_hz": 50}}
)
TORQUE = np.array([0.15, 0.02])
"""[N.m] Noise of the torque logs."""
ENCODER = 1e-4
"""[rad] Noise of the encoders."""
EVERY = 5
"""[ticks] Between two samples of the positions."""


@cache
def truth(label: str, **changed: float) -> tuple[Trajectory, Trajectory]:
    """Torque at 50 Hz and positions at 40 Hz, with the values of the description or some that differ by a factor."""
    model = CASE.model
    values = model.start * [changed.get(name, 1.0) for name in model.names]
    run = model.simulation(values, label)
    recording = run.record(all_ticks=True)
    q = recording.table(["plant.q1", "plant.q2"], sampled=True)[::EVERY]
    torque = trajectory(run.experiment.time, {f"tau{j + 1}": run.torque()[:, j] for j in range(2)})
    return torque, trajectory(recording.time[::EVERY], {"q1": q[:, 0], "q2": q[:, 1]})


def noisy(log: Trajectory, deviation: Array | float, rng: np.random.Generator) -> Trajectory:
    values = log.values + deviation * rng.normal(size=log.values.shape)
    return trajectory(log.time, dict(zip(log.names, values.T, strict=True)))


def case_with(
    seed: int = 0, *, fitted: bool = True, scale: float = 1.0, std: float | None = None, **changed: float
) -> Case:
    """Positions held out, by encoders with a scale of their own, and fitted, too; other values where held out."""
    rng, signals = np.random.default_rng(seed), dict[str, Trajectory]()
    content: dict[str, Any] = {**CASE.content, "estimator": {"kind": "didim"}}
    for key, label in (("train", "estimation"), ("validation", "validation")):
        is_held = key == "validation"
        torque, positions = truth(label, **(changed if is_held else {}))
        encoders = noisy(positions, ENCODER, rng)
        if is_held:
            columns = dict(zip(encoders.names, scale * encoders.values.T, strict=True))
            encoders = trajectory(encoders.time, columns)
        signals |= {f"{key}.csv": noisy(torque, TORQUE, rng), f"{key}_q.csv": encoders}
        run = {"reference": CASE.content[key]["reference"], "torque": {"file": f"{key}.csv"}}
        if is_held or fitted:
            stated = {} if std is None else {"std": {"q1": std, "q2": std}}
            run["measured"] = {"file": f"{key}_q.csv", **stated}
        content[key] = run
    return load_case(content, folder=CASE.folder, signals=signals)


def judged(case: Case) -> tuple[Estimate, list[Validation]]:
    found = case.estimator.estimate(case.model)
    return found, [validate_on(found.model, found.value, label) for label in found.model.experiments]


@pytest.mark.gate
def test_right_models_are_not_doubted_over_seeds() -> None:
    told = [len(held_out_channels(*judged(case_with(seed)))) for seed in range(12)]
    assert sum(told) == 0


@pytest.mark.parametrize("seed", [1, 2])
def test_a_held_out_encoder_with_another_scale_is_told(seed: int) -> None:
    found = held_out_channels(*judged(case_with(seed, scale=1.002)))
    assert [(d.code.name, d.place) for d in found] == [
        ("worse-on-held-out", "validation: q1"), ("worse-on-held-out", "validation: q2")
    ]  # fmt: skip
    assert "moves +0.2 % more than it, as a sensor that is off or a model that is wrong there" in found[0].text
    assert "in the fit" in found[0].text and "% of its motion" in found[0].text


def test_what_the_torque_hides_and_the_positions_show_is_told() -> None:
    """A held-out run with a heavier second link: the torque is as good as before, the motion is not."""
    estimate, validations = judged(case_with(3, ZZ2=1.06))
    codes = checked(estimate, validations).judgement.reasons
    assert {(reason.code.name, reason.place) for reason in codes} == {("worse-on-held-out", "validation: q2")}


def test_positions_that_were_not_fitted_are_judged_by_their_stated_noise() -> None:
    estimate, validations = judged(case_with(0, fitted=False, std=ENCODER))
    assert estimate.joint is None and held_out_channels(estimate, validations) == []
    wrong = held_out_channels(*judged(case_with(0, fitted=False, std=ENCODER, scale=1.01)))
    assert {(d.code.name, d.place) for d in wrong} == {
        ("channel-beyond-noise", "validation: q1"), ("channel-beyond-noise", "validation: q2")
    }  # fmt: skip
    assert "which was not fitted" in wrong[0].text


def test_positions_whose_noise_nobody_knows_are_shown_and_not_judged() -> None:
    found = held_out_channels(*judged(case_with(0, fitted=False)))
    assert {d.code.name for d in found} == {"held-out-channel-not-judged"}


@pytest.mark.parametrize("fitted", [True, False])
def test_report_page_and_saved_result(fitted: bool, tmp_path: Any) -> None:
    result = identify(case_with(0, fitted=fitted, std=ENCODER), out=tmp_path)
    shown = result.document.experiments["validation"].channels
    assert shown["q1"].rms == pytest.approx(ENCODER, rel=0.1)
    assert shown["q1"].relative_error_percent == pytest.approx(100 * ENCODER / 0.6, rel=0.5)
    text = result.summary()
    assert ("Torque with q1, q2" if fitted else "Held out: q1, q2") in text and "RMS, validation" in text
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Measured beside the torque, validation" in page
    again = Result.load(tmp_path).validations[-1].channels["q2"]
    np.testing.assert_array_equal(again.simulated, result.validations[-1].channels["q2"].simulated)
    assert again.deviation == ENCODER
