"""The designed motion beside fifty random ones with the same limits, and its predicted deviations beside those of many
identifications."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from fmu_didim import excite, identify, load_case, trajectory
from fmu_didim.discovery.excitation.optimum import Problem
from fmu_didim.discovery.excitation.series import Series
from fmu_didim.model.parameters import RobotParameters
from fmu_didim.workflow.excitation.excited import Excited
from fmu_didim.workflow.excitation.planned import Plan, mean_percent, predict
from tests.helpers import ROOT

pytestmark = pytest.mark.slow
FOLDER = ROOT / "examples/scara"
NOISE = np.array([0.17, 0.0065])
LIMITS = {"position": [[-1.5, 1.5], [-2, 2]], "velocity": [3, 4], "acceleration": [10, 20], "torque": [40, 3]}
RANDOM, DRAWS = 50, 60


@pytest.fixture(scope="module")
def made() -> Excited:
    return excite(
        FOLDER / "identify.yaml", limits=LIMITS, torque_std=list(NOISE), period_s=10, periods=1, starts=3, seed=0
    )


def test_it_tells_more_than_the_best_of_fifty_random_motions(made: Excited) -> None:
    case = load_case(FOLDER / "identify.yaml", require_torque=False)
    robot = case.parameters
    assert isinstance(robot, RobotParameters)
    plan = Plan(case, "estimation", 10.0, NOISE, robot.nominal())
    basis = Series(0.1, 1, 2)
    one = Problem(robot.model, robot.base, robot.nominal(), NOISE, basis, np.arange(100) / 10, range(robot.count))
    found = []
    for i in range(RANDOM):
        z = one.random(np.random.default_rng([99, i]), made.bounds)
        found.append(predict(plan, basis.excitation(z).trajectory(200), robot.names))
    mean = min(mean_percent(one.prospect, robot.names) for one in found)
    assert made.mean_percent < 0.9 * mean
    assert made.prediction.criterion > max(one.criterion for one in found)
    # The inertial parameters, which no limit of the velocity holds back, are known far better than by the best mean.
    best = min(found, key=lambda one: mean_percent(one.prospect, robot.names)).prospect
    own = made.prediction.prospect
    assert best is not None and own is not None
    inertial = [robot.names.index(name) for name in ("ZZ1R", "ZZ2", "MX2", "MY2")]
    ratio = (own.deviation / best.deviation)[inertial]
    assert np.exp(np.mean(np.log(ratio))) < 0.6


def test_predicted_deviations_are_those_of_many_identifications(made: Excited) -> None:
    own = made.prediction.prospect
    assert own is not None
    torque = made.prediction.loop.select(["tau1", "tau2"])[::20][:-1]
    time, rng = np.arange(torque.shape[0]) / 10, np.random.default_rng(5)
    content: dict[str, Any] = load_case(FOLDER / "identify.yaml", require_torque=False).content
    content["train"] = {"reference": made.excitation.model_dump(mode="json"), "torque": {"file": "planned"}}
    content |= {"estimator": {"kind": "didim", "start": "description"}, "torque_std": list(NOISE)}
    del content["validation"]
    found = []
    for _ in range(DRAWS):
        noisy = torque + rng.normal(0, NOISE, torque.shape)
        log = trajectory(time, {"tau1": noisy[:, 0], "tau2": noisy[:, 1]})
        outcome = identify(load_case(content, folder=FOLDER, signals={"planned": log}))
        found.append([outcome.values[name] for name in own.names])
    ratio = np.std(found, axis=0, ddof=1) / own.deviation
    assert np.sqrt(np.mean(ratio**2)) == pytest.approx(1.0, abs=0.1)
    # Of 60 draws a deviation is known to a tenth.
    assert (np.abs(ratio - 1.0) < 0.35).all()
