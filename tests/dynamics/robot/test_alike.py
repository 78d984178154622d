"""Robots that differ in lengths of links or gravity alone share their functions."""

from functools import cache

import numpy as np
import pytest

from fmu_didim.dynamics.robot import RobotModel, read_robot
from fmu_didim.dynamics.robot.dynamics import free_geometry
from tests.helpers import ROOT

ROBOTS = {
    "tx40": "fmus/tx40/robot.yaml", "scara": "fmus/scara/robot.yaml",
}  # fmt: skip


@cache
def model(name):
    return RobotModel(read_robot(ROOT / ROBOTS[name]))


def with_joint(robot, place, **changes):
    joints = list(robot.joints)
    joints[place] = joints[place].model_copy(update=changes)
    return robot.model_copy(update={"joints": tuple(joints)})


def longer(robot):
    place, name = next(
        (j, name) for j, joint in enumerate(robot.joints) for name in ("a", "d") if getattr(joint, name)
    )  # fmt: skip
    return with_joint(robot, place, **{name: 1.1 * getattr(robot.joints[place], name)})


CHANGES = {
    "another length": longer,
    "another gravity": lambda robot: robot.model_copy(update={"gravity": (9.81, 0.0, 0.1), "identified": "computed"}),
    "both": lambda robot: longer(robot).model_copy(update={"gravity": (0.0, 9.81, 0.0)}),
    "a length that was zero": lambda robot: with_joint(robot, 0, a=0.2),
    "another angle": lambda robot: with_joint(robot, 0, alpha=0.3),
    "an effect more": lambda robot: with_joint(robot, 0, effects=[*robot.joints[0].effects, "cubic_viscous"]),
}


@pytest.mark.parametrize("name", ["tx40", "scara"])
@pytest.mark.parametrize("change", CHANGES)
def test_a_robot_like_another_one_has_its_own_torque(name, change):
    own = model(name)
    description = CHANGES[change](own.description)
    alike, alone = own.like(description), RobotModel(description)
    q, dq, ddq = np.random.default_rng(1).normal(size=(3, 20, own.joint_count))
    assert np.allclose(alike.regressor_rows(q, dq, ddq), alone.regressor_rows(q, dq, ddq), rtol=1e-12, atol=1e-12)
    links = [one.at_points("transmitted", q.T, dq.T, ddq.T, one.parameter_values + 1.0) for one in (alike, alone)]
    assert np.allclose(*links, rtol=1e-12, atol=1e-12)
    assert alike.description == description
    assert set(alone.active) <= set(alike.active)
    before = own.regressor_rows(q, dq, ddq)
    own.like(longer(own.description)).regressor_rows(q, dq, ddq)
    assert np.array_equal(own.regressor_rows(q, dq, ddq), before)  # and that robot stays what it was


@pytest.mark.parametrize(
    ("change", "shared"),
    [
        ("another length", "lengths"), ("another gravity", "gravity"), ("both", None), ("a length that was zero", None),
        ("another angle", None), ("an effect more", None),
    ],
)  # fmt: skip
def test_what_robots_share_is_decided_by_what_differs(change, shared):
    robot = model("tx40").description
    found = free_geometry(robot, CHANGES[change](robot))
    is_shared = None if found is None else "gravity" if found.gravity is not None else "lengths"
    assert is_shared == shared


def test_axes_of_a_tilted_base_follow_its_own_gravity():
    robot = model("tx40").description
    tilted = with_joint(robot, 0, effects=[*robot.joints[0].effects, "base_tilt"])
    assert free_geometry(tilted, CHANGES["another gravity"](tilted)) is None
    assert free_geometry(tilted, longer(tilted)) is not None


def test_functions_of_equations_are_made_once():
    own = model("tx40")
    first, second = (own.like(longer(own.description)) for _ in range(2))
    q = np.zeros((3, own.joint_count))
    first.regressor_rows(q, q, q)
    assert second._by_points("regressor") is first._by_points("regressor")


def test_what_a_robot_shares_not_is_no_wrong_number():
    own = model("tx40")
    with pytest.raises(RuntimeError, match="free"):
        _ = own.like(longer(own.description)).mass_matrix
