"""How far the links of a robot are from each other, from boxes about it, and from the walls of one around it.

Links are capsules, segments with a radius. A clearance is the distance of the surfaces, negative where they overlap:

    two capsules   |segment, segment| - r_1 - r_2
    keep-out box   signed |segment, box| - r
    box inside     least of both ends of x - low - r and high - r - x, in x, y and z

Between two instants a point that moves by m has come nearer than at both by at most m / 2, so that clearances c and c'
leave (c + c' - m) / 2 at least.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property, reduce

import casadi as ca
import numpy as np

from fmu_didim.data.signals import Array
from fmu_didim.dynamics.robot import RobotDescription
from fmu_didim.dynamics.robot.dynamics import link_geometry
from fmu_didim.dynamics.space.distances import between_segments, to_box

Point = tuple[float, float, float]


@dataclass(frozen=True)
class Capsule:
    """A segment with a radius in m.

    Attributes:
        link: to which it belongs, 0 for the base; start, end: (3,) m in the frame of that link.
        before: whether the start is in the frame of the link before, as of a line from origin to origin.
    """

    link: int
    start: Point
    end: Point
    radius: float = 0.0
    before: bool = False


@dataclass(frozen=True)
class Box:
    """A box along the axes of the base: lowest and highest corner, m; ``is_around``: which the arm does not leave."""

    low: Point
    high: Point
    is_around: bool = False
    name: str = "box"


@dataclass(frozen=True)
class Check:
    """Two things whose clearance is asked for: a capsule, and another one or a box."""

    one: Capsule
    other: Capsule | Box

    @property
    def name(self) -> str:
        """Such as ``link 2, box 1``."""
        return f"link {self.one.link}, {self.other.name if isinstance(self.other, Box) else f'link {self.other.link}'}"


@dataclass(frozen=True)
class Space:
    """What a robot must keep clear of.

    Attributes:
        robot: its geometry; checks: C of them; least: m, the clearance that is kept.
        base: (4, 4) pose of the frame of link 0 of the description in that in which boxes and capsules of link 0 are.
    """

    robot: RobotDescription
    checks: tuple[Check, ...]
    least: float = 0.0
    base: Array = field(default_factory=lambda: np.eye(4))

    @property
    def names(self) -> tuple[str, ...]:
        """(C,) of the checks."""
        return tuple(check.name for check in self.checks)

    def of(self, checks: Sequence[Check]) -> Space:
        """The same with some of the checks, or others."""
        return Space(self.robot, tuple(checks), self.least, self.base)

    @cached_property
    def clearances(self) -> ca.Function:
        """(q,) positions of the joints (n,) -> (C,) clearances, m."""
        q, frames = self._frames()
        rows = [_clearance(check, frames) for check in self.checks]
        return ca.Function("clearances", [q], [ca.densify(ca.vertcat(ca.SX(0, 1), *rows))])

    @property
    def moved(self) -> Array:
        """(C,) whether any joint moves what a check compares."""
        rows = self.clearances.jac_sparsity(0, 0).row()
        return np.asarray(np.isin(np.arange(len(self.checks)), rows))

    @cached_property
    def _places(self) -> ca.Function:
        """(q,) -> (3, 2 L) ends of all capsules."""
        q, frames = self._frames()
        ends = [end for capsule in self._capsules for end in _ends(capsule, frames)]
        return ca.Function("places", [q], [ca.densify(ca.horzcat(*ends))])

    @cached_property
    def _capsules(self) -> tuple[Capsule, ...]:
        found = [part for check in self.checks for part in (check.one, check.other) if isinstance(part, Capsule)]
        return tuple(dict.fromkeys(found))

    def _frames(self) -> tuple[ca.SX, list[tuple[ca.SX, ca.SX]]]:
        """Positions, and rotation and origin of each frame; that of link 0 is the frame of the boxes."""
        q = ca.SX.sym("q", len(self.robot.joints))
        turn, origin = ca.SX(self.base[:3, :3]), ca.SX(self.base[:3, 3])
        frames = [(ca.SX.eye(3), ca.SX.zeros(3))]
        for own, offset in zip(*link_geometry(self.robot, q), strict=True):
            origin, turn = origin + turn @ offset, turn @ own
            frames.append((turn, origin))
        return q, frames

    def at(self, q: Array) -> Array:
        """(N, C) clearances at positions (N, n), m."""
        if not self.checks or not q.size:
            return np.zeros((q.shape[0], len(self.checks)))
        return np.asarray(self.clearances.map(q.shape[0])(q.T).full().T)

    def along(self, q: Array) -> Array:
        """(N - 1, C) least that can be left from each of the positions (N, n) of a motion to the next, m."""
        if not self.checks:
            return np.zeros((q.shape[0] - 1, 0))
        ends = self._places.map(q.shape[0])(q.T).full().reshape(3, q.shape[0], -1, 2)
        moved = np.linalg.norm(np.diff(ends, axis=1), axis=0).max(axis=-1)
        way = {capsule: moved[:, i] for i, capsule in enumerate(self._capsules)}
        both = np.column_stack([
            way[check.one] + (way[check.other] if isinstance(check.other, Capsule) else 0.0) for check in self.checks
        ])  # fmt: skip
        found = self.at(q)
        return np.asarray((found[1:] + found[:-1] - both) / 2)


def skeleton(robot: RobotDescription) -> tuple[Capsule, ...]:
    """Lines without thickness from the origin of each frame to the next, as far as a joint moves them."""
    lines = [Capsule(j, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), before=True) for j in range(1, len(robot.joints) + 1)]
    return tuple(line for line in lines if line.link > 1 or robot.joints[0].type == "prismatic")


def all_checks(capsules: Sequence[Capsule], boxes: Sequence[Box]) -> tuple[Check, ...]:
    """Capsules of different links with each other, and those that move with each box."""
    solid = [capsule for capsule in capsules if not capsule.before]
    pairs = [Check(a, b) for a in solid for b in solid if a.link > b.link]
    return (*pairs, *(Check(capsule, box) for box in boxes for capsule in capsules if capsule.link > 0))


def _ends(capsule: Capsule, frames: Sequence[tuple[ca.SX, ca.SX]]) -> tuple[ca.SX, ca.SX]:
    turn, origin = frames[capsule.link]
    first, place = frames[capsule.link - 1] if capsule.before else (turn, origin)
    return place + first @ ca.SX(ca.DM(capsule.start)), origin + turn @ ca.SX(ca.DM(capsule.end))


def _clearance(check: Check, frames: Sequence[tuple[ca.SX, ca.SX]]) -> ca.SX:
    own, radius, other = _ends(check.one, frames), check.one.radius, check.other
    if isinstance(other, Capsule):
        return between_segments(*own, *_ends(other, frames)) - radius - other.radius
    low, high = ca.SX(ca.DM(other.low)), ca.SX(ca.DM(other.high))
    if not other.is_around:
        return to_box(*own, low, high) - radius
    rows = ca.vertsplit(ca.vertcat(*(ca.vertcat(end - low, high - end) for end in own)))
    return reduce(ca.fmin, rows) - radius
