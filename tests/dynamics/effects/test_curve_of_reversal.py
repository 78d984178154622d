"""The distance since a reversal, as the curve of it sees it."""

from __future__ import annotations

import numpy as np
import pytest

from fmu_didim.data.signals import Array
from fmu_didim.dynamics.effects import Surroundings
from fmu_didim.dynamics.effects.curve_of_reversal import LENGTH, REACH, CurveOfReversal
from fmu_didim.fit.derivatives.torque_signature import TorqueSignature
from fmu_didim.model.motion import Motion

EFFECT = CurveOfReversal()
STEP = 1e-3


def motion_along(q: Array) -> Motion:
    time, none = STEP * np.arange(q.size), np.zeros((q.size, 1))
    table = q[:, None]
    return Motion(time, table, np.gradient(table, STEP, axis=0), none, none, none, STEP, {0: np.zeros((q.size, 1, 4))})


def seen_along(q: Array, length: float) -> Array:
    """(K,) the distance since the last reversal, by the states of the effect."""
    motion = motion_along(q)
    shapes = {"v0": 1e-4, "rfrom": 0.0, "rto": REACH * length}
    made = TorqueSignature(EFFECT, 0, ("revolute",), tuple(shapes))
    states = made.states(motion, shapes)
    at = Surroundings(0, "revolute", motion.q.T, motion.dq.T, motion.ddq.T, state=(states[:, 0],))
    return np.asarray(EFFECT.along(at, shapes)).ravel()


def test_after_a_long_stroke_it_is_the_distance_since_the_reversal() -> None:
    """There and back over ten lengths: from the second stroke on, up to twice the length."""
    length, stroke = 0.05, 0.5
    phase = STEP * np.arange(4000)
    q = stroke * np.abs((phase / 1.0) % 2 - 1)  # a stroke a second, from its end
    seen = seen_along(q, length)
    moved = np.where(phase % 2 < 1, stroke - q, q)
    within = (phase > 1.02) & (moved > 0.01) & (moved < 2 * length)
    np.testing.assert_allclose(seen[within], moved[within], rtol=0.05, atol=1e-3)


def test_a_short_turn_forgets_less() -> None:
    """After a turn of half a length the joint seems to have moved on already when it goes on."""
    length = 0.05
    q = np.concatenate([np.linspace(0, 0.5, 1000), np.linspace(0.5, 0.475, 50), np.linspace(0.475, 0.6, 250)])
    seen = seen_along(q, length)
    assert seen[1060] > 0.6 * length > q[1060] - q[1050]


@pytest.mark.parametrize("stroke", [0.2, 2.0])
def test_its_range_follows_from_that_of_the_joint(stroke: float) -> None:
    q = stroke * np.sin(np.linspace(0, 7, 500))
    motion = motion_along(q)
    at = Surroundings(0, "revolute", motion.q.T, motion.dq.T, motion.ddq.T)
    assert EFFECT.ends_on(at) == pytest.approx((0.0, REACH * LENGTH * np.ptp(q)))
