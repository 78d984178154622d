"""The ellipsoid of a link has its mass, centre and inertia; what no body has is told."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fmu_didim.dynamics.robot.body import Body, parameters_of
from fmu_didim.dynamics.robot.ellipsoid import Ellipsoid, ellipsoid_of


@pytest.mark.parametrize("seed", range(5))
def test_it_is_that_of_a_body_in_any_posture(seed: int) -> None:
    rng = np.random.default_rng(seed)
    mass, radii, centre = rng.uniform(0.1, 20), np.sort(rng.uniform(0.01, 0.5, 3)), rng.normal(size=3)
    turn = Rotation.random(random_state=seed).as_matrix()
    own = mass / 5 * (np.sum(radii**2) - radii**2)
    about = mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    found = ellipsoid_of(parameters_of(Body(mass, mass * centre, turn @ np.diag(own) @ turn.T + about)))
    assert isinstance(found, Ellipsoid)
    assert found.mass == pytest.approx(mass)
    assert found.centre == pytest.approx(centre)
    assert np.sort(found.radii) == pytest.approx(radii, rel=1e-6)
    along = np.abs(found.axes.T @ turn)  # the same axes, in the order of the moments, whatever their sign
    assert along[np.argsort(found.radii)] == pytest.approx(np.eye(3), abs=1e-6)


def test_a_rod_and_a_plate_are_flat() -> None:
    rod = ellipsoid_of({"M": 2.0, "YY": 0.1, "ZZ": 0.1})
    plate = ellipsoid_of({"M": 2.0, "XX": 0.1, "YY": 0.1, "ZZ": 0.2})
    assert isinstance(rod, Ellipsoid)
    assert isinstance(plate, Ellipsoid)
    assert np.sum(rod.radii < 1e-4) == 2
    assert np.sum(plate.radii < 1e-4) == 1


@pytest.mark.parametrize(
    ("parameters", "reason"),
    [
        ({}, "its mass is not given"), ({"ZZ": 3.43}, "its mass is not given"), ({"M": -1.0}, "its mass is -1 kg"),
        ({"M": 1.0}, "its inertia is not given"), ({"M": 1.0, "MX": 0.5, "YY": 0.25, "ZZ": 0.25}, "in one point"),
        ({"M": 1.0, "XX": 0.1, "YY": 0.1, "ZZ": 0.3}, "no body has"), ({"M": 1.0, "ZZ": -0.1}, "no body has"),
    ],
)  # fmt: skip
def test_what_has_none(parameters: dict[str, float], reason: str) -> None:
    found = ellipsoid_of(parameters)
    assert isinstance(found, str)
    assert reason in found
