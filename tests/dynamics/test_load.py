"""A load on the last link: what of it base parameters show, what it can be, and its mass, centre and inertia."""

from __future__ import annotations

import numpy as np
import pytest

from fmu_didim.dynamics.base_parameters import base_parameters
from fmu_didim.dynamics.load import STEMS, body_of, load_of
from fmu_didim.dynamics.prior import prior_of_values, with_known
from fmu_didim.dynamics.robot import RobotDescription, RobotModel, read_robot
from tests.helpers import ROOT

CENTRE, MASS = np.array([0.05, -0.12, 0.2]), 1.7
ABOUT = np.array([[0.02, 0.003, -0.001], [0.003, 0.015, 0.002], [-0.001, 0.002, 0.01]])
"""[kg.m2] Inertia about the centre."""


def standard() -> dict[str, float]:
    """The load as parameters of a link: I about the frame is that about the centre and M (c'c 1 - c c')."""
    about = ABOUT + MASS * (CENTRE @ CENTRE * np.eye(3) - np.outer(CENTRE, CENTRE))
    first = {f"M{axis}": float(MASS * c) for axis, c in zip("XYZ", CENTRE, strict=True)}
    moments = {a + b: float(about["XYZ".index(a), "XYZ".index(b)]) for a, b in ("XX", "YY", "ZZ", "XY", "XZ", "YZ")}
    return {"M": MASS, **first, **moments}


def arm(joints: int = 3) -> RobotDescription:
    """Joints about axes of three directions, with gravity: the last link moves in all of them."""
    angles = (0.0, np.pi / 2, -np.pi / 2)
    return RobotDescription.model_validate({
        "schema": 1, "name": "arm", "gravity": [0, 0, -9.81],
        "joints": [
            {"type": "revolute", "alpha": angles[j % 3], "a": 0.3 * (j > 0), "d": 0.1,
             "parameters": {"M": 2.0, "XX": 0.1, "YY": 0.1, "ZZ": 0.1, "MX": 0.2}}
            for j in range(joints)
        ],
    })  # fmt: skip


@pytest.mark.parametrize("known", [(), ("M",), ("M", "MX", "MY", "MZ"), STEMS])
def test_base_parameters_move_by_what_is_free_and_what_is_known(known: tuple[str, ...]) -> None:
    model, chi = RobotModel(arm()), standard()
    base = base_parameters(model)
    load = load_of(model, base, {stem: chi[stem] for stem in known})
    whole = np.zeros(len(base.standard_names))
    for stem, value in chi.items():
        whole[base.standard_names.index(f"{stem}3")] = value
    values = load.regrouping @ np.array([chi[stem] for stem in STEMS])
    assert load.directions @ values + load.shift == pytest.approx(base.reduce(whole), abs=1e-12)
    assert not set(load.stems) & set(known)
    assert np.linalg.matrix_rank(load.directions) == len(load.stems)


def test_what_a_robot_in_a_plane_does_not_feel_is_named() -> None:
    model = RobotModel(read_robot(ROOT / "fmus/scara/robot.yaml"))
    load = load_of(model, base_parameters(model))
    assert load.names == ("load_M", "load_MX", "load_MY", "load_ZZ")
    assert load.alone == load.stems
    assert set(load.unseen) == {"MZ", "XX", "YY", "XY", "XZ", "YZ"}


@pytest.mark.parametrize("known", [(), ("M",)])
def test_mass_centre_and_inertia_come_back_with_their_deviations(known: tuple[str, ...]) -> None:
    """The deviations are those of draws."""
    model, chi = RobotModel(arm(6)), standard()
    load = load_of(model, base_parameters(model), {stem: chi[stem] for stem in known})
    if set(load.stems) | set(known) != set(STEMS) or load.alone != load.stems:
        pytest.fail(f"not all of the load is seen: {load.names}")
    values, rng = np.array([chi[stem] for stem in load.stems]), np.random.default_rng(0)
    root = 1e-4 * rng.normal(size=(values.size, values.size))
    body = body_of(load, values, root @ root.T)
    truth = {"mass": MASS, **{f"c{a}": c for a, c in zip("xyz", CENTRE, strict=True)}}
    truth |= {f"I{a}{b}": ABOUT["xyz".index(a), "xyz".index(b)] for a, b in ("xx", "yy", "zz", "xy", "xz", "yz")}
    assert {name: value for name, (value, _) in body.items()} == pytest.approx(truth, abs=1e-12)
    drawn = [body_of(load, values + root @ rng.normal(size=values.size), root @ root.T) for _ in range(2000)]
    for name, (_, sigma) in body.items():
        spread = np.std([one[name][0] for one in drawn])
        assert sigma == pytest.approx(spread, rel=0.08, abs=1e-15), name
    assert (body["mass"][1] == 0) == ("M" in known)


@pytest.mark.parametrize("known", [(), ("M",), ("M", "MX", "MY", "MZ")])
def test_a_body_is_in_the_set_and_what_is_none_is_not(known: tuple[str, ...]) -> None:
    model, chi = RobotModel(arm(6)), standard()
    load = load_of(model, base_parameters(model), {stem: chi[stem] for stem in known})
    physical = load.physical
    free = [stem for stem in STEMS if stem not in known]

    def smallest(changed: dict[str, float]) -> float:
        x = np.array([(chi | changed)[stem] for stem in free]) / physical.sizes
        return float(np.linalg.eigvalsh(physical.matrices(physical.fixed + physical.table @ x)).min())

    assert smallest({}) > 0
    assert smallest({"XX": 0.0}) < 0
    assert smallest({"XX": 3 * chi["XX"]}) < 0  # more than the other two together
    if "M" not in known:
        assert smallest({"M": -0.1}) < 0
        assert smallest({"M": 0.1}) < 0  # the first moments are too large for it


def test_an_earlier_result_is_a_prior_with_its_covariance() -> None:
    rng = np.random.default_rng(1)
    root = rng.normal(size=(5, 5)) * np.array([1, 10, 0.1, 1, 1])[:, None]
    mean, covariance = rng.normal(size=5), root @ root.T
    prior = prior_of_values(mean, covariance, "there")
    assert np.linalg.inv(prior.rows.T @ prior.rows) == pytest.approx(covariance, rel=1e-6)
    assert prior.residual(mean) == pytest.approx(np.zeros(5), abs=1e-9)
    more = with_known(prior, 7, {6: (2.0, 0.1)}, "a mass")
    there = np.append(mean, [123.0, 2.2])
    assert np.sum(more.residual(there) ** 2) == pytest.approx(4.0)
    assert more.source == "there and a mass"
    assert np.isinf(more.deviation[5]) and more.deviation[6] == 0.1
    alone = with_known(None, 3, {1: (2.0, 0.5)}, "a mass")
    assert alone.rows.tolist() == [[0.0, 2.0, 0.0]] and alone.target.tolist() == [4.0]
