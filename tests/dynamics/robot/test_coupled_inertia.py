"""Motors that drive each other's joints: the inertia matrix, whatever integrates it, and what a machine can have."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np
import pytest

from fmu_didim.checks.physical import far_from_physical
from fmu_didim.components import ModelComponent, block_as_control, load_fmu
from fmu_didim.dynamics.base_parameters import base_parameters
from fmu_didim.dynamics.robot import RobotDescription, RobotModel
from fmu_didim.dynamics.robot.formats.write_mjcf import not_in_mjcf
from fmu_didim.dynamics.robot.formats.write_urdf import not_in_urdf
from fmu_didim.dynamics.standard_parameters import standard_parameters
from fmu_didim.export import build_fmu
from tests.dynamics.robot.test_linearly_implicit import stepped

LINK = {"M": 1.2, "MX": 0.1, "MY": 0.02, "MZ": 0.05, "XX": 0.06, "YY": 0.05, "ZZ": 0.055, "XY": 0.002}
ROTOR, RATIO = 0.04, -0.8
"""[kg.m2, 1] A motor that turns by q_3 + r q_2."""


def wrist(coupled: float, own: Mapping[int, float], *, gears: Sequence[int] = (), **options: Any) -> RobotDescription:
    """Three joints with axes at right angles; motor inertias ``own`` by joint, those of 2 and 3 coupled."""
    joints = []
    for j in range(1, 4):
        values = LINK | {"Ia": own[j], "Fc": 0.3, "v0": 0.05} | ({"Iam": coupled} if j == 2 else {})
        values |= {"K": 900.0, "D": 0.8} if j in gears else {}
        found = ["motor_inertia", "coulomb", *(["coupled_inertia"] if j == 2 else [])]
        joint = {"type": "revolute", "effects": [*found, *(["joint_elasticity"] if j in gears else [])]}
        joints.append(joint | {"alpha": "pi/2" if j > 1 else 0.0, "d": 0.1 * j, "parameters": values})
    return RobotDescription.model_validate({"name": "wrist", "joints": joints} | options)


OWN = {1: 0.1, 2: 0.06, 3: 0.03}
COUPLED = {1: 0.1, 2: 0.06 + RATIO**2 * ROTOR, 3: 0.03 + ROTOR}


def test_a_motor_of_two_joints_has_the_energy_of_its_rotor() -> None:
    """M = M without it + J v v', v = (0, r, 1) the turns of the rotor by those of the joints."""
    with_it, without = RobotModel(wrist(RATIO * ROTOR, COUPLED)), RobotModel(wrist(0.0, OWN))
    turns = np.array([0.0, RATIO, 1.0])
    for q in np.random.default_rng(1).normal(size=(5, 3)):
        one, other = (np.array(m.mass_matrix(q, m.parameter_values)) for m in (with_it, without))
        np.testing.assert_allclose(one - other, ROTOR * np.outer(turns, turns), rtol=0, atol=1e-15)


def test_it_is_a_base_parameter_of_its_own_in_a_wrist_and_none_of_parallel_axes() -> None:
    names = base_parameters(RobotModel(wrist(0.0, OWN))).names
    assert {"Iam2", "ZZ2R", "Ia3"} <= set(names)  # ZZ2R holds Ia2
    joint = {"type": "revolute", "a": 0.3, "effects": ["motor_inertia"], "parameters": LINK}
    pair = [joint | {"effects": ["motor_inertia", "coupled_inertia"]}, joint]
    planar = RobotModel(RobotDescription.model_validate({"name": "planar", "gravity": [0, 0, 0], "joints": pair}))
    base = base_parameters(planar)
    without = planar.description.model_copy(update={"joints": (planar.description.joints[1],) * 2})
    assert base.count == base_parameters(RobotModel(without)).count
    assert "Iam1R = Iam1 - Ia2" in base.relations()  # told as a sum, and not lost


@pytest.mark.parametrize("gears", [(), (2,), (2, 3)])
def test_models_agree_with_each_other(gears: Sequence[int]) -> None:
    """The torque for the accelerations that a torque gives is that torque, also behind elastic gears."""
    robot = RobotModel(wrist(RATIO * ROTOR, COUPLED, gears=gears))
    rng, chi, s = np.random.default_rng(2), robot.parameter_values, robot.shape_values
    for _ in range(20):
        q, dq, tau = rng.normal(size=(3, 3))
        extra = [rng.normal(size=len(robot.extra)) * 0.01 + np.repeat([0.0, 1.0], len(gears))] if gears else []
        ddq = np.array(robot.direct(q, dq, tau, chi, s, *extra)).ravel()
        again = np.array(robot.inverse(q, dq, ddq, chi, s, *extra)).ravel()
        np.testing.assert_allclose(again, tau, rtol=0, atol=1e-9)


@pytest.mark.parametrize("gears", [(2,), (3,), (2, 3)])
def test_steps_resolve_what_coupled_motors_do(gears: Sequence[int]) -> None:
    """A rotor of two joints is lighter for a gear whose other motor gives way: the bound of the rate counts that."""
    almost = 0.999 * np.sqrt(0.02 * 0.021)
    block = RobotModel(wrist(almost, {1: 0.1, 2: 0.02, 3: 0.021}, gears=gears, gravity=(0, 0, 0))).block()
    block = block.with_parameters({"Fc1": 0.0, "Fc2": 0.0, "Fc3": 0.0})
    p, u, n = block.parameter_values, np.zeros(3), len(block.states)
    x = ca.SX.sym("x", n)
    slopes = ca.Function("slopes", [x], [ca.jacobian(block.update(x, u, p), x)])
    begin = block.start(u, p)
    fastest = float(np.abs(np.linalg.eigvals(np.array(slopes(begin)))).max())
    bound = float(block.rate_bound(begin, p))
    assert fastest <= bound <= 5 * fastest
    apart = block.with_parameters({"Iam2": 0.0})
    assert float(apart.rate_bound(begin, apart.parameter_values)) < bound


