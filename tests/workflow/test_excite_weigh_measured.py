"""The predicted deviations of gains beside those of many identifications, of a heavy and of a light weight."""

from __future__ import annotations

import numpy as np
import pytest

from fmu_didim import excite, identify, load_case, read_robot, simulate, trajectory
from fmu_didim.checks.data.expected_accuracy import ExpectedAccuracy
from fmu_didim.data.signals import Array
from fmu_didim.workflow.excitation.excited import Excited
from tests.helpers import ROOT
from tests.loads import SCARA, planned
from tests.workflow.test_excite_weigh import LIMITS, NOISE, PLACE

pytestmark = pytest.mark.slow
GAINS, MASS_STD, RATE = np.array([1.3, 0.8]), 0.01, 50
DRAWS = {2.0: 60, 0.25: 25}
"""Mass of a weight, kg -> identifications of it: a spread of 60 is known to 9 %."""
WITHIN = 0.15
"""[1] Of the prediction, the spread of 60: within a tenth of which it is, and what it varies by chance."""


def designed(mass: float) -> tuple[Excited, ExpectedAccuracy]:
    found = excite(
        planned(), limits=LIMITS, torque_std=NOISE, starts=1, period_s=5.0, periods=2, weigh=[mass], at=[PLACE]
    )
    assert found.ok and found.prediction.prospect is not None
    return found, found.prediction.prospect


def identified(found: Excited, mass: float, draws: int) -> Array:
    """(draws, 2) gains, the noise of the logs and the error of the scale drawn anew; the loop is simulated with a
    robot that carries a ball of steel, as another description of it."""
    motion, robot = found.excitation.model_dump(mode="json"), read_robot(ROOT / "fmus/scara/robot.yaml")
    x, y, _ = PLACE
    ball = 0.4 * mass * (3 * mass / (4 * np.pi * 7850)) ** (2 / 3)
    more = {"M2": mass, "MX2": mass * x, "MY2": mass * y, "ZZ2": mass * (x * x + y * y) + ball}
    own = {v.name: v.start for v in robot.standard_parameters()}
    machines = {
        "empty": robot,
        "loaded": robot.with_values({name: own.get(name, 0.0) + value for name, value in more.items()}),
    }
    case = planned().with_(experiments={"loaded": {"load": None}})
    one = case.with_(identify={"gain1": {"start": 1.3}, "gain2": {"start": 0.8}})
    gains = []
    with_motion = {label: {"reference": motion} for label in machines}
    runs = {}
    for label, machine in machines.items():
        run = simulate(one.with_(experiments=with_motion), robot=machine, experiment=label)
        runs[label] = run.time[:-1:4], run.select(["tau1", "tau2"])[:-1:4]
    for seed in range(draws):
        rng, signals = np.random.default_rng((7, seed)), {}
        for label, (time, logged) in runs.items():
            log = logged + rng.normal(size=logged.shape) * NOISE
            signals[f"{label}.csv"] = trajectory(time, {"tau1": log[:, 0], "tau2": log[:, 1]})
        load = {"mass": mass + MASS_STD * rng.normal(), "mass_std": MASS_STD}
        content = planned(load=load).with_(experiments=with_motion).content
        result = identify(load_case(content, folder=SCARA.parent, signals=signals))
        gains.append([result.parameters[name].value for name in ("gain1", "gain2")])
    return np.array(gains)


def test_gains_scatter_as_predicted_and_the_better_weight_is_the_one_that_is_named() -> None:
    spread, expected = {}, {}
    for mass, draws in DRAWS.items():
        found, prospect = designed(mass)
        values = identified(found, mass, draws)
        places = [prospect.names.index(name) for name in ("gain1", "gain2")]
        expected[mass], spread[mass] = prospect.deviation[places], values.std(axis=0, ddof=1)
        assert np.abs(values.mean(axis=0) - GAINS).max() < (4 * expected[mass] / np.sqrt(draws)).max()
    ratio = spread[2.0] / expected[2.0]
    assert np.sqrt(np.mean(ratio**2)) == pytest.approx(1.0, abs=WITHIN), ratio
    assert (spread[0.25] > 2 * spread[2.0]).all() and (expected[0.25] > 2 * expected[2.0]).all()
    both = excite(
        planned(), limits=LIMITS, torque_std=NOISE, starts=1, period_s=5.0, periods=2, weigh=[*DRAWS], at=[PLACE]
    )
    assert both.weighing is not None and both.weighing.chosen.offer.mass == 2.0
