"""The robot as a moving drawing: its joints along the simulated motion, and the residual over its posture.

Frame j follows from frame j-1 by Tx(a) Rx(alpha) Ry(beta) Rz(theta) Tz(d), as in the robot description (Khalil and
Kleinfinger 1986); a point of the drawing is the origin of each frame. The last link has no length there: it is drawn
along the x axis of its frame, as long as the others on average.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from markupsafe import Markup

from fmu_didim.data.signals import Array
from fmu_didim.dynamics.robot.body import turn
from fmu_didim.report.drawing.charts import in_script
from fmu_didim.results.result import LinkResult

FRAMES = 240
"""[postures] Of the drawing: eight seconds at thirty a second."""
MOST = 20_000
"""[samples] Of a motion whose extent is looked at: of a long log every so many, all that a drawing shows."""
PATH = 1200
"""[samples] Of the path of the end whose residual is drawn."""
LEVELS = 5
"""[1] Steps of colour of the residual: by one standard deviation of it each."""
FLAT = 1e-6
"""[1] Of the largest extent, below which a direction has none."""
TURNED, RAISED = np.radians(35.0), np.radians(25.0)
"""[rad] Direction from which a motion in space is seen, about the vertical axis and above the horizontal plane."""


class Link(Protocol):
    """A joint in modified Denavit-Hartenberg convention, rad and m, ``revolute`` or ``prismatic``."""

    @property
    def type(self) -> str: ...
    @property
    def alpha(self) -> float: ...
    @property
    def a(self) -> float: ...
    @property
    def theta(self) -> float: ...
    @property
    def d(self) -> float: ...
    @property
    def beta(self) -> float: ...


@dataclass(frozen=True)
class Skeleton:
    """A moving drawing.

    Attributes:
        name: part of its id on the page; title: what it shows.
        time: (F,) s, of the postures; points: (F, n + 2, 2) of base, joints and end, in the plane of the drawing.
        path: (M, 2) of the end; level: (M,) size of the residual there, from 0.
    """

    name: str
    title: str
    time: Array
    points: Array
    path: Array
    level: Array

    @property
    def json(self) -> Markup:
        """The drawing as JSON that is safe inside a script element."""
        content: dict[str, Any] = {
            "title": self.title, "time": np.round(self.time, 4).tolist(), "points": np.round(self.points, 4).tolist(),
            "path": np.round(self.path, 4).tolist(), "level": self.level.astype(int).tolist(), "levels": LEVELS,
        }  # fmt: skip
        return in_script(content)


def skeleton(
    name: str, title: str, links: Sequence[LinkResult], gravity: Sequence[float], time: Array, q: Array, left: Array
) -> Skeleton | None:
    """The robot along its motion; None where it has no extent to draw.

    Args:
        gravity: (3,) m/s2 in the base frame, against which is upwards; q: (N, n) positions of the joints.
        left: (N,) size of the residual, in its standard deviations.
    """
    if time.size > MOST:
        few = np.unique(np.linspace(0, time.size - 1, MOST).astype(int))
        time, q, left = time[few], q[few], left[few]
    points = joint_points(links, q)
    if not np.isfinite(points).all() or np.ptp(points, axis=(0, 1)).max() <= 0:
        return None
    flat = _seen(points, np.array(gravity, dtype=float))
    chosen = np.unique(np.linspace(0, time.size - 1, min(FRAMES, time.size)).astype(int))
    along = np.unique(np.linspace(0, time.size - 1, min(PATH, time.size)).astype(int))
    level = np.minimum(np.floor(left[along]), LEVELS - 1)
    return Skeleton(name, title, time[chosen], flat[chosen], flat[along, -1], level)


def joint_points(links: Sequence[Link], q: Array) -> Array:
    """(N, n + 2, 3) origins of the base and of all frames, and the end of the last link, in the base frame, in m.

    Args:
        q: (N, n) rad or m.
    """
    count = q.shape[0]
    at, turned = np.zeros((count, 3)), np.tile(np.eye(3), (count, 1, 1))
    found = [at]
    for link, position in zip(links, q.T, strict=True):
        theta = link.theta + (position if link.type == "revolute" else np.zeros(count))
        d = link.d + (position if link.type == "prismatic" else np.zeros(count))
        before = turn(0, link.alpha) @ turn(1, link.beta)
        cosine, sine, zero, one = np.cos(theta), np.sin(theta), np.zeros(count), np.ones(count)
        at = at + turned @ np.array([link.a, 0, 0]) + d[:, None] * (turned @ before[:, 2])
        spin = [[cosine, -sine, zero], [sine, cosine, zero], [zero, zero, one]]
        turned = turned @ before @ np.moveaxis(np.array(spin), 2, 0)
        found.append(at)
    lengths = np.linalg.norm(np.diff(np.stack(found, axis=1)[0], axis=0), axis=1)
    there = lengths[lengths > 0]
    end = float(there.mean()) if there.size else 1.0
    return np.stack([*found, at + end * turned[:, :, 0]], axis=1)


def _seen(points: Array, gravity: Array) -> Array:
    """(N, m, 2) of points (N, m, 3): the plane in which they move, upwards against gravity, or seen from aside."""
    extent = np.ptp(points, axis=(0, 1))
    moving = [k for k in range(3) if extent[k] > FLAT * extent.max()]
    size = float(np.linalg.norm(gravity))
    if len(moving) < 3:
        pair = [*moving, *(k for k in range(3) if k not in moving)][:2]
        up = int(np.argmax(np.abs(gravity))) if size > 0 else max(pair)
        pair = sorted(pair, key=lambda k: k == up)
        sign = -1.0 if size > 0 and gravity[pair[1]] > 0 else 1.0
        return np.asarray(points[:, :, pair] * [1.0, sign])
    upward = -gravity / size if size > 0 else np.array([0.0, 0.0, 1.0])
    first = np.eye(3)[int(np.argmin(np.abs(upward)))]
    east = np.cross(upward, np.cross(first, upward))
    east = east / np.linalg.norm(east)
    north = np.cross(upward, east)
    right = np.cos(TURNED) * east + np.sin(TURNED) * north
    away = np.cos(TURNED) * north - np.sin(TURNED) * east
    raised = np.cos(RAISED) * upward + np.sin(RAISED) * away
    return np.asarray(points @ np.column_stack([right, raised]))
