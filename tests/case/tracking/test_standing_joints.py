"""Logs in which one joint moves after the other, as they are made to look at one joint: the others stand still."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmu_didim import load_case
from fmu_didim.case.tracking.positions import Positions, bandwidth_of
from fmu_didim.checks.data.expected import Expected
from fmu_didim.checks.data.torque_channel import EXPLAINS
from fmu_didim.dynamics.base_parameters import base_parameters
from fmu_didim.dynamics.robot import RobotModel, read_robot
from fmu_didim.estimators.starts.reference_start import STANDS, moving_joints
from fmu_didim.model.parameters import RobotParameters
from fmu_didim.workflow.data import case_diagnostics
from tests.case.tracking.hidden import SCARA

TIME = np.arange(4000) / 1000.0
SEEN = 2e-5
"""[rad] Noise of the encoders."""


def swing(joint: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(K, 2) positions, velocities and accelerations: half a radian of one joint."""
    w = 2 * np.pi * 0.5
    one = np.array([0.5 * np.sin(w * TIME), 0.5 * w * np.cos(w * TIME), -0.5 * w * w * np.sin(w * TIME)])
    tables = np.zeros((3, TIME.size, 2))
    tables[:, :, joint] = one
    return tables[0], tables[1], tables[2]


def noisy(values: np.ndarray, size: float, seed: int) -> np.ndarray:
    return values + size * np.random.default_rng(seed).normal(size=values.shape)


@pytest.mark.parametrize(
    ("speeds", "moving"),
    [((1.0, 0.5), (True, True)), ((1.0, STANDS / 2), (True, False)), ((0.0, 1e-9), (False, True)),
     ((0.0, 0.0), (True, True))],
)  # fmt: skip
def test_joints_stand_still_beside_one_that_moves(speeds: tuple[float, ...], moving: tuple[bool, ...]) -> None:
    velocity = np.sin(TIME)[:, None] * np.array(speeds)
    assert tuple(moving_joints(velocity)) == moving


def test_what_is_seen_of_a_joint_that_stands_does_not_set_the_bandwidth() -> None:
    from fmu_didim.case.tracking.positions import LogBand

    run = Positions("one", TIME, noisy(swing(0)[0], SEEN, 1))
    found = bandwidth_of([run], None, LogBand(100.0))
    assert run.motion_hz(found.hz) < 2.0 < 5.0 < found.hz


def test_a_log_of_one_joint_belongs_to_its_reference() -> None:
    """The torque of the joint that stands is noise, which nothing explains; of a foreign log neither does."""
    robot = RobotModel(read_robot(Path("fmus/scara/robot.yaml")))
    parameters = RobotParameters(robot, base_parameters(robot))
    q, dq, ddq = swing(0)
    columns, known = parameters.regressor(q, dq, ddq)
    measured = noisy(columns @ parameters.nominal() + known, 0.02, 2)
    measured[:, 1] = np.random.default_rng(3).normal(scale=0.02, size=TIME.size)
    errors = {}
    for moving in (None, moving_joints(dq)):
        given = Expected(measured, None, columns, known, moving=moving)
        assert given.fitted is not None
        errors[moving is None] = given.error(given.fitted)
    assert errors[True] > EXPLAINS > 4 * errors[False]
    other = Expected(np.roll(measured, 500, axis=0)[:, ::-1], None, columns, known, moving=moving_joints(dq))
    assert other.fitted is not None and other.error(other.fitted) > EXPLAINS


@pytest.mark.gate
def test_a_machine_that_moves_joint_by_joint_is_identified(tmp_path: Path) -> None:
    """No check of the data calls such a log foreign."""
    content: dict[str, Any] = {
        "schema": 1, "name": "joint by joint", "robot": str(Path("fmus/scara/robot.yaml").resolve()),
        "controller": {"kind": "tracking"}, "experiments": {},
    }  # fmt: skip
    robot = RobotModel(read_robot(Path("fmus/scara/robot.yaml")))
    parameters = RobotParameters(robot, base_parameters(robot))
    for joint in (0, 1):
        q, dq, ddq = swing(joint)
        columns, known = parameters.regressor(q, dq, ddq)
        torque = noisy(columns @ parameters.nominal() + known, 0.005, 4 + joint)
        table = np.column_stack([TIME, noisy(q, SEEN, 6 + joint), torque])
        path = tmp_path / f"joint{joint + 1}.csv"
        np.savetxt(path, table, delimiter=",", header="t,q1,q2,tau1,tau2", comments="", fmt="%.9g")
        file = {"file": str(path)}
        content["experiments"][f"joint{joint + 1}"] = {"torque": {**file, "rate_hz": 100}, "positions": file}
    codes = {d.code.name for d in case_diagnostics(load_case(content, folder=SCARA.parent))}
    assert "reference-foreign" not in codes
