"""Whether a torque log can be that of the loop at all: its signs, the order of its joints, its unit, its gain.

The base fit would absorb such errors, or take them for physics; so the log is compared with the torque of the loop at
the start values, which may be far off:

    c_jk = corr(measured torque of joint j, simulated torque of joint k)
    s_j  = <measured, simulated> / <simulated, simulated>           of joint j
    E(p) = sum_j mean((measured_j - simulated_p(j))^2) / mean(measured_j^2)     of an order p of the joints

Where no base parameters explain it along the reference, those that do so with two columns exchanged tell the order.
"""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, PROBLEM, Diagnostic
from fmu_didim.checks.data.expected import Expected
from fmu_didim.cosim.sampling import Indices
from fmu_didim.data.signals import Array
from fmu_didim.estimators.initial_states import FIRST_PART
from fmu_didim.fit.noise.noise import TINY

EXPLAINS = 0.5
"""[1] Error of a linear fit along the reference, as a fraction of the deviation of the torque, below which the
reference belongs to the log: it explains three quarters of the variance."""
CHANCE = 0.6
"""[1] Of the median error of the same fit for the log rolled to other instants, above which it explains no more than
chance: 52 parameters explain a third of any log. Right data have at most 0.6 in all examples, with pushes and effects
that the model lacks; other runs of the same robot 0.65 and more."""
OTHER_JOINT = 0.5
"""[1] Least gain in correlation by another order, mean over the joints that change places."""
AGAINST = -0.7
"""[1] Correlation below which a torque counts as turned round."""
FOLLOWS = 0.7
"""[1] Correlation above which a torque follows the simulated one, so that their ratio counts."""
OTHER_ORDER = 0.1
"""[1] Fraction of the error to which another order of the joints must bring it down."""
WRONG_ORDER = 0.5
"""[1] Error for each joint below which the order of the joints is not doubted: half of the mean square of the
torque."""
OTHER_UNIT = 8.0
"""[1] Ratio of measured to simulated torque beyond which another unit is suspected, up or down: start values of a
machine may be wrong by a factor of three; 8.85 in-lb and 10.2 kgf cm are 1 N.m."""
GAIN_RATIO = 2.0
"""[1] Ratio of measured to simulated torque, up or down, from which it is asked whether the drive gain explains
it."""
GAIN_FITS = 0.5
"""[1] Part of the logarithm of that ratio that may be left, joints together, if the gain explains it."""

REFERENCE_FOREIGN = CATALOGUE(
    "reference-foreign", PROBLEM, rank=1,
    meaning="The log does not belong to the reference: neither the simulated torque nor any base parameters along the "
    "reference explain it.",
    next_step="Check which reference was running when this log was taken, and that both start at the same instant "
    "(torque: {offset_s: ...}). Where the torque stays at its largest value the drive is at its limit, where it grows "
    "at one end of the motion the machine may run against a stop, and either falls behind its reference: leave that "
    "motion out, or run it more slowly or less far.",
)  # fmt: skip
JOINT_ORDER = CATALOGUE(
    "joint-order", PROBLEM, rank=2,
    meaning="The torque columns seem to be in another order than the joints.",
    next_step="Check the columns of the torque log: torque: {columns: {tau1: ...}}.",
)  # fmt: skip
TORQUE_SIGN = CATALOGUE(
    "torque-sign", PROBLEM, rank=3,
    meaning="A torque has the opposite sign: it must be positive along the joint, as in the robot description.",
    next_step="Reverse the sign of these columns, or of the joint's axis in the robot description.",
)  # fmt: skip
DRIVE_GAIN = CATALOGUE(
    "drive-gain", DOUBT, rank=9,
    meaning="Measured and expected torque differ by the gains of the drives: a current was logged as a torque, or "
    "a torque as a command.",
    next_step="Give torque: {quantity: command} for a log of the command or current, {quantity: torque} for one of the "
    "torque.",
)  # fmt: skip
TORQUE_UNIT = CATALOGUE(
    "torque-unit", DOUBT, rank=10, at_once=True,
    meaning="The torque is much larger or smaller than gravity and inertia of the robot description give it.",
    next_step="Give the torque in N.m or N, on the side of the gear that the robot description means.",
)  # fmt: skip


