"""The range of the reference of a joint, and the grids of shapes that suit it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fmu_didim.dynamics.effects import Search
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.motion import joint_reference

WINDOW_EDGES = 24
"""[instants] Edges of a force window that are tried."""
SHORTEST_WAY = 0.1
"""[1] Smallest length of a shape, as a fraction of the way of one control period."""
LOWEST_SPEED = 0.003
"""[1] Smallest speed of a shape, as a fraction of the joint's largest."""
WIDEST = 2.0
"""[1] A logarithmic range ends at least at so many times its lowest value."""
MARGIN = 0.02
"""[1] Fraction of the positions at each end where no place of an effect is tried."""


@dataclass(frozen=True)
class Range:
    """The range of the reference of a joint: positions, largest speed, way in a control period, times."""

    lowest: float
    highest: float
    speed: float
    way: float
    begin: float
    end: float

    def shows(self, frequency: float) -> bool:
        """Whether what has this spatial frequency is seen at least twice in a period at the RMS of the speed, once in
        each control period; faster, it is averaged or looks like something slower."""
        return self.way * frequency < np.pi

    def drift(self, one: float, other: float) -> float:
        """Periods by which what has these two spatial frequencies drifts apart over the positions."""
        return abs(one - other) * (self.highest - self.lowest) / (2 * np.pi)

    def adapted(self, search: Search, unit: str) -> Search:
        """The grid of a shape of this unit, moved to the range in which the data determine it."""
        if search.logarithmic:
            way, speed = SHORTEST_WAY * self.way, LOWEST_SPEED * self.speed
            floor = {"rad": way, "m": way, "rad/s": speed, "m/s": speed}
            low = max(search.lowest, floor.get(unit, 0.0))
            return replace(search, lowest=low, highest=max(search.highest, WIDEST * low))
        if unit in ("rad", "m"):
            room = MARGIN * (self.highest - self.lowest)
            return replace(search, lowest=self.lowest + room, highest=self.highest - room)
        if unit == "s":
            return replace(search, lowest=self.begin, highest=self.end, count=min(search.count, WINDOW_EDGES))
        return search


def travelled(base: LoopModel, joint: int) -> Range:
    """The range of the references of a joint, counted from 1, in the experiments that are fitted."""
    positions, speeds, ends = [], [], []
    for label in base.estimation_labels:
        reference = base.experiments[label].reference
        q, dq = joint_reference(reference, joint)
        positions.append(q)
        speeds.append(np.abs(dq))
        ends.append((float(reference.time[0]), float(reference.time[-1])))
    q, speed = np.concatenate(positions), np.concatenate(speeds)
    way = float(np.sqrt(np.mean(speed**2))) * reference.step
    begin, end = min(low for low, _ in ends), max(high for _, high in ends)
    return Range(float(q.min()), float(q.max()), float(speed.max()), way, begin, end)
