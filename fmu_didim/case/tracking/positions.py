"""Measured positions as a motion that a virtual controller can follow.

The positions of a run are brought to an even grid, low-passed forward and backward, and differentiated by a spline of
the fifth degree. White noise of the deviation s in positions sampled at the rate p leaves, below the cut-off c,

    s_ddq = s (2 pi c)^2 sqrt(2 c / (5 p))
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fmu_didim.base.diagnostics import Diagnostic
from fmu_didim.base.errors import InputError
from fmu_didim.case.files import found_in, read_signals
from fmu_didim.case.runs.reference import FEWEST_ROWS, at_least_two_rows, resampled
from fmu_didim.case.sources import ExperimentSource
from fmu_didim.checks.data.log import REFERENCE_STEP
from fmu_didim.data.filters import LowPass
from fmu_didim.data.signals import Array, Trajectory, Variable, white_noise
from fmu_didim.estimators.starts.reference_start import Motion, derived_noise, motion_hz, moving_joints

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

HIGHEST = 0.2
"""[1] Of the rate of the positions, the highest bandwidth that is chosen: five positions to its period."""
HIGHEST_STATED = 0.4
"""[1] Of that rate, from which a stated bandwidth is refused: a low-pass close to half of the rate is none."""
COMPARED = 0.4
"""[1] Of the bandwidth, up to which torques are compared: there the low-pass of the positions, of the fourth order and
run twice, takes off less than 1e-3 of an acceleration, and what it takes off above is hardly seen."""
OF_THE_LOG = 0.5
"""[1] Of the rate of a torque log, the highest bandwidth with which torques are filtered: what is followed above half
of its rate would fold into what is compared. Other logs are compared as they are."""
SHOWN = OF_THE_LOG / COMPARED
"""[1] Of the rate of a torque log, the highest bandwidth that is chosen: with it the low-pass takes off only what lies
above half of that rate, which the log folds into the rest. A higher one lets in noise alone."""
NOISE = 0.007
"""[1] Part of the deviation of an acceleration that its noise may have, up to where torques are compared, if the
bandwidth is chosen: it draws inertias to zero by its square, 5e-5, and by 32 times as much with twice the bandwidth."""
NOISE_UNFILTERED = 0.02
"""[1] The same of a slow log, up to the bandwidth: a lower one would cut off what its samples show, and their values
are less precise."""
FOLLOWS = 5.0
"""[1] Least bandwidth over the highest frequency of the motion: torques are then compared up to twice that."""
ORDER = 4
"""[1] Of the low-pass of the positions."""
STEPS = 24
"""[1] Bandwidths that are tried, a quarter of an octave apart."""


@dataclass(frozen=True)
class Positions:
    """Measured positions of a run.

    Attributes:
        label: of the run; time: (K,) s, evenly spaced; q: (K, n) rad or m; told: what was found in their file.
        starts: of states of the plant that were measured, too, as of :class:`~fmu_didim.model.experiment.Experiment`.
    """

    label: str
    time: Array
    q: Array
    source: str = ""
    told: tuple[Diagnostic, ...] = ()
    starts: Mapping[str, float] = field(default_factory=dict)

    @property
    def rate_hz(self) -> float:
        """Their rate."""
        return float((self.time.size - 1) / (self.time[-1] - self.time[0]))

    def smooth(self, bandwidth_hz: float) -> Smooth:
        """The motion up to a bandwidth."""
        from scipy.interpolate import make_interp_spline  # few cases need it

        q = LowPass(bandwidth_hz, ORDER).apply(self.q, self.rate_hz)
        return Smooth(make_interp_spline(self.time, q, k=5), float(self.time[0]), float(self.time[-1]))

    def noise_share(self, bandwidth_hz: float) -> float:
        """The largest noise of an acceleration below a bandwidth, of the deviation of the acceleration there."""
        _, dq, acceleration = self.smooth(bandwidth_hz).at(self.time)
        ddq = acceleration.std(axis=0)
        moves = (ddq > 0) & moving_joints(dq)
        noise = np.array([white_noise(column) for column in self.q.T])[moves]
        return float(np.max(derived_noise(noise, bandwidth_hz, self.rate_hz, 2) / ddq[moves], initial=0.0))

    def motion_hz(self, bandwidth_hz: float) -> float:
        """Highest frequency of the motion below a bandwidth."""
        velocity = self.smooth(bandwidth_hz).at(self.time)[1]
        return motion_hz(self.time, velocity[:, moving_joints(velocity)])


@dataclass(frozen=True)
class Smooth:
    """A smooth motion from ``first`` to ``last``, s."""

    spline: BSpline
    first: float
    last: float

    def at(self, time: Array) -> Motion:
        """q, dq, ddq (N, n) at instants (N,); beyond its ends those there."""
        inside = np.clip(time, self.first, self.last)
        return self.spline(inside), self.spline.derivative(1)(inside), self.spline.derivative(2)(inside)


def read_positions(
    source: ExperimentSource,
    folder: Path,
    signals: Mapping[str, Trajectory],
    *,
    torque_units: tuple[str, ...],
    label: str,
) -> Positions:
    """The measured positions of a run, at even instants.

    Raises:
        InputError: there are none, a column is missing, or they are too few.
    """
    if source.positions is None:
        raise InputError(
            "controller: {kind: tracking} follows measured positions, and this run has none.", where=label,
            next_step="Add positions: {file: ...} to it. Without positions the real controller is needed.",
        )  # fmt: skip
    read = read_signals(source.positions, folder, signals, torque_units=torque_units)
    found, told = at_least_two_rows(read.signals, source.positions.file), [*read.told]
    names = [f"q{j}" for j in range(1, len(torque_units) + 1)]
    table = Trajectory(found.time, found.select(names), tuple(Variable(n) for n in names), source.positions.file)
    step = float((table.time[-1] - table.time[0]) / (table.time.size - 1))
    if table.time.size < FEWEST_ROWS or table.deviation(step) > REFERENCE_STEP * step:
        table, of_rows = resampled(table, float(np.median(np.diff(table.time))))
        told += found_in(of_rows, source.positions.file)
    return Positions(label, table.time, table.values, source.positions.file, tuple(told))


@dataclass(frozen=True)
class LogBand:
    """What torque logs show: their rate, Hz, and the cut-off of a filter that they are behind, Hz; None without one."""

    rate_hz: float
    cutoff_hz: float | None = None

    @property
    def shown_hz(self) -> float:
        """The highest bandwidth that is chosen."""
        return SHOWN * self.rate_hz if self.cutoff_hz is None else self.cutoff_hz / COMPARED

    def compared_hz(self, bandwidth_hz: float) -> float | None:
        """Cut-off to which both torques are filtered before they are compared; None where the log is too slow for that,
        or behind a lower filter, through which what is simulated goes as well."""
        wanted = COMPARED * bandwidth_hz
        if self.cutoff_hz is not None:
            return wanted if wanted < min(self.cutoff_hz, OF_THE_LOG * self.rate_hz) else None
        return wanted if bandwidth_hz <= OF_THE_LOG * self.rate_hz else None

    def noise_share(self, run: Positions, bandwidth_hz: float) -> tuple[float, float]:
        """The noise in the accelerations that are compared, and what it may be."""
        cutoff = self.compared_hz(bandwidth_hz) or self.cutoff_hz
        if cutoff is None:
            return run.noise_share(bandwidth_hz), NOISE_UNFILTERED
        return run.noise_share(cutoff), NOISE

    def __str__(self) -> str:
        if self.cutoff_hz is None:
            return f"a torque log at {self.rate_hz:.4g} Hz"
        return f"a torque log behind a filter of {self.cutoff_hz:.4g} Hz"


def _is_clean(run: Positions, bandwidth_hz: float, log: LogBand) -> bool:
    """Whether noise hardly shows in the accelerations that are compared."""
    share, most = log.noise_share(run, bandwidth_hz)
    return share <= most


@dataclass(frozen=True)
class Bandwidth:
    """Up to which positions are followed, Hz, and what sets it, in words."""

    hz: float
    reason: str


def bandwidth_of(runs: Sequence[Positions], stated: float | None, log: LogBand) -> Bandwidth:
    """The bandwidth up to which positions are followed: the stated one, else the highest at which noise hardly shows in
    the accelerations that are compared, and no higher than a torque log shows: above ``SHOWN`` of its rate the low-pass
    takes off nothing below half of it, above the cut-off over ``COMPARED`` nothing that the filter of a log leaves.

    Raises:
        InputError: the motion reaches as high, so that positions at this rate, or with this noise, cannot be followed.
    """
    rate = min(run.rate_hz for run in runs)
    if stated is not None and stated > HIGHEST_STATED * rate:
        raise InputError(
            "The bandwidth is too high for the rate of the positions.", where="controller.bandwidth_hz",
            got=f"{stated:g} Hz with positions at {rate:.4g} Hz", valid=f"up to {HIGHEST_STATED * rate:.4g} Hz",
            next_step="Leave bandwidth_hz out, or give positions at a higher rate.",
        )  # fmt: skip
    tried = HIGHEST * rate * 2.0 ** (-np.arange(STEPS) / 4)
    clean = next((b for b in tried if all(_is_clean(run, b, log) for run in runs)), float(tried[-1]))
    bandwidth = clean if stated is None else stated
    motion = max(run.motion_hz(min(clean, bandwidth)) for run in runs)  # above, noise would look like motion
    shown = log.shown_hz
    if stated is None:
        bandwidth = min(clean, max(shown, FOLLOWS * motion))
    if bandwidth < FOLLOWS * motion:
        needed = _upwards(FOLLOWS * motion)
        raise InputError(
            "The measured positions cannot be followed: the motion reaches too close to the bandwidth.",
            where="controller.bandwidth_hz",
            got=f"bandwidth {bandwidth:.3g} Hz of positions at {rate:.4g} Hz, motion up to {motion:.3g} Hz",
            valid=f"bandwidth of {needed:g} Hz and more",
            next_step=_way_out(runs, clean, needed, rate, log) if stated is None
            else f"Give {needed:g} Hz or more, or leave bandwidth_hz out.",
        )  # fmt: skip
    if stated is not None:
        reason = "as the case states" + (f", of which the torque log shows {shown:.3g} Hz" if stated > shown else "")
    elif bandwidth < clean:
        reason = f"all that {log} shows"
    else:
        reason = "set by the rate of the positions" if clean == tried[0] else "set by the noise of the positions"
    return Bandwidth(float(bandwidth), reason)


def _way_out(runs: Sequence[Positions], clean: float, needed: float, rate: float, log: LogBand) -> str:
    """What to do where no bandwidth that is chosen reaches as high as the motion."""
    if clean >= HIGHEST * rate:  # nothing but the rate is in the way
        return f"Log positions at {needed / HIGHEST:.3g} Hz or more, or move slower."
    slower = "Log less noisy positions, or move slower"
    if needed > HIGHEST_STATED * rate:
        return f"{slower}, and log them at {needed / HIGHEST:.3g} Hz or more."
    share = max(log.noise_share(run, needed)[0] for run in runs)
    return (
        f"{slower}. Or state bandwidth_hz: {needed:g}: noise then is {100 * share:.2g} % of the acceleration of a "
        "joint where torques are compared, which draws inertias towards zero by its square and more; the answer says "
        "what half of that bandwidth would do to each value."
    )


def _upwards(value: float) -> float:
    """Rounded up to three digits."""
    unit = 10.0 ** (np.floor(np.log10(value)) - 2)
    return float(np.ceil(value / unit) * unit)
