"""What a benchmark returns, and how times are taken."""

from __future__ import annotations

import gc
import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

Sense = Literal["at most", "at least"]

OFF = "off sigma"
"""Among the medians of a figure: how far the values of another tool are from ours, in standard deviations; beside it
``ours s`` and ``theirs s``."""
OVER = ": identification / "
"""In the name of such a figure: between the task and the other tool."""
EXPONENT = ", exponent"
"""At the end of the name of a figure that tells how something grows; its medians are ``<number> <of what> <unit>``."""
PARAMETERS = "parameters"
"""Unit of the number of parameters, there."""


@dataclass(frozen=True)
class Settings:
    """How long to measure.

    Attributes:
        repeats: rounds of each measurement; the median counts.
        quick: small counts, to see that everything runs; its figures mean little.
        full: the large counts, minutes each.
    """

    repeats: int = 5
    quick: bool = False
    full: bool = False

    def size(self, normal: int, quick: int, full: int | None = None) -> int:
        """A count for this kind of run."""
        if self.quick:
            return quick
        return full if self.full and full is not None else normal


@dataclass(frozen=True)
class Figure:
    """One line of the table.

    Attributes:
        name: of the figure.
        ratio: the median ratio; None if the competitor is not installed (the note says which) or it is only reported.
        goal: what the ratio is held against, None if it is only reported; sense: on which side the ratio must lie.
        medians: raw numbers, the unit at the end of each name.
        note: what must be known to read the numbers.
    """

    name: str
    ratio: float | None
    goal: float | None
    sense: Sense = "at most"
    medians: Mapping[str, float] = field(default_factory=dict)
    note: str = ""

    @property
    def met(self) -> bool | None:
        """Whether the goal is met; None if there is none, or nothing to hold it against: a competitor is absent."""
        if self.goal is None or self.ratio is None:
            return None
        return self.ratio <= self.goal if self.sense == "at most" else self.ratio >= self.goal

    def content(self) -> dict[str, Any]:
        """For the JSON file."""
        return {
            "name": self.name, "ratio": self.ratio, "goal": self.goal, "sense": self.sense, "met": self.met,
            "medians": dict(self.medians), "note": self.note,
        }  # fmt: skip


@dataclass(frozen=True)
class Times:
    """Seconds of each round, by name; the rounds of all names were interleaved."""

    seconds: Mapping[str, tuple[float, ...]]

    def median(self, name: str) -> float:
        """Median of the rounds in s."""
        return statistics.median(self.seconds[name])

    def ratio(self, over: str, under: str) -> float:
        """Median of the ratio round by round, so that a drift of the machine's speed cancels."""
        return statistics.median(a / b for a, b in zip(self.seconds[over], self.seconds[under], strict=True))


def interleaved(work: Mapping[str, Callable[[], object]], *, repeats: int, warm: bool = True) -> Times:
    """Time all functions in turn, ``repeats`` rounds; ``warm`` calls each once before."""
    if warm:
        for function in work.values():
            function()
    seconds: dict[str, list[float]] = {name: [] for name in work}
    for _ in range(repeats):
        for name, function in work.items():
            gc.collect()
            begin = time.perf_counter()
            function()
            seconds[name].append(time.perf_counter() - begin)
    return Times({name: tuple(values) for name, values in seconds.items()})
