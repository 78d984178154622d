"""The TX40, the heavy case: its models against Pinocchio, its loop at 5 kHz, its identification."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
import yaml
from fmpy.validation import validate_fmu

from fmu_didim import simulate
from fmu_didim.case import load_case
from fmu_didim.controllers import read_controller
from fmu_didim.dynamics.base_parameters import base_parameters
from fmu_didim.dynamics.robot import RobotModel
from fmu_didim.export import build_fmu
from fmu_didim.fit.estimate import Status
from tests.conftest import package
from tests.helpers import NEAR
from tests.tools.benchmarks import tx40
from tests.tools.benchmarks.pinocchio_loop import PinocchioLoop

DURATION_S = 2.0
TICKS = round(DURATION_S * tx40.RATE_HZ)
EVERY = tx40.RATE_HZ // 100
MOTION = tx40.excitation(duration_s=DURATION_S)


@cache
def model() -> RobotModel:
    return RobotModel(tx40.description())


@cache
def pinocchio_loop() -> PinocchioLoop:
    package("pinocchio")
    law = yaml.safe_load(tx40.CONTROLLER.read_text(encoding="utf-8"))
    gains = (law["Kp"], law["Kd"], tx40.DRIVE_GAINS)
    return PinocchioLoop(tx40.description(), gains, 1 / tx40.RATE_HZ, tx40.SUBSTEPS)


@cache
def by_pinocchio() -> tuple[np.ndarray, np.ndarray]:
    """Torque and motion of the closed loop, computed without this package's models, master and FMUs."""
    return pinocchio_loop().run(MOTION.trajectory(tx40.RATE_HZ), TICKS)


def test_52_base_parameters() -> None:
    """The published number: 36 of the links, 4 rotors that stay apart, 12 of friction."""
    base = base_parameters(model())
    assert base.count == 52
    assert [name for name in base.standard if name.startswith("Ia")] == ["Ia3", "Ia4", "Ia5", "Ia6"]
    assert "ZZ1R = ZZ1 + Ia1 + YY2 + YY3 + 0.07 MZ3 + 0.05185 M3 + 0.05185 M4 + 0.05185 M5 + 0.05185 M6" in (
        base.relations()
    )


def test_models_agree_with_pinocchio() -> None:
    robot, other = model(), pinocchio_loop()
    for q, dq, ddq in np.random.default_rng(7).normal(size=(20, 3, 6)):
        expected = other.torque(q, dq, ddq)
        torque = robot.inverse(q, dq, ddq, robot.parameter_values, robot.shape_values).full().ravel()
        np.testing.assert_allclose(torque, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
        found = robot.direct(q, dq, expected, robot.parameter_values, robot.shape_values).full().ravel()
        np.testing.assert_allclose(found, ddq, rtol=0, atol=1e-10)


def test_published_values_are_physical() -> None:
    """Positive definite along random positions, also with the regrouped parameters alone."""
    robot = model()
    q = np.random.default_rng(3).uniform(np.radians(tx40.LOWEST_DEG), np.radians(tx40.HIGHEST_DEG), size=(200, 6))
    base = base_parameters(robot)
    smallest = robot.inertia_along(q, robot.parameter_values).min()
    assert smallest > 0.1
    alone = robot.inertia_along(q, base.expand(base.reduce(robot.parameter_values))).min()
    assert alone == pytest.approx(smallest, rel=1e-9)


def test_reference_keeps_the_limits_of_the_robot() -> None:
    motion = tx40.excitation(duration_s=10.0).trajectory(1000)
    q, dq, ddq = (np.array(motion.select([f"{s}{j}" for j in range(1, 7)])) for s in ("q", "dq", "ddq"))
    assert (np.degrees(q) < tx40.HIGHEST_DEG).all()
    assert (np.degrees(q) > tx40.LOWEST_DEG).all()
    assert (np.degrees(np.abs(dq)) < tx40.SPEED_DEG_S).all()
    assert np.abs(ddq).max() < tx40.ACCELERATION


def test_controller_with_the_drive_gains_is_the_published_law() -> None:
    """u = Ktau (Kp e + Kd de), the velocity by backward difference of the measured position."""
    block = read_controller(tx40.CONTROLLER)
    names = [v.name for v in block.inputs]
    assert not any(name.startswith("dq") and "_ref" not in name for name in names)
    values = dict(zip(names, np.random.default_rng(2).normal(size=len(names)), strict=True))
    previous = np.random.default_rng(3).normal(size=6)
    command = block.output(previous, list(values.values()), block.parameter_values).full().ravel()
    law = pinocchio_loop()
    q, q_ref, dq_ref = (np.array([values[f"{s}{j}"] for j in range(1, 7)]) for s in ("q", "q_ref", "dq_ref"))
    expected = law.kp * (q_ref - q) + law.kd * (dq_ref - (q - previous) * tx40.RATE_HZ)
    np.testing.assert_allclose(command, expected, rtol=1e-12)


@pytest.mark.slow
def test_closed_loop_at_5_khz_is_that_of_pinocchio(tmp_path: Path) -> None:
    """Both FMUs in the loop for two seconds: it tracks, and torque and motion are those of another program."""
    torque, motion = by_pinocchio()
    time = np.arange(TICKS) / tx40.RATE_HZ
    found = simulate(tx40.write_case(tmp_path, MOTION, time[::EVERY], torque[::EVERY], substeps=256))
    names = [f"{s}{j}" for s in ("tau", "q", "dq", "ddq") for j in range(1, 7)]
    expected = np.hstack([torque, motion])
    size = np.abs(expected).max(axis=0)
    error = np.abs(found.select(names)[:TICKS] - expected).max(axis=0) / size
    # Both integrate by steps of their own (1.6e-7 is the most of five motions); where friction changes its sign,
    # accelerations show it first.
    assert error[:18].max() <= 5e-7 and error[18:].max() <= 1e-4
    q_ref = MOTION.trajectory(tx40.RATE_HZ).select([f"q{j}" for j in range(1, 7)])
    assert np.abs(found.select(names[6:12]) - q_ref).max() < 0.01


def test_fmus_are_valid() -> None:
    assert validate_fmu(str(build_fmu(model().block()))) == []
    assert validate_fmu(str(build_fmu(read_controller(tx40.CONTROLLER)))) == []


@pytest.mark.gate
def test_identification_recovers_the_truth(tmp_path: Path) -> None:
    """Torque at 100 Hz without noise, simulated with Pinocchio: all 52 parameters, from the reference alone."""
    torque, _ = by_pinocchio()
    time = np.arange(TICKS) / tx40.RATE_HZ
    # DIDIM alone contracts by a quarter an iteration here, so it ends early and the finish does the rest.
    path = tx40.write_case(
        tmp_path, MOTION, time[::EVERY], torque[::EVERY], noise=0.05, start="reference", tolerance=0.3
    )
    case = load_case(path)
    assert case.model is not None
    estimate = case.estimator.estimate(case.model)
    truth = base_parameters(model()).reduce(model().parameter_values)
    assert estimate.status is Status.CONVERGED
    assert (np.abs(estimate.value - truth) <= NEAR * estimate.standard_deviation).all()
    # The start was not the answer.
    assert np.abs(estimate.iterations[0].parameters - truth).max() > 0.1