def torque_channel_diagnostics(
    given: Expected, gains: Array, label: str, *, scale_is_free: bool = False
) -> list[Diagnostic]:
    """The diagnostics of a log against its expected torque, in one experiment.

    Args:
        gains: (n,) from the command to the torque of each drive, 1 without one.
        scale_is_free: whether gains of drives are identified, so that the log may have any scale.
    """
    whole = given.has_all_joints
    if whole and (exchanged := _exchanged(given, label)):
        return exchanged
    foreign = _foreign(given, label)
    if foreign and not _foreign(later := given.after(FIRST_PART), label):
        given, foreign = later, []  # it does not start on its reference: the transient says nothing of the log
    if foreign or given.nominal is None or not whole:
        return foreign
    found = _order(given.measured, given.nominal, label)
    correlation, ratio = correlation_and_ratio(given.measured, given.nominal)
    for j in np.flatnonzero(correlation < AGAINST):
        found.append(
            Diagnostic(
                TORQUE_SIGN, f"The measured torque runs against the simulated one (correlation {correlation[j]:.2f}).",
                f"{label}: joint {j + 1}", float(correlation[j]), AGAINST, "1",
            )
        )  # fmt: skip
    return found or ([] if scale_is_free else _scale(correlation, ratio, gains, label))


def correlation_and_ratio(measured: Array, expected: Array) -> tuple[Array, Array]:
    """(n,) correlation of each measured torque with the expected one, and their ratio; 0 where undefined."""
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = np.sum(measured * expected, axis=0) / np.sum(expected**2, axis=0)
    return np.diag(correlations(measured, expected)), np.nan_to_num(ratio, posinf=0.0, neginf=0.0)


def correlations(measured: Array, simulated: Array) -> Array:
    """(n, n) correlation of each measured with each simulated torque; 0 where one is constant."""
    n = measured.shape[1]
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.nan_to_num(np.corrcoef(measured, simulated, rowvar=False)[:n, n:])


def best_order(gain: Array) -> tuple[Indices, Indices]:
    """The rows of a table (n, n), and the column for each, none for two, with the largest sum of their elements."""
    rows = np.arange(len(gain))
    if any((gain.argmax(axis=axis) == rows).all() for axis in (0, 1)):
        return rows, rows  # no sum is larger than that of the largest element of each row, or column
    from scipy.optimize import linear_sum_assignment  # slow to import

    _, columns = linear_sum_assignment(-gain)
    return rows, columns


def _foreign(given: Expected, label: str) -> list[Diagnostic]:
    """A log that no values of the base parameters explain."""
    if given.fitted is None:
        return []
    left = given.error(given.fitted)
    if left <= EXPLAINS:
        return []
    if given.nominal is not None:
        related = np.abs(correlations(given.measured, given.nominal))
        if related[best_order(related)].mean() > FOLLOWS:  # turned round, or in another order
            return []
    if left <= CHANCE * given.chance():
        return []
    text = (
        f"The log does not belong to its reference: base parameters of any size leave {100 * left:.0f} % of the "
        "torque's deviation along it."
    )
    return [Diagnostic(REFERENCE_FOREIGN, text, label, left, EXPLAINS, "1")]


def _exchanged(given: Expected, label: str) -> list[Diagnostic]:
    """Whether two columns that change places make a log explained along its reference that is not so as it stands."""
    if given.fitted is None or (own := given.error(given.fitted)) <= EXPLAINS:
        return []
    found = []
    for pair in itertools.combinations(range(given.measured.shape[1]), 2):
        order = np.arange(given.measured.shape[1])
        order[list(pair)] = order[list(pair[::-1])]
        other = replace(given, measured=given.measured[:, order])
        assert other.fitted is not None
        found.append((other.error(other.fitted), *(j + 1 for j in pair)))
    left, one, two = min(found, default=(own, 0, 0))
    if left > EXPLAINS or left**2 > OTHER_ORDER * own**2:
        return []
    text = (
        "The measured torques seem to be in another order than the joints: base parameters leave "
        f"{100 * own:.0f} % of the torque's deviation along the reference; {100 * left:.0f} % if column {one} shows "
        f"joint {two} and column {two} shows joint {one}."
    )
    return [Diagnostic(JOINT_ORDER, text, label, left**2 / own**2, OTHER_ORDER, "1")]


