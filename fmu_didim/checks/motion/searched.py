"""Whether the residual torque follows what acts at places: ripples of a motor or a gear, stops, and bumps.

A joint at q may have a load, at a number n of ripples in a turn or beyond a place c, of the form

    e = w (a sin(n q) + b cos(n q)),      w = 1, tau or the direction of motion s(dq),
    e = a h + b h^2,                      h = max(q - c, 0) or max(c - q, 0),
    e = a h_c(z) + b h_(c+w)(z),          h_c(z) = max(1 - |z - c| / w, 0),

the last one near one value of a quantity z: its position, velocity or load, the time, the position or velocity of a
neighbour. The controller compensates it as fast as it can (:mod:`fmu_didim.fit.derivatives.load_response`): what the
log shows of it is asked for as functions of the motion are (:mod:`fmu_didim.checks.motion.dependence`), a and b
together. The p value is multiplied by the number of those that are tried.

Functions of the motion cannot follow what changes so often or is so short, and values of a fit hardly move with it: on
a SCARA a residual of four times the noise, of which 93 % were a ripple of the current, was taken for noise, and so was
Coulomb friction that changed along the joint, whose mean the friction of the model takes up, and so were drawn bumps.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal, TypeAlias, get_args

import numpy as np

from fmu_didim.base.tall import with_rows
from fmu_didim.checks.motion.colour import Colour, asked_twice, less
from fmu_didim.checks.motion.dependence import (
    Dependence,
    JointResidual,
    OwnColours,
    Whitened,
    residuals_of_fit,
    tested_rows,
    told,
)
from fmu_didim.checks.motion.functions import at_ripples, beyond, direction, near
from fmu_didim.checks.motion.misfits import FittedMotions
from fmu_didim.cosim import Indices
from fmu_didim.data.signals import Array
from fmu_didim.model.motion import Motion
from fmu_didim.model.workers import apart

MOST_A_TURN = 120
"""[1] Ripples in a turn of a joint up to which they are looked for: two in a turn of a motor behind a gear of 60."""
SHORTEST = 0.002
"""[m] Ripple of a joint that slides down to which it is looked for: that of a ball screw or a tooth of a belt."""
MOST = 400
"""[1] Ripples that are tried along a joint that slides, the longest ones first."""
INSTANTS = 3.0
"""[instants] At which loads are taken, in the shortest ripple at the largest speed."""
STOPS = (0.02, 0.04, 0.07, 0.1, 0.15, 0.2, 0.3, 0.4)
"""[1] Of the range of a motion, from either end: where a stop may begin."""
PLACES = (8, 24)
"""[places] In the range of a quantity, near which something of its own may act: broad ones and narrow ones."""
FUNCTIONS = 2
"""[functions] Of a ripple, a stop or a place."""
Follows = Literal["neither", "load", "direction"]
FOLLOWS: tuple[Follows, ...] = get_args(Follows)
"""What the size of a ripple follows."""
Quantity = Literal["position", "velocity", "load", "time"]
QUANTITIES: tuple[Quantity, ...] = get_args(Quantity)
"""Near one value of which something may act; of a neighbour the first two."""
AT_ONCE = 500_000
"""[values] Of a table of loads: 4 MB, and what becomes of them not much more than the caches hold."""
SHOWN_AT_ONCE = 4_000_000
"""[values] Of a table of what the log shows, of all experiments together: 32 MB, and some tables of that size."""
DEPENDENT = 1e-9
"""[1] Singular value, of the largest one, below which one of these functions is the other one."""


@dataclass(frozen=True)
class Ripple:
    """Loads that repeat along a joint.

    Attributes:
        number: of them in a turn, or rad/m; follows: the torque that the joint transmits, the direction of motion, or
            neither; slides: whether the joint does.
    """

    number: float
    follows: Follows
    slides: bool

    @property
    def name(self) -> str:
        """What the residual follows then."""
        return at_ripples(self.number, slides=self.slides, of_friction=self.follows == "direction")

    def waves(self, motion: Motion, j: int) -> tuple[Array, Array]:
        """(K,) sine and cosine along joint ``j``, from 0: those of all ripples of this number."""
        phase = self.number * motion.q[:, j]
        return np.sin(phase), np.cos(phase)

    def loads(self, motion: Motion, j: int, waves: tuple[Array, Array] | None = None) -> tuple[Array, Array]:
        """(K,) each on joint ``j``, from 0; ``waves``: where they are known."""
        sine, cosine = waves or self.waves(motion, j)
        if self.follows == "neither":
            return sine, cosine
        size = motion.load[:, j] if self.follows == "load" else direction(motion.dq[:, j])
        return size * sine, size * cosine


@dataclass(frozen=True)
class Stop:
    """Loads beyond a place of a joint.

    Attributes:
        place: rad or m; above: whether they begin there upwards, or downwards; slides: whether the joint does.
    """

    place: float
    above: bool
    slides: bool

    @property
    def name(self) -> str:
        """What the residual follows then."""
        return beyond(self.place, above=self.above, slides=self.slides)

    def loads(self, motion: Motion, j: int) -> tuple[Array, Array]:
        """(K,) each on joint ``j``, from 0."""
        away = motion.q[:, j] - self.place
        depth = np.maximum(away if self.above else -away, 0.0)
        return depth, depth**2


@dataclass(frozen=True)
class Near:
    """Loads near one value of a quantity.

    Attributes:
        of: joint of the quantity, from 0; own: whether they act on it; slides: whether it does.
        place, width: of the value, SI.
    """

    quantity: Quantity
    of: int
    own: bool
    place: float
    width: float
    slides: bool

    @property
    def name(self) -> str:
        """What the residual follows then."""
        return near(
            self.quantity, self.place + 0.5 * self.width, slides=self.slides, joint=0 if self.own else self.of + 1
        )

    def loads(self, motion: Motion, j: int) -> tuple[Array, Array]:
        """(K,) each on joint ``j``, from 0."""
        away = (_quantity(motion, self.quantity, self.of) - self.place) / self.width
        return np.maximum(1 - np.abs(away), 0.0), np.maximum(1 - np.abs(away - 1), 0.0)


def _quantity(motion: Motion, quantity: Quantity, joint: int) -> Array:
    """(K,) along a motion."""
    if quantity == "time":
        return motion.time
    return np.asarray({"position": motion.q, "velocity": motion.dq, "load": motion.load}[quantity][:, joint])


def places(motions: Sequence[Motion], j: int, slides: Sequence[bool]) -> list[Near]:
    """The values of quantities near which something may act on a joint, from 0."""
    asked: list[tuple[Quantity, int]] = [(quantity, j) for quantity in QUANTITIES]
    beside = [k for k in (j - 1, j + 1) if 0 <= k < len(slides)]
    asked += [(quantity, k) for quantity in ("position", "velocity") for k in beside]
    found = []
    for quantity, of in asked:
        values = np.concatenate([_quantity(m, quantity, of) for m in motions])
        low, reach = float(values.min()), float(np.ptp(values))
        for count in PLACES if reach > 0 else ():
            width = reach / count
            found += [Near(quantity, of, of == j, low + k * width, width, slides[of]) for k in range(count)]
    return found


def searched_of_fit(motions: FittedMotions, joints: Sequence[JointResidual] | None = None) -> list[Dependence]:
    """How the residual of each joint follows ripples, stops and bumps, at the point of a fit.

    Args:
        joints: what is looked at, where it is known.
    """
    rows = tested_rows(motions.fit)
    joints = residuals_of_fit(motions.fit, rows) if joints is None else joints
    tasks = [partial(_searched, motions, one, rows) for one in joints]
    return [found for found in apart(tasks, motions.fit.model.threads) if found is not None]


def candidates(motions: Sequence[Motion], j: int, *, slides: bool) -> list[Ripple | Stop]:
    """The ripples and stops that are tried at a joint, from 0; none where it stands still."""
    q = np.concatenate([m.q[:, j] for m in motions])
    low, reach = float(q.min()), float(np.ptp(q))
    numbers = numbers_of_ripples(
        slides=slides, reach=max(float(np.ptp(m.q[:, j])) for m in motions),
        speed=max(float(np.abs(m.dq[:, j]).max()) for m in motions), spacing=max(m.step for m in motions),
    )  # fmt: skip
    if not numbers.size:
        return []
    ripples = [Ripple(float(number), follows, slides) for number in numbers for follows in FOLLOWS]
    stops = [
        Stop(low + (1 - part if above else part) * reach, above, slides) for above in (True, False) for part in STOPS
    ]
    return [*ripples, *stops]


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


Local: TypeAlias = Ripple | Stop | Near
"""What acts at places."""


@dataclass(frozen=True)
class _Best:
    """What explains most by one colour: what the log shows of it (N, FUNCTIONS), and the squares that it explains."""

    of: Local
    functions: Array
    explained: float


def _searched(motions: FittedMotions, one: JointResidual, rows: dict[str, Indices]) -> Dependence | None:
    """The ripple, stop or bump that explains most of the residual of a joint; None where it is no question."""
    j, tested = one.joint - 1, one.left.colours
    along, slides = list(motions.motions.values()), [kind == "prismatic" for kind in motions.joint_types]
    tried: list[Local] = [*candidates(along, j, slides=slides[j]), *places(along, j, slides)]
    if one.room < FUNCTIONS or not one.left.shows or not tried:
        return None
    starts = (Colour.white(len(tested.alone.orders)), tested.alone)
    colours, best = {colour.key: colour for colour in starts}, dict[tuple[object, ...], _Best]()
    for some, table in _tables(motions, j, rows, tried):
        beside = tested.with_functions(table.reshape(len(table), -1))
        for key, colour in colours.items():
            explained = _explained(beside, colour, len(some))
            k = int(np.argmax(explained))
            if key not in best or explained[k] > best[key].explained:
                best[key] = _Best(some[k], table[:, k].copy(), float(explained[k]))
    steps = []
    for found in best.values():
        beside, chosen = tested.with_functions(found.functions), range(FUNCTIONS)
        own = beside.beside(chosen)
        gain = tested.alone.criterion - own.criterion
        steps.append((Whitened.by(beside, own).step(chosen, gain, ways=len(tried)), found.of))
    step, follows = min(steps, key=lambda pair: pair[0].p_value)
    return told(step, len(starts), [follows.name] * FUNCTIONS, one.joint)


def _tables(
    motions: FittedMotions, j: int, rows: dict[str, Indices], tried: Sequence[Local]
) -> Iterator[tuple[Sequence[Local], Array]]:
    """Some of those that are tried at a time, with what the log shows (N, f, FUNCTIONS) of their loads on a joint."""
    longest, rest = max(len(m.q) for m in motions.motions.values()), sum(own.size for own in rows.values())
    count = max(min(AT_ONCE // longest, SHOWN_AT_ONCE // rest) // FUNCTIONS, 1)
    for first in range(0, len(tried), count):
        some, parts = tried[first : first + count], list[Array]()
        for label, own in rows.items():
            motion = motions.motions[label]
            loads = loads_of(some, motion, j).reshape(len(motion.q), -1)
            shown = motions.fit.model.experiments.filtered(motions.responses[label].of_joint(loads, j), label)
            parts.append(shown[own].reshape(own.size, len(some), FUNCTIONS))
        yield some, np.concatenate(parts)


def loads_of(some: Sequence[Local], motion: Motion, j: int) -> Array:
    """(K, f, FUNCTIONS) loads on a joint, from 0."""
    found, number, waves = np.empty((len(motion.q), len(some), FUNCTIONS)), np.nan, None
    for k, one in enumerate(some):
        if isinstance(one, Ripple):
            if one.number != number:  # those of one number follow each other
                number, waves = one.number, one.waves(motion, j)
            found[:, k, 0], found[:, k, 1] = one.loads(motion, j, waves)
        else:
            found[:, k, 0], found[:, k, 1] = one.loads(motion, j)
    return found


def _explained(beside: OwnColours, colour: Colour, count: int) -> Array:
    """(f,) squares of the residual that the functions of each of so many explain beside the sensitivities, all whitened
    by a colour: of all these functions only those of one are multiplied with each other."""
    basis, places = beside.basis(colour), range(beside.used, beside.columns.count)
    blocks = asked_twice(partial(beside.columns.blocks, colour, places), len(basis))
    before = np.zeros((basis.shape[1], len(places)))
    for own, block in with_rows(basis, blocks()):
        before += own.T @ block
    along, products = np.zeros((count, FUNCTIONS)), np.zeros((count, FUNCTIONS, FUNCTIONS))
    for own, block in with_rows(basis, blocks()):
        left = less(block, own, before)
        along += (left[:, 0] @ left[:, 1:]).reshape(count, FUNCTIONS)
        together = left.T[1:].reshape(count, FUNCTIONS, -1)
        products += together @ together.transpose(0, 2, 1)
    inverse = np.linalg.pinv(products, rcond=DEPENDENT, hermitian=True)
    return np.asarray(np.einsum("gi,gij,gj->g", along, inverse, along))
