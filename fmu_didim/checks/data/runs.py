"""Checks of the experiments against each other: held-out data that are not independent."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, REMARK, Diagnostic
from fmu_didim.data.signals import Array, Trajectory
from fmu_didim.data.spectrum import lagged_products
from fmu_didim.fit.solver.bounded import least_between
from fmu_didim.model.experiment import Experiment
from fmu_didim.model.loop_model import LoopModel

COPIED = 0.5
"""[1] Fraction of the rows of a held-out log that a fitted one has, too, to the last digit."""
SAME_MOTION = 0.01
"""[1] RMS difference of two references over what the held-out one moves, below which their motions are the same: above
the noise of measured positions that serve as reference, far below what two planned motions share."""
COMPARED = 0.5
"""[1] Fraction of a held-out reference that another must cover to be compared: what lies beyond is new motion."""
SHIFTED_POINTS = 4096
"""[points] Of the longer of two references, at which it is looked for when one begins within the other: forty in each
turn of a motion of a hundred."""
SHIFT_ACCURACY = 0.01
"""[1] Of the distance of these points, to which it is then found: far below what moves a motion by ``SAME_MOTION``."""
FAR = 3.0
"""[1] Times the difference of two motions that count as the same, and what they move in a row, by which they differ at
most two rows beside the instant where they are the same: half of a motion has up to twice the variance of all of it."""
ALL_DIFFERENT = 10.0
"""[1] Of the difference, beyond which it counts as this much while the instant is looked for."""
ROUNDING_S = 1e-9
"""[s] By which two equal instants may differ."""

VALIDATION_COPIED = CATALOGUE(
    "validation-copied", DOUBT, rank=12,
    meaning="The log of a validation experiment is that of an estimation experiment, or part of it: the fit is "
    "compared with itself.",
    next_step="Record a run with another motion for the validation, or leave the validation out.",
)  # fmt: skip
VALIDATION_REPEATS = CATALOGUE(
    "validation-repeats-motion", REMARK, rank=90,
    meaning="A validation experiment follows the reference of an estimation experiment, from its begin or from a later "
    "instant: it repeats the motion of the fit, and what the model lacks may be hidden in both. It is no independent "
    "evidence: the prediction of another motion is untested.",
    next_step="Record a run with another motion for the validation.",
)  # fmt: skip
VALIDATION_WITHOUT_TORQUE = CATALOGUE(
    "validation-without-torque", DOUBT, rank=13,
    meaning="A validation experiment has no torque log, so nothing is validated.",
    next_step="Add torque: {file: ...} to it, or leave the validation out.",
)  # fmt: skip


def run_diagnostics(model: LoopModel, without_torque: Sequence[str] = ()) -> list[Diagnostic]:
    """Validation experiments without a log, with the log of an estimation experiment, or with its motion.

    Args:
        without_torque: labels of those that have none.
    """
    found: list[Diagnostic | None] = [
        Diagnostic(VALIDATION_WITHOUT_TORQUE, "It has no torque log, so nothing is compared with it.", label)
        for label in without_torque
    ]
    for label in model.experiments.validation_labels:
        for other in model.estimation_labels:
            part = copied(model.experiments[label].torque, model.experiments[other].torque)
            if part > COPIED:
                text = f"{100 * part:.0f} % of its torque log stand in that of {other}, to the last digit."
                found.append(Diagnostic(VALIDATION_COPIED, text, label, part, COPIED, "1"))
                continue
            own, fitted = model.experiments[label], model.experiments[other]
            if own.external_torques != fitted.external_torques:
                continue
            found += [_repeats(label, other, *difference(during_log(own), during_log(fitted)))]
    return [d for d in found if d is not None]


def _repeats(label: str, other: str, apart: float, later: float) -> Diagnostic | None:
    """The remark on a held-out reference that is so far apart from a fitted one, from an instant of it on."""
    if not apart < SAME_MOTION:
        return None
    since = f" from its {later:.4g} s on" if later > 0 else ""
    text = (
        f"Its reference is that of {other}{since} but for {100 * apart:.2g} %: it is no independent evidence, and the "
        "prediction of another motion is untested."
    )
    return Diagnostic(VALIDATION_REPEATS, text, label, apart, SAME_MOTION, "1")


def during_log(experiment: Experiment) -> Trajectory:
    """The reference from the first to the last sample of the torque log: one file may serve several parts of a run."""
    reference, time = experiment.reference, experiment.time
    inside = (reference.time >= time[0] - ROUNDING_S) & (reference.time <= time[-1] + ROUNDING_S)
    return replace(reference, time=reference.time[inside], values=reference.values[inside])


def difference(reference: Trajectory, other: Trajectory) -> tuple[float, float]:
    """How far two references are apart, and at which time of the second one, s, the first begins: RMS difference over
    what the first one moves while both last, the largest of all positions and injected signals that change in either.

    The instant is looked for: a part of a run may be held out, or further periods of its motion. It is none where the
    first row fits as well as any. Infinite where the references cannot be compared: nothing moves, a signal is missing,
    or the other covers too little of the first.
    """
    names = [name for name in reference.names if not name.startswith(("dq", "ddq"))]
    if not any(name.startswith("q") for name in names) or any(name not in other.names for name in names):
        return float("inf"), 0.0
    at_once = _apart(reference, other, names, 0.0)
    if at_once < SAME_MOTION:
        return at_once, 0.0
    step = max(float(np.ptp(one.time)) for one in (reference, other)) / SHIFTED_POINTS
    rows, near = _likely_shift(*(_on_grid(one, names, step) for one in (reference, other)))
    later = rows * step
    if not near:
        return min((at_once, 0.0), (_apart(reference, other, names, later), later))  # however they are shifted
    found, least = least_between(
        lambda s: min(_apart(reference, other, names, s), ALL_DIFFERENT), later - step, later + step,
        accuracy=SHIFT_ACCURACY * step,
    )  # fmt: skip
    shifts = {found: least, later: _apart(reference, other, names, later), 0.0: at_once}
    best = min(shifts, key=lambda s: shifts[s])
    return shifts[best], best


def _apart(reference: Trajectory, other: Trajectory, names: Sequence[str], later: float) -> float:
    """How far two references are apart if the first one begins so much later, s, than the other."""
    time, times = reference.time - reference.time[0] + later, other.time - other.time[0]
    both = (time >= -ROUNDING_S) & (time <= times[-1] + ROUNDING_S)
    if np.count_nonzero(both) <= COMPARED * time.size:
        return float("inf")
    found = []
    for name in names:
        own = reference.column(name)[both]
        gap = own - np.interp(time[both], times, other.column(name))
        moved, apart = float(np.std(own)), float(np.sqrt(np.mean(gap**2)))
        if moved > 0:
            found.append(apart / moved)
        elif np.ptp(other.column(name)) > 0:
            return float("inf")
    return max(found, default=float("inf"))


def _on_grid(reference: Trajectory, names: Sequence[str], step: float) -> Array:
    """(K, m) columns of a reference at steps from its first row on."""
    time = np.arange(reference.time[0], reference.time[-1] + ROUNDING_S, step)
    return np.column_stack([np.interp(time, reference.time, reference.column(name)) for name in names])


def _likely_shift(own: Array, other: Array) -> tuple[int, bool]:
    """Rows by which a table (K, m) begins later than another (L, m), with the least mean square difference of their
    columns, over the variance of each in the first one, among those at which the other covers enough of it; and whether
    the two may be the same less than two rows from there."""
    mean, moved = own.mean(axis=0), own.std(axis=0)
    own, other = ((table - mean)[:, moved > 0] / moved[moved > 0] for table in (own, other))
    lags = np.arange(1 - own.shape[0], other.shape[0])
    ones = [np.ones(table.shape[0]) for table in (own, other)]
    squares = lagged_products(ones[1], np.sum(own**2, axis=1), lags)
    squares += lagged_products(np.sum(other**2, axis=1), ones[0], lags)
    for a, b in zip(other.T, own.T, strict=True):
        squares -= 2 * lagged_products(a, b, lags)
    shared = np.rint(lagged_products(ones[1], ones[0], lags))
    enough = shared > COMPARED * own.shape[0]
    if not enough.any():
        return 0, True
    apart = squares[enough] / shared[enough]
    best, in_a_row = int(np.argmin(apart)), np.sqrt(np.mean(np.diff(own, axis=0) ** 2, axis=0))
    return int(lags[enough][best]), bool(apart[best] <= np.sum((FAR * (SAME_MOTION + in_a_row)) ** 2))


def copied(torque: Array, other: Array) -> float:
    """Fraction of the distinct rows of a log (N, n) that another (M, n) has, too; 0 for a log at rest."""
    own, known = np.unique(torque, axis=0), {row.tobytes() for row in other}
    if own.shape[0] <= 0.5 * torque.shape[0]:
        return 0.0
    return float(np.mean([row.tobytes() in known for row in own]))