def _order(measured: Array, simulated: Array, label: str) -> list[Diagnostic]:
    """Whether another order of the joints explains the log far better, by size or by shape."""
    size = np.maximum(np.mean(measured**2, axis=0), TINY)
    error = np.mean((measured[:, :, None] - simulated[:, None, :]) ** 2, axis=0) / size[:, None]
    own, doubted = float(np.trace(error)), WRONG_ORDER * size.size
    rows, best = best_order(-error) if own >= doubted else (np.arange(size.size),) * 2
    other = float(error[rows, best].sum())
    if own < doubted or other > min(OTHER_ORDER * own, doubted):  # a simulation that is far off tells nothing
        return _order_by_shape(correlations(measured, simulated), label)
    moved = [f"column {j + 1} shows joint {k + 1}" for j, k in zip(rows, best, strict=True) if j != k]
    text = (
        "The measured torques seem to be in another order than the joints: squared error "
        f"{own:.3g} of the torque's square; {other:.3g} if {', '.join(moved)}."
    )
    return [Diagnostic(JOINT_ORDER, text, label, other / own, OTHER_ORDER, "1")]


def _order_by_shape(correlation: Array, label: str) -> list[Diagnostic]:
    """Whether torques follow those of other joints instead of their own."""
    rows, best = best_order(correlation)
    moved = rows[rows != best]
    if moved.size == 0:
        return []
    own, other = correlation[moved, moved], correlation[moved, best[moved]]
    gain = float(np.mean(other - own))
    if gain <= OTHER_JOINT or other.min() <= FOLLOWS:
        return []
    words = ", ".join(f"column {j + 1} shows joint {best[j] + 1}" for j in moved)
    text = (
        f"The measured torques seem to be in another order than the joints: correlation {own.mean():.2f} as they "
        f"stand, {other.mean():.2f} if {words}."
    )
    return [Diagnostic(JOINT_ORDER, text, label, gain, OTHER_JOINT, "1")]


def _scale(correlation: Array, ratio: Array, gains: Array, label: str) -> list[Diagnostic]:
    """A log that is in another unit, or without the gain of the drives."""
    follows = (correlation > FOLLOWS) & (ratio > 0)
    size = np.where(follows, np.abs(np.log(np.where(follows, ratio, 1.0))), 0.0)
    if size.sum() > np.log(GAIN_RATIO) * max(int(follows.sum()), 1):
        for factor, words in ((gains, "a command or current"), (1 / gains, "multiplied by them twice")):
            left = np.abs(np.log(np.where(follows, ratio * np.abs(factor), 1.0)))
            if left.sum() < GAIN_FITS * size.sum():
                text = (
                    f"The torque is {', '.join(f'{r:.3g}' for r in ratio)} times what the start values give; the drive "
                    f"gains {', '.join(f'{g:.4g}' for g in gains)} explain that: the log seems to be {words}."
                )
                worst = int(np.argmax(size))
                bound = GAIN_RATIO if ratio[worst] > 1 else 1 / GAIN_RATIO
                return [Diagnostic(DRIVE_GAIN, text, label, float(ratio[worst]), bound, "1")]
    return [
        Diagnostic(
            TORQUE_UNIT,
            f"The torque is {ratio[j]:.3g} times what the start values give: is it in the unit, and on the side of the "
            "gear, that the robot description means?",
            f"{label}: joint {j + 1}", float(ratio[j]), OTHER_UNIT ** float(np.sign(np.log(ratio[j]))), "1",
        )
        for j in np.flatnonzero(size > np.log(OTHER_UNIT))
    ]  # fmt: skip
