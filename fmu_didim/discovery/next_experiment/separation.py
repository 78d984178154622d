"""How far a motion separates effects that explain the same data.

The part of the fitted signature of a member a that remains when the base model and the best fit of another member b are
projected out, in units of the noise:

    d(a|b)^2 = min over shapes of b of  sum_j f_j/sigma_j^2 | (I - P_[W, C_b]) C_a theta_a |_j^2

W holds the regressor of the base robot and the slopes of its shape parameters (v0 is never known). Expected of data
in which a is the truth, d^2 is the chi-square by which b fits worse.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fmu_didim.base.errors import InputError
from fmu_didim.data.signals import Array
from fmu_didim.discovery.augmentation.places import shape_limits
from fmu_didim.discovery.next_experiment.members import AmbiguousEffect, ProjectedMotion
from fmu_didim.discovery.selection.competition import DEPENDENT
from fmu_didim.fit.base_projection import BaseProjection
from fmu_didim.fit.solver.bounded import least_between

ABSORBED = 1e-6
"""[1] Fraction of a column below which the base absorbs it whole."""
REFINEMENTS = 6
"""[evaluations] Of the golden-section search of a shape."""
REFINED = 0.02
"""[1] Relative accuracy at which that search ends."""


@dataclass(frozen=True)
class Separation:
    """How much worse the second of an ordered pair fits if the first is the truth.

    Attributes:
        chi_square: (n,) of each joint, d(a|b)^2; separable: |signature of a|^2 that the base cannot absorb.
        margin: expected BIC difference, > 0 in favour of the first.
    """

    chi_square: Array
    separable: float
    margin: float

    @property
    def distance(self) -> float:
        """d(a|b), in units of the noise."""
        return float(np.sqrt(self.chi_square.sum()))


Pair = tuple[int, int]
"""Indices of two members: the truth and its rival."""
Table = dict[Pair, Separation]


def separations(
    motion_projection: ProjectedMotion, members: Sequence[AmbiguousEffect], theta: Sequence[Array]
) -> Table:
    """All ordered pairs of members with amplitudes ``theta``; one is missing where its first has no columns."""
    tables = [_Columns(motion_projection, m) for m in members]
    result: Table = {}
    for a, member in enumerate(members):
        own = tables[a].at(member.shapes)
        if own is None:
            continue
        target = own @ theta[a]
        separable = float(target @ target)
        for b, other in enumerate(members):
            if a == b:
                continue
            rest = motion_projection.per_joint(tables[b].rest(target))
            gain = float(np.sum(motion_projection.samples * np.log1p(rest / motion_projection.samples)))
            cost = (other.cost - member.cost) * np.log(float(motion_projection.samples.sum()))
            result[a, b] = Separation(rest, separable, gain + cost)
    return result


def amplitudes(motion_projection: ProjectedMotion, members: Sequence[AmbiguousEffect]) -> list[Array]:
    """Fitted amplitudes; a member without any gets those that make it look most like the first one that has some."""
    known = next((m for m in members if m.theta is not None), None)
    if known is None or known.theta is None:
        raise InputError(
            "No member of the set has fitted amplitudes.", where="splitting experiment",
            next_step="Run fmu-didim discover again on data that move the joints in question.",
        )  # fmt: skip
    own = _Columns(motion_projection, known).at(known.shapes)
    found = []
    for member in members:
        if member.theta is not None:
            found.append(member.theta)
            continue
        columns = _Columns(motion_projection, member)
        if own is None:
            raise InputError(
                "The states of a member cannot be integrated.", where="splitting experiment",
                next_step="Run fmu-didim discover again with a shorter step of the reference.",
            )  # fmt: skip
        member.shapes = columns.best(own @ known.theta)
        found.append(columns.coefficients(member.shapes, own @ known.theta))
    return found


class _Columns:
    """Projected columns of one member on one motion, each made once."""

    def __init__(self, motion_projection: ProjectedMotion, member: AmbiguousEffect) -> None:
        self._scene, self._member = motion_projection, member
        self._made: dict[tuple[float, ...], Array | None] = {}

    def at(self, shapes: Mapping[str, float]) -> Array | None:
        key = tuple(shapes.values())
        if key not in self._made:
            table = self._member.columns(self._scene, shapes)
            if table is not None:
                size = np.linalg.norm(table, axis=0)
                table = self._scene.base.rest_of(table)
                # What the base absorbs to rounding explains nothing more.
                table[:, np.linalg.norm(table, axis=0) <= ABSORBED * size] = 0.0
            self._made[key] = table
        return self._made[key]

    def coefficients(self, shapes: Mapping[str, float], target: Array) -> Array:
        table = self.at(shapes)
        assert table is not None
        return np.asarray(np.linalg.lstsq(table, target, rcond=DEPENDENT)[0])

    def rest(self, target: Array) -> Array:
        """The part of a target that the member cannot explain with its best shapes."""
        return self._left(self.best(target), target)

    def best(self, target: Array) -> dict[str, float]:
        """Shapes that explain a target best: the grid, then a golden-section search of each logarithmic shape."""
        ranked = [
            (float(np.sum(self._left(s, target) ** 2)), i, s)
            for i, s in enumerate(self._member.grid(self._scene.path, coarse=self._scene.is_quick))
        ]
        size, _, shapes = min(ranked)
        for name, search in self._member.search.items():
            if not search.logarithmic or shapes[name] <= 0:
                continue
            low, high = (np.log(v) for v in shape_limits(search, False))
            spacing = np.log(search.highest / search.lowest) / max(search.count - 1, 1)
            width = spacing * (2 if self._scene.is_quick else 1)
            size, shapes = self._refined(name, shapes, target, size, (low, high), width)
        return shapes

    def _refined(
        self, name: str, shapes: dict[str, float], target: Array, size: float, within: tuple[float, float], width: float
    ) -> tuple[float, dict[str, float]]:
        middle = float(np.log(shapes[name]))
        bounds = (max(middle - width, within[0]), min(middle + width, within[1]))
        if bounds[1] <= bounds[0]:
            return size, shapes

        def left(x: float) -> float:
            return float(np.sum(self._left({**shapes, name: float(np.exp(x))}, target) ** 2))

        found, least = least_between(left, *bounds, accuracy=REFINED, evaluations=REFINEMENTS)
        if least < size:
            return least, {**shapes, name: float(np.exp(found))}
        return size, shapes

    def _left(self, shapes: Mapping[str, float], target: Array) -> Array:
        table = self.at(shapes)
        if table is None:
            return target
        return BaseProjection.of(table).rest_of(target)
