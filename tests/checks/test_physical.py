"""What no machine can have: values of known truth with noise pass, what is wrong is found where it is."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from fmu_didim.case import load_case
from fmu_didim.checks.physical import (
    far_from_physical,
    indefinite,
    joint_range,
    negative_friction,
    physical_diagnostics,
    worst_position,
)
from fmu_didim.data.signals import Array
from fmu_didim.dynamics.base_parameters import BaseParameters, base_parameters
from fmu_didim.dynamics.robot import RobotDescription, RobotModel, read_robot
from fmu_didim.dynamics.robot.description import Joint
from fmu_didim.fit.feasibility import nearest_physical
from fmu_didim.model.parameters import RobotParameters
from tests.helpers import ROOT

ROBOTS = ("scara", "arm2r", "tx40")
DRAWS = 100


@cache
def robot(name: str) -> tuple[RobotModel, BaseParameters, Array, Array]:
    """Model, base parameters, true values, and standard deviations: 3 % and a little more."""
    model = RobotModel(read_robot(ROOT / f"fmus/{name}/robot.yaml"))
    base = base_parameters(model)
    truth = base.reduce(model.parameter_values)
    return model, base, truth, 0.03 * np.abs(truth) + 0.002


def correlated(deviation: Array) -> Array:
    """A covariance with these standard deviations and correlations of 0.6."""
    return np.outer(deviation, deviation) * (0.4 * np.eye(deviation.size) + 0.6)


@pytest.mark.gate
@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize(
    "spread",
    [pytest.param(np.diag, id="apart", marks=pytest.mark.slow), pytest.param(correlated, id="correlated")],
)
def test_true_values_with_noise_pass(name: str, spread: object) -> None:
    model, base, truth, deviation = robot(name)
    covariance = np.diag(deviation**2) if spread is np.diag else correlated(deviation)
    draws = np.random.default_rng(1).multivariate_normal(truth, covariance, size=DRAWS)
    assert far_from_physical(model, base, truth, covariance) == []
    told = [bool(far_from_physical(model, base, values, covariance)) for values in draws]
    assert sum(told) <= 0.01 * DRAWS


@pytest.mark.parametrize(
    ("name", "parameter", "link"),
    [
        ("scara", "ZZ2", 2), ("scara", "ZZ1R", 1), ("arm2r", "ZZ1R", 1), ("arm2r", "Ia2", 2), ("tx40", "Ia3", 3),
        ("tx40", "ZZ4R", 4), ("tx40", "Ia5", 5), ("tx40", "ZZ6", 6), ("tx40", "Ia6", 6),
    ],
)  # fmt: skip
def test_negative_inertia_is_found_with_its_link(name: str, parameter: str, link: int) -> None:
    """By five standard deviations, all else true."""
    model, base, truth, deviation = robot(name)
    i = base.names.index(parameter)
    values = truth.copy()
    values[i] = -5 * deviation[i]
    (found,) = far_from_physical(model, base, values, np.diag(deviation**2))
    assert found.code.name == "not-physical"
    assert found.place == f"link {link}"
    assert parameter in found.text
    assert found.value is not None and found.bound is not None and found.value > found.bound


def test_nearest_motor_inertia_is_zero() -> None:
    """One inequality that touches no other parameter: the distance is that of its value from zero."""
    model, base, truth, deviation = robot("tx40")
    i = base.names.index("Ia6")
    values = truth.copy()
    values[i] = -5 * deviation[i]
    near = nearest_physical(model, base, values, np.diag(deviation**2))
    assert near.distance == pytest.approx(5.0, abs=1e-3)
    assert (near.constraints, near.link, near.parameter) == (1, (6,), i)
    np.testing.assert_allclose(np.delete(near.values, i), np.delete(truth, i), atol=1e-5)
    assert near.values[i] == pytest.approx(0.0, abs=1e-5)


@pytest.mark.parametrize(
    ("times", "told"), [(-1.9, False), (-2.1, True), (1.0, False)], ids=["by chance", "too far", "positive"]
)
def test_negative_friction(times: float, told: bool) -> None:
    _, base, truth, deviation = robot("tx40")
    i = base.names.index("Fv5")
    values = truth.copy()
    values[i] = times * deviation[i]
    found = negative_friction(base, values, np.diag(deviation**2))
    assert bool(found) is told
    if told:
        assert (found[0].code.name, found[0].place) == ("friction-negative", "joint 5")
        assert found[0].value == pytest.approx(times)


def test_inertia_matrix_that_fails_far_from_the_motion_is_found() -> None:
    """Two links in a plane, the second far too heavy for its inertia: it shows where it points across the first."""
    model, base, truth, deviation = robot("scara")
    values = truth.copy()
    values[base.names.index("MX2")], values[base.names.index("MY2")] = 0.0, 1.2
    low, high = np.full(2, -np.pi), np.full(2, np.pi)
    worst = worst_position(RobotParameters(model, base), values, low, high)
    # M = [[z1 + z2 + 2 a c, z2 + a c], [., z2]] with c = MX cos q2 - MY sin q2; scaled by hand over a fine grid.
    z1, z2, c = values[0], values[base.names.index("ZZ2")], 0.5 * -1.2 * np.sin(np.linspace(-np.pi, np.pi, 100001))
    expected = (1 - np.abs(z2 + c) / np.sqrt((z1 + z2 + 2 * c) * z2)).min()
    assert worst.eigenvalue == pytest.approx(expected, abs=1e-6)
    (found,) = indefinite(RobotParameters(model, base), values, np.diag(deviation**2), low, high)
    assert found.code.name == "mass-matrix-indefinite"
    assert found.place in ("joint 1", "joint 2")
    # Within limits where the second link does not point that way, nothing is wrong.
    low, high = np.array([-3.0, -0.05]), np.array([3.0, 0.05])
    assert indefinite(RobotParameters(model, base), values, np.diag(deviation**2), low, high) == []


def test_all_are_asked_of_a_model() -> None:
    model = load_case("examples/scara/identify.yaml").model
    covariance = np.diag((0.03 * np.abs(model.start) + 0.002) ** 2)
    assert physical_diagnostics(model, covariance) == []
    values = model.start.copy()
    values[model.names.index("Fc2")], values[model.names.index("ZZ2")] = -0.05, -0.03
    found = physical_diagnostics(model.with_values(values), covariance)
    assert {d.code.name for d in found} == {"friction-negative", "not-physical", "mass-matrix-indefinite"}


def test_own_values_of_an_experiment_are_looked_at() -> None:
    """A payload that takes mass away."""
    model = load_case("examples/scara/two_payloads.yaml").model
    own = [i for i, p in enumerate(model.free_parameters) if p.experiment is not None and p.key == "ZZ2"]
    covariance = np.diag((0.03 * np.abs(model.start) + 0.002) ** 2)
    assert physical_diagnostics(model, covariance) == []
    values = model.start.copy()
    values[own] = -0.05
    assert "not-physical" in {d.code.name for d in physical_diagnostics(model.with_values(values), covariance)}


def test_range_of_the_joints() -> None:
    """By the description, else a whole turn, and where a slide is asked to go."""
    model = load_case("examples/scara/identify.yaml").model
    np.testing.assert_array_equal(joint_range(model), [[-np.pi] * 2, [np.pi] * 2])
    assert isinstance(model.parameters, RobotParameters)
    described = model.parameters.model.description
    joints = (described.joints[0].model_copy(update={"limits": (-1.0, 2.0)}), Joint(type="prismatic"))
    other = RobotModel(described.model_copy(update={"joints": joints, "identified": "computed"}))
    moved = model.with_loop(parameters=replace(model.parameters, model=other))
    reached = [e.reference.column("q2") for e in model.experiments.values()]
    lowest, highest = min(0.0, *(q.min() for q in reached)), max(0.0, *(q.max() for q in reached))
    np.testing.assert_allclose(joint_range(moved), [[-1.0, lowest], [2.0, highest]])


def test_limits_of_a_joint() -> None:
    joint = {"type": "revolute", "limits": ["-pi/2", 2.0]}
    described = RobotDescription.model_validate({"name": "arm", "joints": [joint]})
    assert described.joints[0].limits == (-np.pi / 2, 2.0)
    with pytest.raises(ValueError, match="the first limit must be less than the second"):
        RobotDescription.model_validate({"name": "arm", "joints": [{**joint, "limits": [1.0, 1.0]}]})


def test_refusal_names_joint_and_parameter() -> None:
    """The last motor inertia below zero; and a diagonal element: gravity turns joint 2 of the arm by inertia alone."""
    model, base, truth, _ = robot("tx40")
    parameters = RobotParameters(model, base)
    values = truth.copy()
    values[base.names.index("Ia6")] = -0.02
    problem = parameters.inertia_problem(np.zeros((3, 6)), values)
    assert "joint 6, most of it by Ia6 = -0.02 kg.m2" in problem
    assert parameters.inertia_problem(np.zeros((3, 6)), truth) == ""
