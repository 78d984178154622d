"""The history of an estimation: one entry for each step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

from fmu_didim.data.signals import Array


@dataclass(frozen=True)
class Iteration:
    """One step of an estimator.

    Attributes:
        stage: ``didim``, ``finish``, ...; number: counted from 1 within the stage.
        parameters: (b,) values simulated in this step.
        relative_error_percent: 100 |y - y_s| / |y| at these values; NaN if the simulation failed.
        change: relative change of the parameters that the step proposes, in units of torque.
        note: what was caught and how it was recovered from.
        restarts: whether the estimator begins anew after it, from another start.
        quantity: what y is, in a word: ``torque``, or ``output`` of any model; then the error is that of what it moves.
    """

    stage: str
    number: int
    parameters: Array
    relative_error_percent: float
    change: float = float("nan")
    condition_number: float = float("nan")
    note: str = ""
    restarts: bool = False
    quantity: str = "torque"


@dataclass(frozen=True)
class History:
    """The iterations so far; ``progress`` is called with each of them as it comes."""

    progress: Callable[[Iteration], None]
    iterations: list[Iteration] = field(default_factory=list)

    @property
    def count(self) -> int:
        """Their number."""
        return len(self.iterations)

    def add(self, iteration: Iteration) -> None:
        """Append an iteration and report it."""
        self.iterations.append(iteration)
        self.progress(iteration)

    def restart(self) -> None:
        """Say of the last iteration that another start follows."""
        if self.iterations:
            self.iterations[-1] = replace(self.iterations[-1], restarts=True)
