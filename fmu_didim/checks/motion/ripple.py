"""Whether the residual torque repeats along a joint, as the ripple of a motor or a gear does.

A ripple of n periods in a turn of a joint at q is a load on it, of its own size or in proportion to its torque,

    e = a sin(n q) + b cos(n q)      or      e = tau (a sin(n q) + b cos(n q)),

which the controller compensates as fast as it can (:mod:`fmu_didim.fit.derivatives.load_response`): what the log shows
of it is asked for as functions of the motion are (:mod:`fmu_didim.checks.motion.dependence`), a and b together. The p
value is multiplied by the number of ripples that are tried.

Functions of the motion cannot follow what changes so often, and values of a fit hardly move with it: on a SCARA a
residual of four times the noise, of which 93 % were a ripple of the current, was taken for noise.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from fmu_didim.checks.motion.colour import Colour
from fmu_didim.checks.motion.dependence import (
    SAMPLES_A_FUNCTION,
    Dependence,
    JointResidual,
    OwnColours,
    Whitened,
    independent,
    residuals_of_fit,
    tested_rows,
    told,
)
from fmu_didim.checks.motion.functions import at_ripples
from fmu_didim.checks.motion.misfits import FittedMotions
from fmu_didim.cosim import Indices
from fmu_didim.data.signals import Array
from fmu_didim.model.workers import side_by_side

MOST_A_TURN = 120
"""[1] Ripples in a turn of a joint up to which they are looked for: two in a turn of a motor behind a gear of 60."""
SHORTEST = 0.002
"""[m] Ripple of a joint that slides down to which it is looked for: that of a ball screw or a tooth of a belt."""
MOST = 400
"""[1] Ripples that are tried along a joint that slides, the longest ones first."""
INSTANTS = 3.0
"""[instants] At which loads are taken, in the shortest ripple at the largest speed."""
FUNCTIONS = 2
"""[functions] Of a ripple: sine and cosine."""
AT_ONCE = 4_000_000
"""[values] Of a table of loads: 32 MB."""
DEPENDENT = 1e-9
"""[1] Singular value, of the largest one, below which a function of a ripple is the other one."""


def ripples_of_fit(motions: FittedMotions) -> list[Dependence]:
    """How the residual of each joint repeats along it, at the point of a fit."""
    rows = tested_rows(motions.fit)
    tasks = [partial(_ripple, motions, one, rows) for one in residuals_of_fit(motions.fit, rows)]
    return [found for found in side_by_side(tasks, motions.fit.model.threads) if found is not None]


def numbers_of_ripples(*, slides: bool, reach: float, speed: float, spacing: float) -> Array:
    """(f,) numbers that are tried, in a turn or in rad/m: whole ones, or those that a motion tells apart.

    Args:
        reach, speed: of the motion, rad or m, and a second; spacing: s between instants at which loads are taken.
    """
    if not (reach > 0 and speed > 0):
        return np.zeros(0)
    step, highest = (np.pi / reach, 2 * np.pi / SHORTEST) if slides else (1.0, float(MOST_A_TURN))
    highest = min(highest, 2 * np.pi / (INSTANTS * spacing * speed))
    return np.asarray(step * np.arange(1, min(int(highest / step), MOST) + 1))


@dataclass(frozen=True)
class _Best:
    """The ripple that explains most by one colour: its number, what the log shows of it (N, FUNCTIONS), and the squares
    that it explains."""

    number: float
    functions: Array
    explained: float


def _ripple(motions: FittedMotions, one: JointResidual, rows: dict[str, Indices]) -> Dependence | None:
    """The ripple that explains most of the residual of a joint; None where it is no question."""
    j, used, along = one.joint - 1, independent(one.nuisance), motions.motions.values()
    slides = motions.joint_types[j] == "prismatic"
    numbers = numbers_of_ripples(
        slides=slides, reach=max(float(np.ptp(m.q[:, j])) for m in along),
        speed=max(float(np.abs(m.dq[:, j]).max()) for m in along), spacing=max(m.step for m in along),
    )  # fmt: skip
    if one.residual.size - used.shape[1] < FUNCTIONS * SAMPLES_A_FUNCTION or not one.left or not numbers.size:
        return None
    tested = OwnColours.of(one.residual, used, np.zeros((one.residual.size, 0)), one.logs)
    best = dict[int, _Best]()
    for some, table in _tables(motions, j, rows, numbers):
        beside = _with(tested, table.reshape(len(table), -1))
        for place, colour in enumerate((Colour.white(len(tested.alone.orders)), tested.alone)):
            explained = _explained(Whitened.by(beside, colour), table.shape[1])
            k = int(np.argmax(explained))
            if place not in best or explained[k] > best[place].explained:
                best[place] = _Best(float(some[k % some.size]), table[:, k], float(explained[k]))
    steps = []
    for found in best.values():
        beside, chosen = _with(tested, found.functions), range(FUNCTIONS)
        own = beside.beside(chosen)
        gain = tested.alone.criterion - own.criterion
        steps.append((Whitened.by(beside, own).step(chosen, gain, ways=2 * numbers.size), found.number))
    step, number = min(steps, key=lambda pair: pair[0].p_value)
    return told(step, len(steps), [at_ripples(number, slides=slides)] * FUNCTIONS, one.joint)


def _tables(motions: FittedMotions, j: int, rows: dict[str, Indices], numbers: Array) -> Iterator[tuple[Array, Array]]:
    """Some of the numbers (f,) at a time, with what the log shows (N, 2 f, FUNCTIONS) of their ripples at a joint: of
    those of their own size, and of those in proportion to the torque."""
    longest = max(m.q.size for m in motions.motions.values())
    count = max(AT_ONCE // (2 * FUNCTIONS * longest), 1)
    for first in range(0, numbers.size, count):
        some, parts = numbers[first : first + count], list[Array]()
        for label, own in rows.items():
            motion = motions.motions[label]
            phase = motion.q[:, j, None] * some
            waves = np.stack([np.sin(phase), np.cos(phase)], axis=2)
            waves = np.concatenate([waves, motion.load[:, j, None, None] * waves], axis=1)
            loads = np.zeros((*motion.q.shape, waves[0].size))
            loads[:, j] = waves.reshape(len(waves), -1)
            shown = motions.fit.model.experiments.filtered(motions.responses[label].at_samples(loads), label)
            parts.append(shown[own, j].reshape(own.size, *waves.shape[1:]))
        yield some, np.concatenate(parts)


def _with(tested: OwnColours, functions: Array) -> OwnColours:
    """The same residual beside other functions (N, m)."""
    own = tested.columns.table[:, : tested.used + 1]
    return replace(tested, columns=replace(tested.columns, table=np.column_stack([own, functions])))


def _explained(whitened: Whitened, ripples: int) -> Array:
    """(g,) squares that each of so many ripples explains."""
    own = whitened.own.reshape(whitened.rest.size, ripples, FUNCTIONS).transpose(1, 2, 0)
    along = own @ whitened.rest
    inverse = np.linalg.pinv(own @ own.transpose(0, 2, 1), rcond=DEPENDENT, hermitian=True)
    return np.asarray(np.einsum("gi,gij,gj->g", along, inverse, along))
