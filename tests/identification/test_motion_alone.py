"""An open loop: the torque is given by the reference, and measured positions alone show the values."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from fmu_didim import discover, identify
from fmu_didim.base.errors import InputError
from fmu_didim.case import Case, load_case
from fmu_didim.data.signals import Array, Trajectory, trajectory
from fmu_didim.fit.estimate import Estimate
from tests.helpers import ROOT

RATE = 200
ENCODER = 1e-3
"""[rad] Noise of the encoders."""
TRUTH = {
    "ZZ1R": 0.09, "MX1R": 0.34, "MY1": 0.0, "Fv1": 0.03, "Fc1": 0.12,
    "ZZ2": 0.022, "MX2": 0.115, "MY2": 0.0, "Fv2": 0.02, "Fc2": 0.09,
}  # fmt: skip
"""Of the pendulum; its description is off by up to a factor of 2.5."""


@cache
def played() -> tuple[Trajectory, Trajectory]:
    """The reference, which holds the torque and where the motion begins, and the log of that torque at 50 Hz."""
    t = np.arange(12 * RATE + 1) / RATE
    soft, w = np.minimum(t / 0.5, 1), 2 * np.pi * t
    torque = {
        "tau1": soft * (np.sin(0.45 * w) + 0.8 * np.sin(1.1 * w + 0.4) + 0.3 * np.sin(2.3 * w)),
        "tau2": soft * (0.5 * np.sin(0.8 * w + 0.7) + 0.35 * np.sin(1.9 * w)),
    }
    rest = {name: np.zeros_like(t) for name in ("q1", "q2", "dq1", "dq2")}
    return trajectory(t, {**rest, **torque}), trajectory(t[::4], {name: v[::4] for name, v in torque.items()})


def case_of(positions: Trajectory | None, **more: Any) -> Case:
    reference, log = played()
    train: dict[str, Any] = {"reference": {"file": "reference.csv"}, "torque": {"file": "torque.csv"}}
    signals = {"reference.csv": reference, "torque.csv": log}
    if positions is not None:
        train["measured"], signals["encoders.csv"] = {"file": "encoders.csv"}, positions
    content = {
        "schema": 1,
        "name": "open loop",
        "robot": "examples/double_pendulum/robot.yaml",
        "components": {"plant": {"kind": "fmu"}},
        "connections": {"plant.tau1": "reference.tau1", "plant.tau2": "reference.tau2"},
        "loop": {"rate_hz": RATE},
        "train": train,
        "estimator": {"kind": "clie"},
        **more,
    }
    return load_case(content, folder=ROOT, signals=signals)


@cache
def motion() -> tuple[Array, Array]:
    """Instants (K,) and positions (K, 2) of the truth."""
    t = played()[0].time[::2]
    model = case_of(trajectory(t, {"q1": 0 * t, "q2": 0 * t})).model
    truth = np.array([TRUTH[name] for name in model.names])
    run = model.simulation(truth).record(all_ticks=True)
    return run.time[::2], run.table(["plant.q1", "plant.q2"], sampled=True)[::2]


def estimate(seed: int, *, extra: float = 0.0) -> Estimate:
    """By encoders with noise, and a slow error of their own."""
    rng, (t, q) = np.random.default_rng(seed), motion()
    slow = extra * np.sin(2 * np.pi * 0.3 * t)[:, None]
    measured = q + ENCODER * rng.normal(size=q.shape) + slow
    case = case_of(trajectory(t, {"q1": measured[:, 0], "q2": measured[:, 1]}))
    return case.estimator.estimate(case.model)


def test_motion_alone_shows_all_values() -> None:
    found = estimate(0)
    truth = np.array([TRUTH[name] for name in found.names])
    assert found.joint is not None and found.joint.alone is None
    assert found.status.name == "CONVERGED"
    assert (np.abs(found.value - truth) < 4 * found.standard_deviation).all()
    assert (found.standard_deviation < 2e-4).all()
    assert [channel.deviation for channel in found.joint.channels] == pytest.approx([ENCODER] * 2, rel=0.1)


@pytest.mark.slow
def test_intervals_of_motion_alone_hold() -> None:
    """Of 30 draws of ten values 95 % are inside, but for chance; the deviations are those of the scatter."""
    found = [estimate(seed) for seed in range(30)]
    truth = np.array([TRUTH[name] for name in found[0].names])
    inside = np.mean([(low <= t <= high) for e in found for (low, high), t in zip(e.interval(), truth, strict=True)])
    assert 0.90 <= inside <= 0.99
    scatter = np.std([e.value for e in found], axis=0, ddof=1) / np.mean([e.standard_deviation for e in found], axis=0)
    assert np.sqrt(np.mean(scatter**2)) == pytest.approx(1.0, abs=0.15)


def test_report_and_verdict_of_an_open_loop() -> None:
    t, q = motion()
    noise = ENCODER * np.random.default_rng(1).normal(size=q.shape)
    result = identify(case_of(trajectory(t, {"q1": (q + noise)[:, 0], "q2": (q + noise)[:, 1]})))
    text = result.summary()
    assert result.document.verdict == "valid", text
    assert "The loop is open" in text and result.document.joint is not None and result.document.joint.alone is None


def test_motion_that_the_model_does_not_explain_is_doubted() -> None:
    t, q = motion()
    wrong = q + ENCODER * np.random.default_rng(2).normal(size=q.shape) + 0.02 * np.sin(2 * np.pi * 0.3 * t)[:, None]
    result = identify(case_of(trajectory(t, {"q1": wrong[:, 0], "q2": wrong[:, 1]})))
    assert result.document.verdict == "doubtful"
    assert "motion-unexplained" in {reason.code for reason in result.document.reasons}


def test_discovery_does_not_call_an_open_loop_complete() -> None:
    t, q = motion()
    with pytest.raises(InputError, match=r"The loop is open[\s\S]*motion-unexplained"):
        discover(case_of(trajectory(t, {"q1": q[:, 0], "q2": q[:, 1]})))


@pytest.mark.parametrize(("measured", "estimator"), [(False, {"kind": "clie"}), (True, {"kind": "didim"})])
def test_what_cannot_identify_an_open_loop_says_so(measured: bool, estimator: dict[str, str]) -> None:
    t, q = motion()
    positions = trajectory(t, {"q1": q[:, 0], "q2": q[:, 1]}) if measured else None
    with pytest.raises(InputError, match=r"The loop is open[\s\S]*measured: with the positions"):
        case_of(positions, estimator=estimator)
