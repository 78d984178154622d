"""What named causes do to base parameters, beside what a changed description says."""

from __future__ import annotations

import numpy as np
import pytest

from fmu_didim.data.signals import Array
from fmu_didim.discovery.change.causes import Logged, Machine, forms_of, friction_groups
from fmu_didim.discovery.change.contest import Form
from fmu_didim.dynamics.base_parameters import base_parameters
from fmu_didim.dynamics.robot import RobotDescription, RobotModel, read_robot
from fmu_didim.model.parameters import RobotParameters
from tests.discovery.change.pairs import ROBOT, with_mass


def parameters(robot: RobotDescription) -> RobotParameters:
    model = RobotModel(robot)
    return RobotParameters(model, base_parameters(model))


def machine(path: str, logged: Logged | None = None) -> Machine:
    found = parameters(read_robot(path))
    return Machine(found, found.nominal(), logged)


def forms(one: Machine, kind: str) -> list[Form]:
    base = one.parameters.base
    return [form for form in forms_of(base.names, base.units, one) if form.kind == kind]


def test_a_point_mass_moves_base_parameters_as_the_description_with_it() -> None:
    one = machine(ROBOT)
    robot = read_robot(ROBOT)
    wanted = parameters(with_mass(robot, 0.3, 0.2, 0.05)).nominal() - one.value
    anywhere = next(form for form in forms(one, "payload") if form.names == ("mass", "cx", "cy"))
    found = 0.3 * anywhere.columns(np.array([0.2, 0.05]))[:, 0]
    np.testing.assert_allclose(found, wanted, atol=1e-12)


def test_a_mass_at_the_axis_is_told_to_be_the_same_as_an_inertia() -> None:
    at_axis = next(form for form in forms(machine(ROBOT), "payload") if form.names == ("mass",))
    assert at_axis.same_as == "ZZ1R"
    assert "ZZ1R" not in {form.names[0] for form in forms(machine(ROBOT), "parameter")}


def test_friction_is_what_depends_on_the_velocity_of_its_joint_alone() -> None:
    one = machine(ROBOT)
    names = {j: [one.parameters.base.names[i] for i in own] for j, own in friction_groups(one.parameters).items()}
    assert names == {1: ["Fv1", "Fc1"], 2: ["Fv2", "Fc2"]}


def test_friction_of_all_joints_by_one_factor_is_another_cause_than_that_of_each() -> None:
    one = machine(ROBOT)
    common, each = (forms(one, kind) for kind in ("friction_everywhere", "friction_of_each"))
    assert [form.names for form in common] == [("Fc of all", "Fv of all")]
    assert [form.names for form in each] == [("Fv1", "Fc1", "Fv2", "Fc2")]
    table = common[0].columns(np.zeros(0))
    base = one.parameters.base
    wanted = {"Fc1": 0, "Fc2": 0, "Fv1": 1, "Fv2": 1}
    for i, name in enumerate(base.names):
        for k in range(2):
            assert table[i, k] == (one.value[i] if wanted.get(name) == k else 0.0)


def test_a_torque_scale_of_one_joint_moves_what_least_squares_makes_of_it() -> None:
    one = machine(ROBOT)
    rng = np.random.default_rng(0)
    q, dq, ddq = rng.uniform(-1, 1, size=(3, 300, 2))
    regressor, known = one.parameters.regressor(q, dq, ddq)
    noise = np.array([0.2, 0.01])
    own = Machine(one.parameters, one.value, Logged(regressor, known, noise))
    second = next(form for form in forms(own, "joint_torque_scale") if form.joint == 2)
    torque = (regressor @ one.value + known) * [1.0, 1.1]
    weight = 1 / noise
    fitted = np.linalg.lstsq(
        (regressor * weight[:, None]).reshape(-1, 8), ((torque - known) * weight).ravel(), rcond=None
    )[0]
    np.testing.assert_allclose(0.1 * second.columns(np.zeros(0))[:, 0], fitted - one.value, rtol=1e-9, atol=1e-12)
    every = next(form for form in forms(own, "torque_scale"))
    np.testing.assert_allclose(every.columns(np.zeros(0))[:, 0], one.value, rtol=1e-9, atol=1e-12)


def test_without_the_motion_no_share_of_a_joint_is_looked_for() -> None:
    assert not forms(machine(ROBOT), "joint_torque_scale")
    one = forms(machine("fmus/emps/robot.yaml"), "joint_torque_scale")
    np.testing.assert_allclose(one[0].columns(np.zeros(0))[:, 0], machine("fmus/emps/robot.yaml").value)


@pytest.mark.parametrize("path", ["fmus/emps/robot.yaml", ROBOT, "fmus/tx40/robot.yaml"])
def test_no_form_has_columns_of_nothing(path: str) -> None:
    one = machine(path)
    base = one.parameters.base

    def columns(form: Form) -> Array:
        return form.columns(form.starts[0])

    for form in forms_of(base.names, base.units, one):
        assert columns(form).shape[0] == base.count
        assert np.abs(columns(form)).any(axis=0).all(), form.title
        assert form.cost == columns(form).shape[1] + form.starts.shape[1]
