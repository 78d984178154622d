"""Whether a motion is another one, or a part of it was made before."""

from __future__ import annotations

import numpy as np

from fmu_didim.data.signals import Array, Trajectory
from fmu_didim.estimators.starts.reference_start import reference_motion

STRETCH_S = 2.0
"""[s] Of a motion that is looked for in another one: a move of a robot with its begin and end; of one move alone any
other begins alike."""
SAME_MOTION = 0.1
"""[1] Distance of two stretches in standard deviations of position and velocity, below which they are the same motion:
1 % of the power, less than what differs between two runs of one program."""
MOSTLY_NEW = 0.5
"""[1] Part of a motion that must not have been made before, for it to be another motion."""
GRID_HZ = 200.0
"""[Hz] At which motions are compared: robots move below 20 Hz."""


def new_part(motion: Trajectory, before: Trajectory, joints: int) -> float:
    """The part of a motion, in time, that another one does not hold at any instant.

    That a log follows the reference of another one as a whole is told before (``validation-repeats-motion``); a motion
    may also be put together of parts of another one, or repeat it while something is injected.

    Both are cut to q and dq of all joints on one grid, in standard deviations of the earlier one, and each stretch x of
    the later one is compared with each stretch of the earlier one that is as long:

        d(lag)^2 = mean |y(lag + k) - x(k)|^2,   the same motion if the least d is below SAME_MOTION.
    """
    own, other = (_on_grid(one, joints) for one in (motion, before))
    if own.shape[1] != other.shape[1]:
        return 1.0
    middle, spread = other.mean(axis=0), other.std(axis=0)
    spread[spread == 0] = spread[spread > 0].min(initial=1.0)  # of a joint that stood still
    own, other = (own - middle) / spread, (other - middle) / spread
    length = min(round(STRETCH_S * GRID_HZ), own.shape[0], other.shape[0])
    count = max(own.shape[0] // length, 1)
    begins = np.linspace(0, own.shape[0] - length, count).round().astype(int)
    new = [_nearest(own[begin : begin + length], other) > SAME_MOTION for begin in begins]
    return float(np.mean(new))


def velocities(motion: Trajectory, joints: int) -> Array:
    """(K, n) velocity of each joint along a reference; NaN where it states none, nor a position."""
    wanted = [f"dq{j}" for j in range(1, joints + 1)]
    if set(wanted) <= set(motion.names):
        return motion.select(wanted)
    if _has_positions(motion, joints):
        return reference_motion(motion, joints)[1]
    return np.full((motion.time.size, joints), np.nan)


def _has_positions(motion: Trajectory, joints: int) -> bool:
    return {f"q{j}" for j in range(1, joints + 1)} <= set(motion.names)


def _moved(motion: Trajectory, joints: int) -> Array:
    """(K, m) positions and velocities of a reference, or velocities alone, as of a speed drive; all that it has, if
    neither is there."""
    if _has_positions(motion, joints):
        return np.hstack([reference_motion(motion, joints)[0], velocities(motion, joints)])
    found = velocities(motion, joints)
    return motion.values if np.isnan(found).any() else found


def _on_grid(motion: Trajectory, joints: int) -> Array:
    """(K, m) what is moved, on the grid."""
    table = _moved(motion, joints)
    count = max(round(float(np.ptp(motion.time)) * GRID_HZ) + 1, 2)
    time = np.linspace(motion.time[0], motion.time[-1], count)
    return np.column_stack([np.interp(time, motion.time, column) for column in table.T])


def _nearest(stretch: Array, table: Array) -> float:
    """Least distance of a stretch (L, m) from those of a table (K, m)."""
    length, count = stretch.shape[0], table.shape[0]
    size = 1 << (count + length - 1).bit_length()
    spectra = np.fft.rfft(table, size, axis=0) * np.conj(np.fft.rfft(stretch, size, axis=0))
    product = np.fft.irfft(spectra.sum(axis=1), size)[: count - length + 1]
    squares = np.concatenate([[0.0], np.cumsum(np.sum(table**2, axis=1))])
    energy = squares[length:] - squares[: count - length + 1]
    least = float((energy - 2 * product).min() + np.sum(stretch**2))
    return float(np.sqrt(max(least, 0.0) / stretch.size))
