"""Whether a motion is another one: by what was moved, not by its label or its phase."""

from __future__ import annotations

import numpy as np
import pytest

from fmu_didim.data.signals import Trajectory, trajectory
from fmu_didim.discovery.ladder.motions import MOSTLY_NEW, new_part, velocities
from fmu_didim.discovery.next_experiment.climbing import climbing_motion, slower
from fmu_didim.estimators.starts.reference_start import reference_motion
from tests.discovery.helpers import sines


def shifted(motion: Trajectory, seconds: float) -> Trajectory:
    kept = motion.time >= seconds
    return Trajectory(motion.time[kept] - seconds, motion.values[kept], motion.variables)


def test_the_same_motion_at_another_phase_is_not_new() -> None:
    motion = sines(12.0, joints=2)
    assert new_part(shifted(motion, 1.37), motion, 2) == 0.0
    assert new_part(motion, sines(4.0, joints=2), 2) < MOSTLY_NEW  # more periods of it


def test_another_motion_is_new() -> None:
    motion = sines(12.0, joints=2)
    assert new_part(sines(12.0, joints=2, period_s=5.0), motion, 2) == 1.0
    assert new_part(slower(motion, 2, 2.0), motion, 2) > MOSTLY_NEW


def test_the_same_move_elsewhere_is_new() -> None:
    motion = sines(12.0)
    moved = Trajectory(motion.time, motion.values + np.array([1.0, 0.0, 0.0]), motion.variables)
    assert new_part(moved, motion, 1) == 1.0


def test_a_joint_that_stood_still_makes_a_motion_new() -> None:
    time = np.arange(0.0, 8.0, 0.005)
    still = trajectory(time, {"q1": np.sin(time), "q2": np.zeros(time.size)})
    other = trajectory(time, {"q1": np.sin(time), "q2": 0.5 * np.sin(3 * time)})
    assert new_part(other, still, 2) > MOSTLY_NEW
    assert new_part(still, still, 2) == 0.0


def test_a_reference_of_velocities_alone_is_compared_by_them() -> None:
    """As of a speed drive."""
    motion, other = (one.select(["dq1"])[:, 0] for one in (sines(12.0), sines(12.0, period_s=5.0)))
    time = sines(12.0).time
    first, second = (trajectory(time, {"dq1": values}) for values in (motion, other))
    assert new_part(first, first, 1) == 0.0
    assert new_part(second, first, 1) == 1.0
    assert np.array_equal(velocities(first, 1)[:, 0], motion)
    unknown = trajectory(time, {"target": motion})
    assert np.isnan(velocities(unknown, 1)).all()
    assert new_part(unknown, unknown, 1) == 0.0
    assert new_part(unknown, sines(12.0), 1) == 1.0  # nothing to compare by


def test_a_part_of_it_may_be_new() -> None:
    before, later = sines(8.0), sines(8.0, period_s=5.0)
    time = np.concatenate([before.time, 8.0 + later.time])
    both = Trajectory(time, np.vstack([before.values, later.values]), before.variables)
    assert 0.3 < new_part(both, before, 1) < 0.8


def test_a_slower_motion_keeps_path_and_period() -> None:
    motion = sines(4.0, joints=2)
    found = slower(motion, 2, 2.5)
    assert np.diff(found.time) == pytest.approx(np.diff(motion.time)[0])
    (q, dq, ddq), (own, _, _) = reference_motion(found, 2), reference_motion(motion, 2)
    assert q[-1] == pytest.approx(own[-1], abs=1e-3)
    assert np.gradient(q, found.time, axis=0)[5:-5] == pytest.approx(dq[5:-5], abs=0.02)
    assert np.gradient(dq, found.time, axis=0)[5:-5] == pytest.approx(ddq[5:-5], abs=0.1)


def speed(motion: Trajectory) -> float:
    return float(np.sqrt(np.mean(reference_motion(motion, 1)[1] ** 2)))


def test_the_motion_of_each_rung_counts_for_it_and_shows_most_of_the_effect() -> None:
    present = [sines(8.0)]
    faster = climbing_motion("speed", present, 1, joint=1, excited=speed)
    slow = climbing_motion("speed", present, 1, joint=1, excited=lambda motion: 1 / speed(motion))
    assert faster is not None and slow is not None
    assert speed(slow.reference) < speed(present[0]) / 1.5
    assert slow.excited > slow.excited_now == pytest.approx(1 / speed(present[0]))
    other = climbing_motion("held_out", present, 1, joint=1, excited=lambda motion: 0.1)
    assert other is not None and not other.is_enough
    assert new_part(other.reference, present[0], 1) > MOSTLY_NEW
    unknown = climbing_motion("held_out", present, 1, joint=1, excited=None)
    assert unknown is not None and unknown.is_enough and np.isnan(unknown.excited)
