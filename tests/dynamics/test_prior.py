"""The prior of the base parameters: the metric of pseudo-inertias, and what regrouping makes of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fmu_didim.base.errors import InputError
from fmu_didim.data.signals import Array
from fmu_didim.dynamics.base_parameters import base_parameters
from fmu_didim.dynamics.prior import link_covariance, prior_of
from fmu_didim.dynamics.robot import RobotModel, read_robot
from tests.helpers import ROOT

ORDER = ("XX", "YY", "ZZ", "XY", "XZ", "YZ", "MX", "MY", "MZ", "M")


def pseudo_inertia(values: Array) -> Array:
    """By its definition: second moments, first moments and mass."""
    xx, yy, zz, xy, xz, yz, mx, my, mz, mass = values
    second = np.array([[(yy + zz - xx) / 2, -xy, -xz], [-xy, (xx + zz - yy) / 2, -yz], [-xz, -yz, (xx + yy - zz) / 2]])
    first = np.array([[mx], [my], [mz]])
    return np.block([[second, first], [first.T, np.array([[mass]])]])


def of_pseudo_inertia(p: Array) -> Array:
    """The reverse."""
    a, b, c = p[0, 0], p[1, 1], p[2, 2]
    return np.array([b + c, a + c, a + b, -p[0, 1], -p[0, 2], -p[1, 2], *p[:3, 3], p[3, 3]])


def some_body(seed: int) -> Array:
    """Inertial parameters of points with masses."""
    rng = np.random.default_rng(seed)
    points = np.column_stack([rng.normal(0.1, 0.2, (20, 3)), np.ones(20)])
    return of_pseudo_inertia((points * rng.uniform(0.1, 1.0, 20)[:, None]).T @ points)


@pytest.mark.parametrize("seed", range(5))
def test_the_covariance_is_that_of_the_metric(seed: int) -> None:
    """(phi - phi0)' C^-1 (phi - phi0) s^2 = tr[(P0^-1 (P - P0))^2]."""
    nominal, other = some_body(seed), some_body(seed + 100)
    moved = other - nominal
    p0 = pseudo_inertia(nominal)
    step = np.linalg.solve(p0, pseudo_inertia(other) - p0)
    found = moved @ np.linalg.solve(link_covariance(nominal, 0.3), moved)
    assert found * 0.3**2 == pytest.approx(np.trace(step @ step), rel=1e-8)


@pytest.mark.parametrize("seed", range(3))
def test_mass_and_second_moments_have_the_stated_relative_deviation(seed: int) -> None:
    nominal = some_body(seed)
    covariance = link_covariance(nominal, 0.2)
    assert np.sqrt(covariance[-1, -1]) == pytest.approx(0.2 * nominal[-1])
    of_x = np.array([-0.5, 0.5, 0.5, *np.zeros(7)])
    assert np.sqrt(of_x @ covariance @ of_x) == pytest.approx(0.2 * of_x @ nominal)


def test_it_does_not_depend_on_the_frame() -> None:
    """The covariance in another frame is that of the body in that frame."""
    nominal = some_body(1)
    rng = np.random.default_rng(0)
    rotation = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    move = np.block([[rotation, rng.standard_normal((3, 1))], [np.zeros((1, 3)), np.ones((1, 1))]])

    def moved(values: Array) -> Array:
        return of_pseudo_inertia(move @ pseudo_inertia(values) @ move.T)

    table = np.column_stack([moved(column) for column in np.eye(10)])
    expected = table @ link_covariance(nominal, 0.1) @ table.T
    assert link_covariance(moved(nominal), 0.1) == pytest.approx(expected, abs=1e-12 * np.abs(expected).max())


@pytest.fixture(scope="module")
def robot() -> RobotModel:
    return RobotModel(read_robot(ROOT / "examples/double_pendulum/robot.yaml"))


@pytest.fixture(scope="module")
def nominal() -> dict[str, float]:
    description = read_robot(ROOT / "examples/double_pendulum/published.yaml")
    return {v.name: v.start for v in description.standard_parameters()}


