"""Standard parameters of links that exist, from base parameters that were identified."""

from __future__ import annotations

import numpy as np
import pytest

from fmu_didim.data.signals import Array
from fmu_didim.dynamics.base_parameters import BaseParameters
from fmu_didim.dynamics.robot import RobotModel
from fmu_didim.dynamics.standard_parameters import StandardParameters, standard_parameters
from fmu_didim.model.parameters import RobotParameters
from tests.checks.data.right import loaded

ROBOTS = ["scara", "arm", "axis", "rv2sq", pytest.param("tx40", marks=pytest.mark.gate)]


def of(robot: str) -> tuple[RobotModel, BaseParameters, Array]:
    """A robot, its base parameters and their values."""
    model = loaded(robot)
    assert isinstance(model.parameters, RobotParameters)
    return model.parameters.model, model.parameters.base, model.theta(model.start)[: model.parameters.base.count]


def some(values: Array) -> Array:
    """A covariance of about 1 %."""
    return np.diag((0.01 * np.abs(values) + 1e-4 * np.abs(values).max()) ** 2)


def pseudo_inertias(found: StandardParameters, joints: int) -> Array:
    """(n, 4, 4)."""
    result = np.zeros((joints, 4, 4))
    for j in range(1, joints + 1):
        v = {
            name: found.values.get(f"{name}{j}", 0.0)
            for name in ["XX", "XY", "XZ", "YY", "YZ", "ZZ", "MX", "MY", "MZ", "M"]
        }
        tensor = np.array([[v["XX"], v["XY"], v["XZ"]], [v["XY"], v["YY"], v["YZ"]], [v["XZ"], v["YZ"], v["ZZ"]]])
        h = np.array([v["MX"], v["MY"], v["MZ"]])
        result[j - 1, :3, :3] = 0.5 * np.trace(tensor) * np.eye(3) - tensor
        result[j - 1, :3, 3] = result[j - 1, 3, :3] = h
        result[j - 1, 3, 3] = v["M"]
    return result


@pytest.mark.parametrize("in_links", [False, True])
@pytest.mark.parametrize("robot", ROBOTS)
def test_links_exist_and_have_the_base_parameters(robot: str, in_links: bool) -> None:
    model, base, values = of(robot)
    found = standard_parameters(model, base, values, some(values), in_links=in_links)
    assert found.away < 0.01
    np.testing.assert_allclose(found.base, values, rtol=0, atol=1e-5 * np.abs(values).max())
    chi = np.array(list(found.values.values()))
    np.testing.assert_allclose(base.reduce(chi), found.base, rtol=1e-12)
    if robot != "axis":  # whose mass alone acts
        assert np.linalg.eigvalsh(pseudo_inertias(found, model.joint_count)).min() > 0
    assert all(value >= 0 for name, value in found.values.items() if name.startswith("Ia"))


def test_links_hold_motor_inertias_that_no_data_tell_from_theirs() -> None:
    model, base, values = of("tx40")
    found = standard_parameters(model, base, values, some(values), in_links=True).values
    assert found["Ia1"] == found["Ia2"] == 0.0  # regrouped with ZZ1 and ZZ2
    assert all(found[f"Ia{j}"] > 0 for j in range(3, 7))  # identified by themselves


def test_what_data_do_not_determine_stays_as_described() -> None:
    """The values of the description itself are the nearest ones where its links exist."""
    model, base, _ = of("tx40")
    chi = model.parameter_values
    first = standard_parameters(model, base, base.reduce(chi), some(base.reduce(chi)))
    described = RobotModel(model.description.with_values(first.values))
    again = standard_parameters(described, base, first.base, some(first.base))
    for name, value in first.values.items():
        assert again.values[name] == pytest.approx(value, rel=0.02, abs=0.02), name


def test_base_parameters_that_no_links_have_are_told() -> None:
    """ZZ2 is the inertia of link 2 beside its first moments: a quarter of it leaves too little for them."""
    model, base, values = of("scara")
    values = values.copy()
    place = base.names.index("ZZ2")
    values[place] = -0.5 * values[place]
    deviation = 0.01 * np.abs(values)
    found = standard_parameters(model, base, values, np.diag(deviation**2))
    assert found.away > 10
    assert np.linalg.eigvalsh(pseudo_inertias(found, 2)).min() > 0
    # The nearest ones by their covariance: what is sure moves less than what is not.
    sure, unsure = np.diag(deviation**2), np.diag(deviation**2)
    unsure[place, place] *= 1e4
    near = standard_parameters(model, base, values, unsure)
    assert near.away < 0.2 * standard_parameters(model, base, values, sure).away


def test_negative_friction_is_written_as_none() -> None:
    model, base, values = of("scara")
    values = values.copy()
    values[base.names.index("Fv2")] = -0.1
    found = standard_parameters(model, base, values, some(values))
    assert found.moved == ("Fv2",) and found.values["Fv2"] == 0.0
