"""The space of a motion that is designed: which links and boxes are compared, and how near they come."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fmu_didim.base.errors import InputError
from fmu_didim.case import Case
from fmu_didim.data.signals import Array, Trajectory
from fmu_didim.discovery.excitation.limits import Bounds
from fmu_didim.dynamics.robot.formats.collision import Collision, read_collision
from fmu_didim.dynamics.robot.formats.urdf import SUFFIX
from fmu_didim.dynamics.space.space import Box, Capsule, Check, Point, Space, all_checks, skeleton
from fmu_didim.workflow.excitation.limits import MotionLimits

POSTURES = 1000
"""[postures] Drawn in the range of positions, in which links that overlap always are told from those that may."""
GIVEN, OF_URDF, LINES = (
    "the capsules that were given",
    "the collision geometry of the URDF",
    "lines between the origins of the frames",
)


@dataclass(frozen=True)
class Compared:
    """What is compared in a design.

    Attributes:
        space: the checks that a motion must keep; none where nothing is known.
        shape: where the shape of the links comes from, in words; "" where there is none.
        links: numbers of the links that have one; left_out: pairs of links that overlap always, or never move;
            odd: those of them that overlap and are no neighbours.
        unread: collision geometry that could not be read, in words.
        joints: n; is_elastic: whether gears give way, whose links are taken for where their motors are.
    """

    space: Space
    shape: str
    links: tuple[int, ...]
    left_out: tuple[str, ...]
    odd: tuple[str, ...]
    unread: tuple[str, ...]
    joints: int
    is_elastic: bool

    @property
    def are_links_compared(self) -> bool:
        """Whether any links are compared with each other."""
        return any(isinstance(check.other, Capsule) for check in self.space.checks)

    @property
    def bare(self) -> tuple[int, ...]:
        """Links without a shape, from 1."""
        return tuple(j for j in range(1, self.joints + 1) if j not in self.links)


@dataclass(frozen=True)
class Nearest:
    """The least clearance of a check along a motion: its name, m, and the instant in s."""

    name: str
    clearance: float
    time: float


def compared(case: Case, given: MotionLimits, bounds: Bounds) -> Compared:
    """The checks of a case.

    Raises:
        InputError: a capsule belongs to no link, or nothing can keep its space: the start, or each posture, breaks it.
    """
    robot = case.robot
    assert robot is not None
    shapes, shape, collision = _capsules(case, given)
    n = len(robot.joints)
    wrong = [capsule.link for capsule in shapes if capsule.link > n]
    if wrong:
        raise InputError(
            "A capsule belongs to a link that the robot does not have.", where="limits.capsules", got=wrong[0],
            valid=f"0 to {n}", next_step="Number the links as in the robot description, 0 is the base.",
        )  # fmt: skip
    boxes = [_box(box, f"box {i}") for i, box in enumerate(given.boxes, start=1)]
    if given.inside is not None:
        boxes.append(replace(_box(given.inside, "inside"), is_around=True))
    base = np.eye(4) if collision is None else collision.base
    space = Space(robot, all_checks(shapes, boxes), given.clearance, base)
    checks, left_out = _telling(space, bounds)
    links = tuple(sorted({capsule.link for capsule in shapes}))
    unread = () if collision is None or given.capsules is not None else collision.unread
    return Compared(
        space.of(checks), shape if shapes else "", links, *left_out, unread, n, bool(robot.elastic_joints())
    )


def _capsules(case: Case, given: MotionLimits) -> tuple[tuple[Capsule, ...], str, Collision | None]:
    """The shape of the links, where it comes from, and the collision geometry of the URDF file, if it is one."""
    name, robot = case.document.robot, case.robot
    assert name is not None and robot is not None
    is_urdf = name not in case.memory.objects and name.lower().endswith(SUFFIX)
    collision = read_collision(case.folder / name) if is_urdf else None
    if given.capsules is not None:
        return tuple(Capsule(c.link, c.from_, c.to, c.radius) for c in given.capsules), GIVEN, collision
    if collision is not None and collision.shapes:
        found = [Capsule(s.link, _point(s.start), _point(s.end), s.radius) for s in collision.shapes]
        return tuple(found), OF_URDF, collision
    return skeleton(robot) if given.boxes or given.inside is not None else (), LINES, collision


def end_of_last_link(case: Case, given: MotionLimits) -> Point | None:
    """The point of the shape of the last link that is farthest from the origin of its frame, m; None where no shape is
    known."""
    shapes, shape, _ = _capsules(case, given)
    robot = case.robot
    assert robot is not None
    ends = [end for one in shapes if one.link == len(robot.joints) for end in (one.start, one.end)]
    if shape == LINES or not ends:
        return None
    return max(ends, key=lambda end: float(np.linalg.norm(end)))


def _point(values: Array) -> Point:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _box(pairs: Sequence[tuple[float, float]], name: str) -> Box:
    low, high = (_point(np.array(side)) for side in zip(*pairs, strict=True))
    return Box(low, high, name=name)


def _telling(space: Space, bounds: Bounds) -> tuple[list[Check], tuple[tuple[str, ...], tuple[str, ...]]]:
    """The checks that depend on the motion and can be kept, and names of the pairs of links that are left out, all and
    those of no neighbours that overlap; raises InputError where nothing can be kept."""
    if not space.checks:
        return [], ((), ())
    limits, start = bounds.limits, bounds.start
    drawn = np.random.default_rng(0).uniform(limits.low, limits.high, size=(POSTURES, limits.low.size))
    found = space.at(drawn) - space.least
    always = np.asarray((found < 0).all(axis=0))
    stands = np.logical_not(space.moved)
    odd = list[str]()
    at_start = np.zeros(found.shape[1]) if start is None else space.at(start[None])[0] - space.least
    kept, left = list[int](), list[str]()
    for i, check in enumerate(space.checks):
        of_links = isinstance(check.other, Capsule)
        beside = isinstance(check.other, Capsule) and check.one.link - check.other.link == 1
        if of_links and (always[i] or stands[i] or (beside and at_start[i] < 0)):
            left.append(check.name)
            odd += [check.name] if not beside and always[i] else []
        elif always[i]:
            raise InputError(
                "No posture keeps its space.", where=f"limits: {check.name}",
                got=f"at best {1000 * found[:, i].max():.4g} mm too near in {POSTURES} postures",
                next_step="Correct box or capsule; boxes are in the frame of the base, of a URDF its root link.",
            )  # fmt: skip
        elif not stands[i]:
            kept.append(i)
    broken = [f"{space.names[i]} by {-1000 * at_start[i]:.4g} mm" for i in kept if at_start[i] < 0]
    if broken:
        raise InputError(
            "The motion would begin in a collision.", where="limits.start", got="; ".join(broken),
            next_step="Move the start, or correct boxes, capsules or clearance.",
        )  # fmt: skip
    if start is None and kept and not (found[:, kept] >= 0).all(axis=1).any():
        worst = int(np.argmin((found[:, kept] >= 0).mean(axis=0)))
        raise InputError(
            "No posture keeps its space.", where="limits: boxes, inside, capsules",
            got=f"none of {POSTURES} drawn; most are too near at {space.names[kept[worst]]}",
            next_step="Smaller boxes or capsules, another range of position, or a start: that is clear of all.",
        )  # fmt: skip
    return [space.checks[i] for i in kept], (tuple(dict.fromkeys(left)), tuple(dict.fromkeys(odd)))


def shortfall(space: Space, table: Trajectory) -> Array | None:
    """(C,) m by which each check comes too near along a motion, with what lies between its rows; negative where room is
    left; None where its positions are not known."""
    q = positions(space, table)
    return None if q is None else np.asarray(space.least - space.along(q).min(axis=0, initial=np.inf))


def positions(space: Space, table: Trajectory) -> Array | None:
    """(N, n) positions of the joints in a table; None where it lacks them."""
    names = [f"q{j}" for j in range(1, len(space.robot.joints) + 1)]
    return table.select(names) if set(names) <= set(table.names) else None


def nearest(space: Space, table: Trajectory, part_s: float = np.inf) -> tuple[Nearest, ...]:
    """The least clearance of each pair of links and of each link and box along a motion, the nearest first.

    Args:
        part_s: of a table of several runs one after the other, from the start of one to that of the next, s.
    """
    q = positions(space, table)
    if q is None or not space.checks:
        return ()
    found, made = space.along(q), dict[str, Nearest]()
    for i, name in enumerate(space.names):
        row = int(np.argmin(found[:, i]))
        one = Nearest(name, float(found[row, i]), float(table.time[row] % part_s))
        if name not in made or one.clearance < made[name].clearance:
            made[name] = one
    return tuple(sorted(made.values(), key=lambda one: one.clearance))


def space_document(found: Compared, table: Trajectory, part_s: float) -> dict[str, Any]:
    """What ``excite.json`` says of the space along the simulated motion."""
    return {
        "shape_of_links": found.shape or None,
        "links": list(found.links),
        "clearance_m": found.space.least,
        "compared": sorted(set(found.space.names)),
        "left_out": list(found.left_out),
        "not_read": list(found.unread),
        "nearest": [
            {"what": one.name, "clearance_m": one.clearance, "time_s": one.time}
            for one in nearest(found.space, table, part_s)
        ],
    }
