"""Moves from point to point, at rest at each: what a drive without a table of set points for any curve can run, too.

    q(t) = p_i + (p_{i+1} - p_i) s(u),   s(u) = 10 u^3 - 15 u^4 + 6 u^5,   u = (t - t_i) / move_s, at most 1

All joints move at the same time, each move takes move_s and is followed by a rest; the last move of a round goes back
to p_0. Speed and acceleration of a move are largest at u = 1/2 and (1 +- 1/sqrt(3)) / 2: 15/8 and 10/sqrt(3) times the
way over move_s and its square.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from fmu_didim.base.errors import InputError
from fmu_didim.data.excitation import PointToPoint
from fmu_didim.data.signals import Array
from fmu_didim.discovery.excitation.basis import GRID, Basis
from fmu_didim.discovery.excitation.limits import WITHIN

MOVES = 10
"""[1] Of a round."""
LARGEST = (0.5, 0.5 - 0.5 / np.sqrt(3), 0.5 + 0.5 / np.sqrt(3))
"""[1] Parts of a move at which speed and acceleration are largest."""


@dataclass(frozen=True)
class Points(Basis):
    """Moves between points, of a fifth order polynomial each.

    The coefficients are the points after the first one, from that one.

    Attributes:
        moves: of a round; dwell_s: rest after each.
    """

    moves: int = field(default=MOVES, kw_only=True)
    dwell_s: float = field(default=0.0, kw_only=True)

    def __post_init__(self) -> None:
        if self.moves < 2:
            raise InputError(
                "A motion that comes back needs two moves.", where="moves", got=self.moves, valid="2 or more",
                next_step="Ten are usual.",
            )  # fmt: skip
        if not 0 <= self.dwell_s < self.leg_s:
            raise InputError(
                "The rests leave no time for the moves.", where="dwell_s", got=f"{self.dwell_s:g} s",
                valid=f"0 or more, and less than {self.leg_s:g} s, the period over the number of moves",
                next_step="Rest for less, or ask for fewer moves or a longer period.",
            )  # fmt: skip

    @property
    def leg_s(self) -> float:
        """Duration of a move and its rest, s."""
        return 1 / (self.fundamental_hz * self.moves)

    @property
    def move_s(self) -> float:
        """Duration of a move, s."""
        return self.leg_s - self.dwell_s

    @property
    def inner_count(self) -> int:
        return self.moves - 1

    @property
    def fastest(self) -> tuple[str, float]:
        return "The acceleration of a move", 1 / self.move_s  # nearly one period of a sine

    @property
    def room(self) -> float:
        return WITHIN

    def inner(self, time: Array) -> tuple[Array, Array, Array]:
        # The table of the points by unit vectors: one joint for each point, which alone is not at the first one.
        ways = np.vstack([np.zeros(self.inner_count), np.eye(self.inner_count)])
        return self._moves(ways).motion(np.mod(time, self.periods * self.moves * self.leg_s))

    def _moves(self, points: Array) -> PointToPoint:
        rounds = [*points.tolist()] * self.periods + [points[0].tolist()]
        return PointToPoint(points=tuple(map(tuple, rounds)), move_s=self.move_s, dwell_s=self.dwell_s)

    def grid(self, density: int = GRID) -> Array:
        parts = np.unique([*np.linspace(0.0, 1.0, density + 1), *LARGEST])
        return (self.leg_s * np.arange(self.moves)[:, None] + self.move_s * parts).ravel()

    def excitation(self, z: Array) -> PointToPoint:
        first = z[0] if self.start is None else self.start
        inner = z[1:] if self.start is None else z
        return self._moves(np.vstack([first, first + inner]))

    def drawn_inner(self, rng: np.random.Generator) -> Array:
        points = rng.uniform(-1.0, 1.0, size=(self.moves, self.joints))
        return np.asarray(points[1:] - points[0])
