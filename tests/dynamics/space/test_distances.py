"""Clearances of capsules and boxes against brute force on drawn ones, and what lies between two instants."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from fmu_didim.dynamics.robot import RobotDescription
from fmu_didim.dynamics.space.distances import between_segments, to_box
from fmu_didim.dynamics.space.space import Box, Capsule, Space, all_checks

POINTS = [ca.SX.sym(name, 3) for name in "pqrs"]
SEGMENTS = ca.Function("segments", POINTS, [between_segments(*POINTS)])
TO_BOX = ca.Function("to_box", POINTS, [to_box(*POINTS)])
KINDS = ["askew", "parallel", "a point", "two points", "crossing"]


def drawn(kind: str, rng: np.random.Generator) -> list[np.ndarray]:
    p, q, r, s = rng.normal(size=(4, 3))
    if kind == "parallel":
        s = r + rng.uniform(-2, 2) * (q - p)
    elif kind == "a point":
        q = p
    elif kind == "two points":
        q, s = p, r
    elif kind == "crossing":
        s = 2 * (p + q) / 2 - r
    return [p, q, r, s]


def on(p: np.ndarray, q: np.ndarray, count: int) -> np.ndarray:
    return p + np.linspace(0, 1, count)[:, None] * (q - p)


@pytest.mark.parametrize("kind", KINDS)
def test_distance_of_segments_is_that_of_their_nearest_points(kind: str) -> None:
    rng = np.random.default_rng(KINDS.index(kind))
    for _ in range(20):
        p, q, r, s = drawn(kind, rng)
        table = np.linalg.norm(on(p, q, 401)[:, None] - on(r, s, 401)[None], axis=-1)
        step = (np.linalg.norm(q - p) + np.linalg.norm(s - r)) / 800
        found = float(SEGMENTS(p, q, r, s))
        assert table.min() - step <= found <= table.min() + 1e-7


@pytest.mark.parametrize("is_inside", [False, True])
def test_distance_of_a_segment_from_a_box_is_signed(is_inside: bool) -> None:
    rng = np.random.default_rng(11)
    for _ in range(20):
        p, q, r, s = rng.normal(size=(4, 3))
        low, high = np.minimum(r, s), np.maximum(r, s)
        if is_inside:
            p, q = (rng.uniform(low, high) for _ in range(2))
        x = on(p, q, 4001)
        outside = np.linalg.norm(x - np.clip(x, low, high), axis=1)
        depth = np.minimum(x - low, high - x).min(axis=1)
        brute = np.where(outside > 0, outside, -depth).min()
        assert float(TO_BOX(p, q, low, high)) == pytest.approx(brute, abs=2e-3)
        assert (brute < 0) or not is_inside


def test_derivatives_outside_are_those_of_the_distance() -> None:
    rng, jacobian = np.random.default_rng(5), ca.jacobian(to_box(*POINTS), ca.vertcat(*POINTS))
    slope = ca.Function("slope", POINTS, [jacobian])
    for p, q in rng.normal(size=(30, 2, 3)):
        x = np.concatenate([p, q, [-0.3, -0.4, -0.2], [0.3, 0.4, 0.2]])
        if float(TO_BOX(*x.reshape(4, 3))) < 0.05:
            continue
        own = slope(*x.reshape(4, 3)).full()[0]
        for i in range(6):
            moved = [float(TO_BOX(*(x + h * np.eye(12)[i]).reshape(4, 3))) for h in (-1e-3, 1e-3)]
            assert own[i] == pytest.approx((moved[1] - moved[0]) / 2e-3, abs=0.02)


def arm() -> RobotDescription:
    joints = [{"type": "revolute"}, {"type": "revolute", "a": 0.5, "alpha": 0.4}, {"type": "prismatic", "a": 0.3}]
    return RobotDescription.model_validate({"name": "arm", "joints": joints})


def test_between_two_instants_nothing_thin_is_passed() -> None:
    """A wall of 1 mm between two instants: at both the arm is clear of it, in between it is not."""
    robot = RobotDescription.model_validate({"name": "one", "joints": [{"type": "revolute"}]})
    wall = Box((0.2, -0.0005, -1.0), (0.6, 0.0005, 1.0))
    space = Space(robot, all_checks([Capsule(1, (0.0, 0.0, 0.0), (0.5, 0.0, 0.0))], [wall]))
    q = np.array([[-0.05], [0.05]])
    assert (space.at(q) > 0).all() and space.along(q).max() < 0


def test_what_lies_between_is_never_less_than_what_is_said() -> None:
    capsules = [Capsule(0, (0, 0, -0.3), (0, 0, 0.3), 0.05), Capsule(3, (0, 0.1, 0), (0.2, 0, 0.1), 0.03)]
    box, wall = Box((0.4, 0.2, -0.2), (0.6, 0.4, 0.2), name="box 1"), Box((-1, -1, -1), (1, 1, 1), is_around=True)
    space = Space(arm(), all_checks(capsules, [box, wall]))
    assert space.names == ("link 3, link 0", "link 3, box 1", "link 3, box")
    rng = np.random.default_rng(3)
    for _ in range(20):
        a, b = rng.normal(size=(2, 3))
        b = a + 0.05 * b
        bound = space.along(np.array([a, b]))[0]
        least = space.at(a + np.linspace(0, 1, 101)[:, None] * (b - a)).min(axis=0)
        assert (bound <= least + 2e-3 * np.linalg.norm(b - a)).all()  # the chord is a little less than the arc
        assert np.allclose(space.at(a[None])[0, 2], _inside(a), atol=1e-9)


def _inside(q: np.ndarray) -> float:
    """Of capsule 3 from the walls, by matrices."""
    turn, origin = np.eye(3), np.zeros(3)
    for angle, a, alpha, d in ((q[0], 0, 0, 0), (q[1], 0.5, 0.4, 0), (0, 0.3, 0, q[2])):
        c, s, ca_, sa = np.cos(angle), np.sin(angle), np.cos(alpha), np.sin(alpha)
        own = np.array([[c, -s, 0], [ca_ * s, ca_ * c, -sa], [sa * s, sa * c, ca_]])
        origin = origin + turn @ np.array([a, -d * sa, d * ca_])
        turn = turn @ own
    ends = [origin + turn @ np.array(end) for end in ((0, 0.1, 0), (0.2, 0, 0.1))]
    return float(min(np.minimum(end + 1, 1 - end).min() for end in ends) - 0.03)