@pytest.mark.gate
@pytest.mark.parametrize("gears", [(), (2, 3)])
def test_every_kind_of_component_and_integrator_gives_one_motion(gears: Sequence[int]) -> None:
    block = RobotModel(wrist(RATIO * ROTOR, COUPLED, gears=gears)).block({"dq_start1": 0.4, "dq_start2": -0.7})
    assert block.implicit is not None
    found = []
    for component in (ModelComponent(block), block_as_control(block), load_fmu(build_fmu(block, fmi_version="2.0"))):
        running = started_with(component, [0.2, -0.3, 0.1])
        found.append(stepped(running, range(20)))
        running.close()
    np.testing.assert_allclose(found[1], found[0], rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(found[2], found[0], rtol=1e-9, atol=1e-11)
    u, p, x = np.array([0.2, -0.3, 0.1]), block.parameter_values, ca.MX.sym("x", len(block.states))
    options = {"abstol": 1e-12, "reltol": 1e-12, "max_num_steps": 100000}
    exact = ca.integrator("exact", "cvodes", {"x": x, "ode": block.update(x, u, p)}, 0.0, 0.1, options)
    states = np.asarray(exact(x0=block.start(u, p))["xf"].full()).ravel()
    np.testing.assert_allclose(found[0][:6], states[:6], rtol=0, atol=2e-5)


def started_with(component: Any, torque: Sequence[float]) -> Any:
    running = component.instantiate()
    running.inputs[:] = torque
    running.begin_initialisation(0.0)
    running.set()
    running.end_initialisation()
    return running


def deviations(coupled: float, own: Mapping[int, float]) -> list[str]:
    """What is told of base parameters with these motors, known to a hundredth of the rotor."""
    robot = RobotModel(wrist(coupled, own))
    base = base_parameters(robot)
    theta = base.reduce(robot.parameter_values)
    found = far_from_physical(robot, base, theta, np.eye(base.count) * (0.01 * ROTOR) ** 2)
    return [f"{d.place}: {d.text}" for d in found]


def test_motors_that_no_machine_has_are_told() -> None:
    assert deviations(RATIO * ROTOR, COUPLED) == []
    (told,) = deviations(-0.11, COUPLED)  # beyond sqrt(ZZ2R Ia3) = 0.099: Ia2 may be a part of ZZ2R
    assert told.startswith("joints 2 and 3: No coupled motors of joints 2 and 3 have these values")
    robot = RobotModel(wrist(-0.11, COUPLED))
    assert robot.inertia_along(np.zeros((1, 3)), robot.parameter_values).min() > 0  # which the links alone would hide


@pytest.mark.parametrize("count", [2, 4, 6])
def test_a_row_of_coupled_motors_is_one_matrix(count: int) -> None:
    """Each pair alone may be possible where all together are not: 2 cos(pi / (n + 1)) of the diagonal is the limit."""
    limit = 0.1 / (2 * np.cos(np.pi / (min(count, 4) + 1)))
    told = []
    for factor in (0.98, 1.05):
        values = [LINK] * 2 + [LINK | {"Ia": 0.1, "Iam": factor * limit}] * (count - 1) + [LINK | {"Ia": 0.1}]
        joints = [
            {
                "type": "revolute", "alpha": "pi/2", "d": 0.1, "parameters": v,
                "effects": [*(["motor_inertia"] if "Ia" in v else []), *(["coupled_inertia"] if "Iam" in v else [])],
            }
            for v in values
        ]  # fmt: skip
        robot = RobotModel(RobotDescription.model_validate({"name": "row", "joints": joints}))
        base = base_parameters(robot)
        found = far_from_physical(robot, base, base.reduce(robot.parameter_values), np.eye(base.count) * 1e-8)
        told.append([d.code.name for d in found])
    assert told == [[], ["not-physical"]]


def test_links_of_a_result_keep_it() -> None:
    robot = RobotModel(wrist(RATIO * ROTOR, COUPLED))
    base = base_parameters(robot)
    theta = base.reduce(robot.parameter_values)
    found = standard_parameters(robot, base, theta, np.eye(base.count) * 1e-10)
    np.testing.assert_allclose(found.base, theta, rtol=0, atol=1e-6)
    assert found.values["Iam2"] == pytest.approx(RATIO * ROTOR, abs=1e-6)
    assert found.values["Iam2"] ** 2 <= found.values["Ia2"] * found.values["Ia3"]


def test_formats_that_cannot_hold_it_say_so() -> None:
    robot = wrist(RATIO * ROTOR, COUPLED)
    for not_held in (not_in_urdf, not_in_mjcf):
        assert "Iam2 = -0.032 kg.m2 (motor inertia coupled between two joints)" in not_held(robot)


def test_it_needs_a_joint_after_it() -> None:
    joint = {"type": "revolute", "effects": ["coupled_inertia"]}
    with pytest.raises(ValueError, match="coupled_inertia at joint 2 needs 1 more joint"):
        RobotDescription.model_validate({"name": "wrist", "joints": [joint, joint]})