def test_base_parameters_have_the_regrouped_mean_and_deviation(robot: RobotModel, nominal: dict[str, float]) -> None:
    """ZZ1R = ZZ1 + Ia1 + 0.09 M2, independent links."""
    base = base_parameters(robot)
    found = prior_of(robot, base, nominal, links={1: 0.2, 2: 0.1}, single={"Ia1": 0.001}, source="")
    links = [link_covariance(np.array([nominal[f"{n}{j}"] for n in ORDER]), s) for j, s in ((1, 0.2), (2, 0.1))]
    place = base.names.index("ZZ1R")
    assert found.mean[place] == pytest.approx(nominal["ZZ1"] + nominal["Ia1"] + 0.09 * nominal["M2"])
    assert found.deviation[place] ** 2 == pytest.approx(
        links[0][2, 2] + 0.001**2 + 0.09**2 * links[1][9, 9], rel=1e-9
    )  # fmt: skip
    assert np.isinf(found.deviation[base.names.index("Fv1")])
    assert found.rows.shape == (6, base.count)
    # As rows of a least squares problem it has this mean and this covariance.
    kept = [base.names.index(n) for n in ("ZZ1R", "MX1R", "MY1", "ZZ2", "MX2", "MY2")]
    inverse = np.linalg.inv(found.rows[:, kept].T @ found.rows[:, kept])
    assert np.sqrt(np.diag(inverse)) == pytest.approx(found.deviation[kept], rel=1e-9)
    assert found.rows[:, kept] @ found.mean[kept] == pytest.approx(found.target, rel=1e-9)
    # Both have the mass of link 2.
    shared = inverse[0, 4] - 0.09 * links[1][9, 6]
    assert shared == pytest.approx(0.0, abs=1e-12)


def test_what_nobody_states_takes_the_prior_of_its_sum(robot: RobotModel, nominal: dict[str, float]) -> None:
    """Nothing is known of Ia1: nothing is known of ZZ1R, everything else stays."""
    base = base_parameters(robot)
    whole = prior_of(robot, base, nominal, links={1: 0.2, 2: 0.2}, single={"Ia1": 0.001}, source="")
    found = prior_of(robot, base, nominal, links={1: 0.2, 2: 0.2}, single={}, source="")
    assert dict(found.open) == {"ZZ1R": ("Ia1",)}
    place = base.names.index("ZZ1R")
    assert np.isinf(found.deviation[place])
    assert (found.rows[:, place] == 0).all()
    others = [i for i in range(base.count) if i != place and np.isfinite(whole.deviation[i])]
    expected = np.linalg.inv(np.linalg.inv(_covariance(whole, [place, *others])[1:, 1:]))
    assert _covariance(found, others) == pytest.approx(expected, rel=1e-8)


def _covariance(prior: object, kept: list[int]) -> Array:
    rows = prior.rows[:, kept]  # type: ignore[attr-defined]
    return np.asarray(np.linalg.inv(rows.T @ rows))


def test_one_joint_alone_has_what_no_other_is_a_part_of(robot: RobotModel, nominal: dict[str, float]) -> None:
    base = base_parameters(robot)
    found = prior_of(robot, base, nominal, links={1: 0.2}, single={"Ia1": 0.001}, source="")
    assert [n for n, d in zip(base.names, found.deviation, strict=True) if np.isfinite(d)] == ["MY1"]
    assert dict(found.open) == {"ZZ1R": ("M2",), "MX1R": ("M2",)}
    # That both have the mass of link 2 says something of  ZZ1R - 0.3 MX1R.
    assert found.rows.shape[0] == 2


def test_what_is_known_conditions_its_link(robot: RobotModel, nominal: dict[str, float]) -> None:
    """A mass that the model holds at its value: what goes with it is known better, and moves with it."""
    base = base_parameters(robot)
    place = base.standard_names.index("M2")
    held = replace(base, known=np.where(np.arange(base.known.size) == place, 0.7, base.known))
    held = replace(held, regrouping=np.where(held.dependent == place, 0.0, held.regrouping))
    found = prior_of(robot, held, nominal, links={1: 0.2, 2: 0.2}, single={"Ia1": 0.001}, source="")
    covariance = link_covariance(np.array([nominal[f"{n}2"] for n in ORDER]), 0.2)
    k = base.names.index("MX2")
    gain = covariance[6, 9] / covariance[9, 9]
    assert found.mean[k] == pytest.approx(nominal["MX2"] + gain * (0.7 - nominal["M2"]))
    assert found.deviation[k] ** 2 == pytest.approx(covariance[6, 6] - gain * covariance[6, 9])


@pytest.mark.parametrize(
    ("changes", "got"),
    [({"M2": 0.0}, "no mass"), ({"XX2": 0.0}, "negative second moments"), ({"MX2": 0.2}, "not positive definite")],
)
def test_a_link_that_is_no_body_is_refused_by_name(
    robot: RobotModel, nominal: dict[str, float], changes: dict[str, float], got: str
) -> None:
    with pytest.raises(InputError, match=got) as caught:
        prior_of(robot, base_parameters(robot), {**nominal, **changes}, links={2: 0.2}, single={}, source="cad.yaml")
    assert "link 2" in str(caught.value)
    assert "cad.yaml" in str(caught.value)


def test_a_prior_that_says_nothing_is_refused(robot: RobotModel, nominal: dict[str, float]) -> None:
    with pytest.raises(InputError, match="says nothing"):
        prior_of(robot, base_parameters(robot), nominal, links={}, single={}, source="")
