"""Where local fits end, told apart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fmu_didim.estimators.search.crew import Ended
from fmu_didim.fit.exploration.minima import FoundMinimum, misfit
from fmu_didim.model.loop_model import LoopModel

SAME_VALUE = 0.5
"""[standard deviations] Local fits that end nearer to each other in all values are in one minimum: each stops within
hundredths of it, and two that are told apart are so by any reader."""
SAME_DIGITS = 1e-3
"""[1] Relative difference of values that are the same where there is no noise, and so no standard deviation."""


@dataclass(frozen=True)
class Place:
    """Where local fits ended: one of them, and how many.

    Attributes:
        end: of the one with the least misfit; misfit: of it; starts: how many; settled: whether one has.
    """

    end: Ended
    misfit: float
    starts: int = 1
    settled: bool = False

    @staticmethod
    def of(model: LoopModel, end: Ended) -> Place:
        """Of one local fit."""
        values = np.array([end.values[name] for name in model.names])
        return Place(end, misfit(model, end.squares, values), settled=end.settled)

    def values_in(self, names: Sequence[str]) -> dict[str, float]:
        """Those of these parameters, to start from."""
        return {name: self.end.values[name] for name in names}

    def is_at(self, other: Place, names: Sequence[str]) -> bool:
        """Whether it is the same minimum."""
        return all(_same(name, self.end, other.end) for name in names)

    def told(self, best: float) -> FoundMinimum:
        """As it is reported, beside the misfit of the best one."""
        end = self.end
        return FoundMinimum(
            end.values, end.deviation, max(self.misfit - best, 0.0), end.error_percent, self.starts, self.settled
        )  # fmt: skip


def _same(name: str, one: Ended, other: Ended) -> bool:
    apart = abs(one.values[name] - other.values[name])
    deviation = max(_number(one.deviation, name), _number(other.deviation, name))
    return apart <= max(SAME_VALUE * deviation, SAME_DIGITS * max(abs(one.values[name]), abs(other.values[name])))


def _number(values: Mapping[str, Any], name: str) -> float:
    value = float(values.get(name, 0.0))
    return value if np.isfinite(value) else 0.0


def distinct(places: Sequence[Place], names: Sequence[str]) -> list[Place]:
    """The different ones of some places, the least misfit first, each with the number of fits that ended there."""
    found: list[Place] = []
    for one in sorted(places, key=lambda place: place.misfit):
        k = next((k for k, known in enumerate(found) if one.is_at(known, names)), None)
        if k is None:
            found.append(one)
        else:
            found[k] = replace(found[k], starts=found[k].starts + 1, settled=found[k].settled or one.settled)
    return found
