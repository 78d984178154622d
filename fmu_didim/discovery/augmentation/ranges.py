"""Where the reference of a joint goes, and the grids of shapes that make sense there."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fmu_didim.effects import Search
from fmu_didim.prediction.loop_model import LoopModel

WINDOW_EDGES = 24
"""Number of begins and ends of a force window that are tried."""


@dataclass(frozen=True)
class Range:
    """Where the reference of one joint goes: positions, speeds, times, and the way of one control period."""

    lowest: float
    highest: float
    speed: float
    way: float
    begin: float
    end: float

    def adapted(self, search: Search, unit: str) -> Search:
        """The grid of a shape of this unit, moved to where the data can tell something about it."""
        if search.logarithmic:
            floor = {"rad": 0.1 * self.way, "m": 0.1 * self.way, "rad/s": 0.003 * self.speed, "m/s": 0.003 * self.speed}
            low = max(search.lowest, floor.get(unit, 0.0))
            return replace(search, lowest=low, highest=max(search.highest, 2 * low))
        if unit in ("rad", "m"):
            room = 0.02 * (self.highest - self.lowest)
            return replace(search, lowest=self.lowest + room, highest=self.highest - room)
        if unit == "s":
            return replace(search, lowest=self.begin, highest=self.end, count=min(search.count, WINDOW_EDGES))
        return search


def travelled(base: LoopModel, joint: int) -> Range:
    """The range of the references of a joint, counted from 1, in the experiments that are fitted."""
    positions, speeds, ends = [], [], []
    for label in base.estimation_labels:
        reference = base.experiments[label].reference
        step = float(reference.time[1] - reference.time[0])
        name = f"q{joint}"
        q = reference.select([name])[:, 0] if name in reference.names else np.zeros(reference.time.size)
        positions.append(q)
        speeds.append(np.abs(np.gradient(q, step)))
        ends.append((float(reference.time[0]), float(reference.time[-1])))
    q, speed = np.concatenate(positions), np.concatenate(speeds)
    way = float(np.sqrt(np.mean(speed**2))) * step
    begin, end = min(low for low, _ in ends), max(high for _, high in ends)
    return Range(float(q.min()), float(q.max()), float(speed.max()), way, begin, end)
